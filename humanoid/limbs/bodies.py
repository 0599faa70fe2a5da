"""The rigid bodies of a subject at rest: their links and surface, where their joints turn, which joints act as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.shape.surface import Surface

ONE_JOINT = 0.08
"""Share of the longest body: axes that pass this near to a point turn about it, such as those of a robot's hip."""
_MOST_AXES = 3  # of a ball joint
_PULL = 1e-6  # of a joint's own place on its axis, where parallel axes leave open where they meet


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies that joints move, with the world as body 0, at rest (`Body.neutral`), in the world's frame.

    posed: the rest pose. parent (J,): the body on the other side of each body's joint, -1 for the root; -2 for the
    world where it has no surface and is nothing: what hangs on it hangs on its largest child then. hung (J,) bool: the
    bodies that do so, though that does not move them.
    links: of each body. points: the surface's nodes of each body [m], (N_j, 3). part: the surface's part of each node.
    outward: unit normals of the nodes. area: the number of nodes of every link.
    unit (J,): bodies whose joints act as one have the same; it is the outermost of them.
    pivot (J, 3): where the joint of a body turns [m], for joints that act as one the point where their axes meet.
    freedom (J,): degrees of freedom between a body's unit and what the unit hangs on.
    longest: the length of the longest body [m].
    """

    posed: PosedBody
    parent: np.ndarray
    hung: np.ndarray
    links: tuple[tuple[str, ...], ...]
    points: tuple[np.ndarray, ...]
    part: tuple[np.ndarray, ...]
    outward: tuple[np.ndarray, ...]
    area: dict[str, int]
    unit: np.ndarray
    pivot: np.ndarray
    freedom: np.ndarray
    longest: float

    @property
    def root(self) -> int:
        """The body that hangs on none."""
        return int(np.flatnonzero(self.parent == -1)[0])

    def length(self, members: list[int]) -> float:
        """Length of connected bodies that are one, the topmost first [m]."""
        return _length(members, np.where(self.hung, -2, self.parent), self.pivot, self.points)

    def size(self, members: list[int]) -> int:
        """Nodes on some bodies."""
        return sum(len(self.points[j]) for j in members)


def bodies_of(body: Body, surface: Surface) -> Bodies:
    """The bodies of a subject covered by `surface`.

    Joints that follow each other act as one where the bodies between them carry nothing else and all their axes pass a
    point within `ONE_JOINT`: the three of a hip or a shoulder, an elbow and the turn of the forearm; three at most.
    """
    posed = body.at(body.neutral)
    links: list[list[str]] = [[] for _ in range(body.njoints)]
    for frame in body.model.frames:
        if frame.type == pin.FrameType.BODY and frame.name != "universe":
            links[frame.parentJoint].append(frame.name)
    world = points_in_world(posed, surface.joint, surface.local)
    outward = np.einsum("nij,nj->ni", posed.rotations[surface.joint], surface.normal)
    own = [surface.joint == j for j in range(body.njoints)]
    points, part, normals = ([x[mine] for mine in own] for x in (world, surface.part, outward))
    area = dict.fromkeys((name for names in links for name in names), 0)
    for k, link in enumerate(surface.links):
        area[link] += int(np.count_nonzero(surface.part == k))
    parent, hung = _hung(body.tree.joint_parent, [len(p) for p in points])
    joined = np.where(hung, -2, parent)
    longest = max(_length([j], joined, posed.translations, points) for j in range(body.njoints) if len(points[j]))
    unit, pivot = _units(body, posed, joined, ONE_JOINT * longest)
    freedom = np.bincount(unit[body.tree.column_joint], minlength=body.njoints)[unit]
    names, covered = tuple(map(tuple, links)), (tuple(points), tuple(part), tuple(normals))
    return Bodies(posed, parent, hung, names, *covered, area, unit, pivot, freedom, longest)


def _hung(joint_parent: np.ndarray, nodes: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """`Bodies.parent` and `Bodies.hung`."""
    parent, hung = joint_parent.copy(), np.zeros(len(joint_parent), dtype=bool)
    parent[0] = -1
    if nodes[0] == 0:  # the world is not a body
        children = 1 + np.flatnonzero(joint_parent[1:] == 0)
        largest = int(max(children, key=lambda j: nodes[j]))
        parent[children], parent[0] = largest, -2
        parent[largest] = -1
        hung[children] = children != largest
    return parent, hung


def _length(members: list[int], parent: np.ndarray, pivot: np.ndarray, points: Sequence[np.ndarray]) -> float:
    """Length of a body of several [m]: from its joint to the farthest joint on it, or twice the distance to the middle
    of its surface, as for a rod; the root, which has no joint, also from any of its joints to any other."""
    top, inside = members[0], set(members)
    ends = [pivot[k] for k in range(len(parent)) if k not in inside and int(parent[k]) in inside]
    starts = [pivot[top], *(ends if parent[top] == -1 else [])]
    own = np.concatenate([points[j] for j in members])
    if len(own):
        ends.append(2.0 * own.mean(axis=0) - pivot[top])
    return max((float(np.linalg.norm(a - b)) for a in starts for b in ends), default=0.0)


def _units(body: Body, posed: PosedBody, parent: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """`Bodies.unit` and `Bodies.pivot`."""
    unit, pivot = np.arange(body.njoints), posed.translations.copy()
    children = [int(np.count_nonzero(parent == j)) for j in range(body.njoints)]
    runs: dict[int, list[int]] = {}  # by the last body of each
    for j in range(1, body.njoints):
        axis = _axis(body, posed, j)
        if axis is None:
            continue
        run = runs.get(int(parent[j]), []) if parent[j] >= 0 else []
        if 0 < len(run) < _MOST_AXES and children[parent[j]] == 1:
            point, off = _meeting([*(_axis(body, posed, k) for k in run), axis], posed.translations[[*run, j]])
            if off < near:
                run = [*run, j]
                unit[run], pivot[run] = j, point
                runs[j] = run
                continue
        runs[j] = [j]
    return unit, pivot


def _axis(body: Body, posed: PosedBody, joint: int) -> np.ndarray | None:
    """The axis (6,) of a joint that turns about a line: the line's unit vector, a point of it; None for any other."""
    columns = np.flatnonzero(body.tree.column_joint == joint)
    if len(columns) != 1:
        return None
    linear, angular = posed.spatial_jacobian[columns[0], :3], posed.spatial_jacobian[columns[0], 3:]
    size = float(np.linalg.norm(angular))
    if size < 1e-9:
        return None
    return np.concatenate([angular / size, np.cross(angular, linear) / size**2])


def _meeting(axes: list[np.ndarray | None], origins: np.ndarray) -> tuple[np.ndarray, float]:
    """The point (3,) nearest to all axes, and its largest distance from any [m]."""
    A, b = _PULL * len(axes) * np.eye(3), _PULL * origins.sum(axis=0)
    for line in axes:
        assert line is not None
        across = np.eye(3) - np.outer(line[:3], line[:3])
        A, b = A + across, b + across @ line[3:]
    point = np.linalg.solve(A, b)
    return point, max(float(np.linalg.norm(np.cross(x[:3], point - x[3:]))) for x in axes if x is not None)
