"""The limb graph of any subject: bodies merged into limbs, frames at rest, cones, edges, and which limbs mirror each
other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.limbs.bodies import Bodies, bodies_of
from humanoid.limbs.limb import Limb, LimbGraph, fitted_cone
from humanoid.limbs.merging import RULES, Detail, Group, merged, topmost_first
from humanoid.limbs.override_file import Change, Overrides, read_overrides
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import Subject
from humanoid.subject.urdf_flesh import mirror_parts
from humanoid.support.errors import InputError
from humanoid.support.per_object import per_object

_AS_FAR = 0.98  # of the farthest joint's distance: joints as far as this are the end together, as both shoulders
_SHORT = 0.1  # of the longest body: a joint nearer than this to the proximal joint is not an end
_ROUND = 0.05  # of the sum of a section's two variances: below this difference it has no main axes
_STEEP = 0.7  # cosine; where z is nearer to a direction than this, the section is turned by another


@dataclass(frozen=True, eq=False)
class LimbFrame:
    """A limb's frame in the world, with the body at rest. t (3,) [m], R (3, 3). length [m]: to the distal joint."""

    t: np.ndarray
    R: np.ndarray
    length: float

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the world in this frame."""
        return np.asarray((points - self.t) @ self.R)


def frame_of(
    bodies: Bodies,
    group: Group,
    others: list[Group],
    nodes: np.ndarray,
    proximal: np.ndarray | None = None,
    distal: np.ndarray | None = None,
) -> LimbFrame:
    """The frame of a group of bodies whose surface has the nodes (N, 3) [m].

    Its origin is the joint that the group hangs on, of the root that of its link. z goes to the farthest joint that
    another group hangs on, to the middle of joints that are equally far; where there is none, to the farthest joint
    inside the group on the body that carries it; else along the line through the origin that is nearest to the nodes,
    as far as they go. x or y, whichever is possible, is the main axis of the section that is nearest to the forward or
    the left axis of the root: frames of mirrored limbs are then mirrored, with y turned round. proximal, distal (3,):
    joints in the world [m] that are given instead.
    """
    t = bodies.pivot[group.members[0]] if proximal is None else proximal
    end = _end(bodies, group, others, t) if distal is None else distal
    if end is None:
        z = axis_through(nodes - t)
        length = float(((nodes - t) @ z).max(initial=0.0))
    else:
        z, length = (end - t) / np.linalg.norm(end - t), float(np.linalg.norm(end - t))
    return LimbFrame(t, _turned(z, nodes - t, bodies.posed.rotations[bodies.root]), length)


def _end(bodies: Bodies, group: Group, others: list[Group], t: np.ndarray) -> np.ndarray | None:
    """Place of the distal joint (3,) [m]; None without one far enough."""
    tops = [g.members[0] for g in others]
    outside = [top for top in tops if bodies.parent[top] in group.members and not bodies.hung[top]]
    unit = bodies.unit[group.carrier]
    inside = [k for k in group.members if bodies.unit[k] != unit and bodies.unit[max(bodies.parent[k], 0)] == unit]
    for joints in (outside, inside):
        if joints:
            places = bodies.pivot[joints]
            far = np.linalg.norm(places - t, axis=1)
            middle = places[far >= _AS_FAR * far.max()].mean(axis=0)
            if np.linalg.norm(middle - t) > _SHORT * bodies.longest:
                return np.asarray(middle)
    return None


def axis_through(offset: np.ndarray) -> np.ndarray:
    """The unit vector of the line through the origin nearest to points (N, 3), to the side of their mean."""
    axis = np.linalg.eigh(offset.T @ offset)[1][:, 2]
    side = offset.mean(axis=0) @ axis
    return np.asarray(axis if side >= 0.0 else -axis)


def _turned(z: np.ndarray, offset: np.ndarray, root: np.ndarray) -> np.ndarray:
    """R (3, 3) with the axis z, turned to the main axes of the section of points (N, 3)."""
    if abs(z @ root[:, 0]) < _STEEP:
        x = root[:, 0] - (z @ root[:, 0]) * z
        x /= np.linalg.norm(x)
    else:
        y = root[:, 1] - (z @ root[:, 1]) * z
        x = np.cross(y, z) / np.linalg.norm(y)
    y = np.cross(z, x)
    p, q = offset @ x, offset @ y
    wide, skew = float(p @ p - q @ q), 2.0 * float(p @ q)
    if np.hypot(wide, skew) > _ROUND * float(p @ p + q @ q):
        angle = 0.5 * np.arctan2(skew, wide)  # of the longest axis; its nearest one to x is at most 45 degrees off
        angle -= np.pi / 2.0 * np.round(angle / (np.pi / 2.0))
        x = np.cos(angle) * x + np.sin(angle) * y
    return np.stack([x, np.cross(z, x), z], axis=1)


NODES = 3000
"""Nodes of the surface that cones are fitted to."""
_NEAR = 0.02  # of the longest body: how far from a limb's cone nodes count by their squared distance
_ASTRAY = np.cos(np.radians(45.0))  # of a merged end's axis to its limb's
_SAME_PLACE = 0.02  # of the longest body: how far two mirrored ends may miss each other


def limb_graph(
    subject: Subject | Body,
    detail: Detail = "paper",
    overrides: str | Path | Overrides | None = None,
    like: LimbGraph | None = None,
) -> LimbGraph:
    """Limbs of a subject, from its joints and its flesh, else its visual or collision shapes.

    Bodies of fixed links are one body. Joints that act as one (`bodies_of`) begin a limb together, carried by the
    outermost, and bodies without surface belong to a neighbour. Of what is left, short bodies are merged; lengths are
    from joint to joint, of a last body twice the way to the middle of its surface, and are compared with the longest:

    - "paper": ends of chains below 0.5 (hands, feet), ends that hang on a hub, a limb with three neighbours or more,
      below 0.2 (fingers), what leads from a hub to one other limb on a joint of one or two degrees of freedom below
      0.5 (clavicles, an abdomen), and the root below 0.5 (a pelvis). The built-in adult has the paper's ten limbs.
    - "fine": only what is below 0.1, and what leads from a hub below 0.45.

    The neighbour with the most neighbours takes them; never are fewer than two limbs left. A limb of several moving
    bodies is rigid: as the bodies are at rest, carried by the longest of them (`Limb.link`).

    Cones are fitted to all nodes of a limb's bodies that are not inside another part of it, without ends whose axis is
    more than 45 degrees off: a foot moves with its shank and does not widen it. Edges join limbs that a joint joins.
    Limbs mirror each other whose links' names differ in left and right, else those that a body at rest has mirrored in
    the root's plane y = 0.

    subject: or a body, whose lengths count then; flesh is always the subject's, so for other lengths give
    `subject.scaled`. overrides: a TOML file or what `read_overrides` made of it. like: a graph of a body with the same
    links, whose limbs are kept instead of the rule's, as for one person's lengths; detail has no effect then.

    Raises
    ------
    InputError: no flesh or geometry, under two limbs, `detail` unknown, or overrides that do not fit.
    """
    body = subject if isinstance(subject, Body) else Body(subject)
    if detail not in RULES:
        raise InputError(repr(detail), "is not a detail of limbs", remedy="one of " + ", ".join(RULES))
    return _by_rules(body, detail) if overrides is None and like is None else _graph(body, detail, overrides, like)


@per_object
def _by_rules(body: Body, detail: Detail) -> LimbGraph:
    return _graph(body, detail, None, None)


def _graph(body: Body, detail: Detail, overrides: str | Path | Overrides | None, like: LimbGraph | None) -> LimbGraph:
    source = body.subject.source
    bodies = bodies_of(body, surface_of(body, NODES))
    given = read_overrides(overrides) if isinstance(overrides, str | Path) else overrides or Overrides()
    fixed = given.groups(bodies) if like is None else _as_in(like, bodies, source)
    groups = merged(bodies, RULES[detail], fixed)
    if len(groups) < 2:
        remedy = 'give shapes to two links that a joint parts, or base="free" with more of them'
        raise InputError(source, f"has {len(groups)} limb, which is not a graph", place="limbs", remedy=remedy)
    names = [group.name or _name(bodies, group) for group in groups]
    given.check(names)
    frames, limbs = [], []
    for group, name in zip(groups, names, strict=True):
        frame, limb = _limb(body, bodies, group, groups, name, given.limbs.get(name, Change()))
        frames.append(frame)
        limbs.append(limb)
    return LimbGraph(tuple(limbs), _edges(bodies, groups), _mirror(bodies, limbs, frames))


def _name(bodies: Bodies, group: Group) -> str:
    """Name of the link with the most surface."""
    links = [name for j in (group.carrier, *group.members) for name in bodies.links[j]]
    return max(links, key=lambda name: bodies.area[name])


def _limb(
    body: Body, bodies: Bodies, group: Group, groups: list[Group], name: str, change: Change
) -> tuple[LimbFrame, Limb]:
    proximal, distal = change.joints(body, bodies, group, name)
    nodes = outer_nodes(bodies, list(group.members))
    frame = frame_of(bodies, group, [g for g in groups if g is not group], nodes, proximal, distal)
    nodes = outer_nodes(bodies, along_axis(bodies, group, frame.R[:, 2]))
    cone = change.cone(fitted_cone(frame.inside(nodes), _NEAR * bodies.longest), name)
    carrier = max(bodies.links[group.carrier], key=lambda link: bodies.area[link])
    place = body.model.frames[body.model.getFrameId(carrier, pin.FrameType.BODY)].placement
    R = bodies.posed.rotations[group.carrier] @ place.rotation
    t = bodies.posed.rotations[group.carrier] @ place.translation + bodies.posed.translations[group.carrier]
    links = tuple(link for j in group.members for link in bodies.links[j])
    t_link_limb, R_link_limb = R.T @ (frame.t - t), R.T @ frame.R
    ends = cone.start, cone.end, cone.proximal, cone.distal
    return frame, Limb(name, links, carrier, t_link_limb, R_link_limb, frame.length, *ends)


def along_axis(bodies: Bodies, group: Group, z: np.ndarray) -> list[int]:
    """The bodies of a group but for ends whose own axis is more than 45 degrees off its axis z (3,)."""
    kept = set(group.members)
    for unit in {int(bodies.unit[j]) for j in group.members} - {int(bodies.unit[group.carrier])}:
        own = [j for j in group.members if bodies.unit[j] == unit]
        behind = [k for k in range(len(bodies.parent)) if k not in own and int(bodies.parent[k]) in own]
        nodes = np.concatenate([bodies.points[j] for j in own])
        if not behind and len(nodes) and axis_through(nodes - bodies.pivot[unit]) @ z < _ASTRAY:
            kept -= set(own)
    return [j for j in group.members if j in kept]


def outer_nodes(bodies: Bodies, members: list[int]) -> np.ndarray:
    """The nodes of some bodies that are inside no other part of them, (N, 3) [m], with the body at rest."""
    points = np.concatenate([bodies.points[j] for j in members])
    part = np.concatenate([bodies.part[j] for j in members])
    outward = np.concatenate([bodies.outward[j] for j in members])
    hidden = np.zeros(len(points), dtype=bool)
    for k in np.unique(part):
        own = part == k
        level = np.einsum("ni,ni->n", points[own], outward[own])
        hidden[~own] |= (points[~own] @ outward[own].T < level).all(axis=1)
    return points if hidden.all() else points[~hidden]


def _edges(bodies: Bodies, groups: list[Group]) -> tuple[tuple[int, int], ...]:
    owner = {j: k for k, group in enumerate(groups) for j in group.members}
    pairs = [
        (owner[int(bodies.parent[g.members[0]])], k) for k, g in enumerate(groups) if bodies.parent[g.members[0]] >= 0
    ]
    return tuple(sorted((min(pair), max(pair)) for pair in pairs))


def _mirror(bodies: Bodies, limbs: list[Limb], frames: list[LimbFrame]) -> tuple[int, ...]:
    """Pairs by the links' names; limbs without one by where they are at rest."""
    mirror = mirror_parts([limb.name for limb in limbs])
    R, t = bodies.posed.rotations[bodies.root], bodies.posed.translations[bodies.root]
    ends = np.array([[f.t, f.t + f.length * f.R[:, 2]] for f in frames])
    ends = (ends - t) @ R
    for i in range(len(limbs)):
        for k in range(i + 1, len(limbs)):
            off = np.abs(ends[i] * np.array([1.0, -1.0, 1.0]) - ends[k]).max()
            if mirror[i] == i and mirror[k] == k and off < _SAME_PLACE * bodies.longest:
                mirror[i], mirror[k] = k, i
    return tuple(int(k) for k in mirror)


def _as_in(like: LimbGraph, bodies: Bodies, source: str) -> list[Group]:
    """The groups of another graph."""
    body_of_link = {link: j for j, links in enumerate(bodies.links) for link in links}
    groups = []
    for limb in like.limbs:
        missing = [link for link in limb.links if link not in body_of_link]
        if missing:
            remedy = "give a graph of the same subject, with whatever lengths"
            raise InputError(source, f"has no link {missing[0]!r}", place=f"limb {limb.name}", remedy=remedy)
        members = topmost_first(bodies, {body_of_link[link] for link in limb.links})
        groups.append(Group(tuple(members), body_of_link[limb.link], fixed=True, name=limb.name))
    return groups
