"""Masses of a body's segments: those of the URDF where it has them, else those of an adult by published regressions.

R. Dumas, L. Cheze, J.-P. Verriest, Adjustments to McConville et al. and Young et al. body segment inertial parameters,
J. Biomech. 40 (2007), table 2, with its corrigendum for head and neck: shares of the mass, centres and radii of
gyration by segment, women and men. What it has of both is averaged here; products of inertia are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import Flesh
from humanoid.support.per_object import per_object

ADULT = 65.0
"""[kg] A person of 1.70 m with a body mass index of 22.5."""


class Regression(NamedTuple):
    """A segment in its own axes: x forward, y from its `end` to its `start`, z to the right (of the left side:
    outwards is to the left).

    share: of the body's mass. start, end: points of `_points`, which define y and the length; centre (x, y, z) from
    `start`, radii of gyration (x, y, z) about it, both as shares of the length.
    """

    share: float
    start: str
    end: str
    centre: tuple[float, float, float]
    radii: tuple[float, float, float]


REGRESSIONS = {
    "head": Regression(0.0670, "neck_base", "head_top", (-0.0660, -0.5760, 0.0), (0.315, 0.260, 0.335)),
    "torso": Regression(0.3185, "neck_base", "lumbar_base", (-0.0260, -0.4280, 0.0), (0.280, 0.260, 0.285)),
    "pelvis": Regression(0.1440, "lumbar_base", "mid_hip", (0.0095, -0.2560, 0.0), (0.960, 1.030, 0.870)),
    "upper_arm": Regression(0.0230, "shoulder", "elbow", (0.0, -0.4530, 0.0), (0.320, 0.155, 0.325)),
    "forearm": Regression(0.0150, "elbow", "wrist", (0.0, -0.4140, 0.0), (0.270, 0.125, 0.260)),
    "hand": Regression(0.0055, "wrist", "fingertips", (0.0, -0.3420, 0.0), (0.265, 0.170, 0.245)),
    "thigh": Regression(0.1345, "hip", "knee", (-0.0590, -0.4030, 0.0210), (0.300, 0.170, 0.310)),
    "shank": Regression(0.0465, "knee", "ankle", (-0.0485, -0.4070, 0.0190), (0.280, 0.100, 0.280)),
    "foot": Regression(0.0110, "ankle", "ball", (0.0, -0.4395, 0.0), (0.250, 0.115, 0.250)),
}
"""Means of women and men, by link without its side. The torso is all between neck and lumbar joints. Arms and feet have
no offset from their axis: women and men differ in its sign. Of the foot, whose axis is y here, radii are in this
order."""
_PAIRED = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
_WHOLE = sum(each.share * (2.0 if name in _PAIRED else 1.0) for name, each in REGRESSIONS.items())
"""Sum of the rounded shares."""
_BALL_OF_FOOT = 0.72  # of the way from heel to toes
_HAND = 0.67  # length over the forearm's
LEAST = 1e-3
"""[kg] of a segment of unknown mass: OpenSim requires positive masses."""
_UNKNOWN = 1.0  # kg of each segment, where neither file nor names determine it
_BALL = 0.05  # m, radius of a segment without flesh


class Mass(NamedTuple):
    """mass [kg], centre (3,) [m], inertia (3, 3) about the centre [kg m2], in the frame of a joint."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray


def segment_masses(body: Body, whole: float = ADULT) -> tuple[dict[int, Mass], str]:
    """The mass that each joint carries itself, by its number (0 for what does not move), and where it comes from.
    whole [kg]: of a person, for a body whose URDF has no masses."""
    links = links_of(body)
    if has_own_masses(body):
        return {j: _of_file(body.model.inertias[j]) for j in links}, "Masses and inertias are those of the URDF."
    if not is_person(body):
        source = f"The URDF has no masses; every segment was given {_UNKNOWN:g} kg."
        return {j: _of_flesh(body, j, _UNKNOWN) for j in links}, source
    points = _points(body)
    source = (
        f"The URDF has no masses; they are shares of an adult of {whole:g} kg, with centres and radii of gyration of "
        "Dumas et al. 2007, mean of women and men: scale them to the person's weight before dynamics."
    )
    return {j: _of_person(body, j, names, points, whole) for j, names in links.items()}, source


def person_inertias(body: Body, whole: float = ADULT) -> list[pin.Inertia]:
    """Inertia of each joint's segment, in the order of the model's joints; whole [kg]: see `segment_masses`."""
    masses = segment_masses(body, whole)[0]
    carried = [masses.get(j) for j in range(body.model.njoints)]
    return [pin.Inertia.Zero() if m is None else pin.Inertia(m.mass, m.centre, m.inertia) for m in carried]


class MassPoints(NamedTuple):
    """Points that carry a body's mass: joint (M,) that each is fixed to, local (M, 3) [m] in its frame, share (M,) of
    the whole mass, which sum to one. from_urdf: whether the masses are the URDF's, not an adult's."""

    joint: np.ndarray
    local: np.ndarray
    share: np.ndarray
    from_urdf: bool


@per_object
def mass_points(body: Body) -> MassPoints | None:
    """The centres of mass of all segments; None for a body with segments of unknown mass."""
    from_urdf = has_own_masses(body)
    if not from_urdf and not is_person(body):
        return None
    masses = {j: mass for j, mass in segment_masses(body)[0].items() if mass.mass > LEAST}
    total = sum(mass.mass for mass in masses.values())
    share = np.array([mass.mass / total for mass in masses.values()])
    return MassPoints(np.array(list(masses)), np.array([mass.centre for mass in masses.values()]), share, from_urdf)


def has_own_masses(body: Body) -> bool:
    """Whether the URDF has the body's masses."""
    return bool(sum(inertia.mass for inertia in body.model.inertias) > 0.0)


def height_over_heels(body: Body, landmark: str) -> float | None:
    """Distance [m] of a landmark from the middle of the heels with all joints at zero, None for a body without them:
    of `head_top` it is a person's height, whichever way is up."""
    places = dict(zip(body.landmark_names, body.landmarks(body.at(pin.neutral(body.model))), strict=True))
    heels = [places[name] for name in ("left_heel", "right_heel") if name in places]
    if not heels or landmark not in places:
        return None
    return float(np.linalg.norm(places[landmark] - np.mean(heels, axis=0)))


def forward_of(body: Body) -> np.ndarray | None:
    """Unit vector (3,) of the way the feet point with all joints at zero, None without heels and toes."""
    forward = _points(body).get(_FORWARD)
    return None if forward is None else np.asarray(forward / np.linalg.norm(forward))


def is_person(body: Body) -> bool:
    """Whether links have the names of a person's segments."""
    return any(without_side(name) in REGRESSIONS for names in links_of(body).values() for name in names)


def links_of(body: Body) -> dict[int, list[str]]:
    """The links that each joint carries (those behind fixed joints too), by the joint's number, its own link first."""
    links: dict[int, list[str]] = {}
    for frame in body.model.frames:
        if frame.type == pin.FrameType.BODY and frame.name != "universe":
            links.setdefault(int(frame.parentJoint), []).append(frame.name)
    return links


def flesh_of(body: Body, joint: int) -> list[tuple[Flesh, pin.SE3]]:
    """The flesh that a joint carries, and where it lies in the joint's frame."""
    return _flesh_by_joint(body).get(joint, [])


@per_object
def _flesh_by_joint(body: Body) -> dict[int, list[tuple[Flesh, pin.SE3]]]:
    parts: dict[int, list[tuple[Flesh, pin.SE3]]] = {}
    for flesh in body.subject.flesh:
        frame = body.model.frames[body.model.getFrameId(flesh.link, pin.FrameType.BODY)]
        placed = frame.placement * pin.SE3(pin.rpy.rpyToMatrix(*flesh.rpy), np.array(flesh.xyz))
        parts.setdefault(int(frame.parentJoint), []).append((flesh, placed))
    return parts


def _of_file(inertia: pin.Inertia) -> Mass:
    if inertia.mass < LEAST:
        return Mass(LEAST, np.zeros(3), _ellipsoid(LEAST, (_BALL,) * 3))
    own = np.array(inertia.inertia)
    return Mass(float(inertia.mass), np.array(inertia.lever), own)


def _of_person(body: Body, joint: int, links: Sequence[str], points: Mapping[str, np.ndarray], whole: float) -> Mass:
    """The segments of a person that a joint carries; those without the points of their regression are spread evenly
    over their flesh."""
    total, placed = pin.Inertia.Zero(), body.at(pin.neutral(body.model)).placements[joint]
    R_world_joint, origin = placed[:9].reshape(3, 3).T, placed[9:12]
    for link in links:
        regression = REGRESSIONS.get(name := without_side(link))
        if regression is None:
            continue
        side, mass = link.removesuffix(name), whole * regression.share / _WHOLE
        start, end = (points.get(point, points.get(side + point)) for point in (regression.start, regression.end))
        if start is None or end is None or np.linalg.norm(start - end) < _SHORTEST:
            total += pin.Inertia(*_of_flesh(body, joint, mass))
            continue
        axes = _axes(start - end, points.get(_FORWARD), side)
        length = float(np.linalg.norm(start - end))
        ahead, up, aside = regression.centre if _FORWARD in points else (0.0, regression.centre[1], 0.0)
        centre = start + length * axes @ [ahead, up, aside]
        square = np.square(length * np.array(regression.radii))
        own = mass * R_world_joint.T @ axes @ np.diag(square) @ axes.T @ R_world_joint
        total += pin.Inertia(mass, R_world_joint.T @ (centre - origin), own)
    return _of_file(total)


_FORWARD = "forward"
_SHORTEST = 0.01  # m: of a segment that has a direction


def _points(body: Body) -> dict[str, np.ndarray]:
    """Places (3,) [m] in the world of the points that segments are measured by, with all joints at zero, and the
    direction `_FORWARD`, in which the feet point; what a body does not have is left out."""
    posed = body.at(pin.neutral(body.model))
    points = dict(zip(body.landmark_names, body.landmarks(posed), strict=True))
    for name, link, before in (("lumbar_base", "torso", "pelvis"), ("neck_base", "head", "torso")):
        if (joint := _first_joint(body, link, before)) is not None:
            points[name] = posed.placements[joint, 9:12]
    for side in ("left_", "right_"):
        heel, toes = points.get(f"{side}heel"), points.get(f"{side}big_toe")
        if heel is not None and toes is not None:
            toes = 0.5 * (toes + points.get(f"{side}small_toe", toes))
            points[f"{side}ball"] = heel + _BALL_OF_FOOT * (toes - heel)
            points[_FORWARD] = points.get(_FORWARD, 0.0) + toes - heel
        elbow, wrist = points.get(f"{side}elbow"), points.get(f"{side}wrist")
        if elbow is not None and wrist is not None:
            points[f"{side}fingertips"] = wrist + _HAND * (wrist - elbow)
    return points


def _first_joint(body: Body, link: str, before: str) -> int | None:
    """The joint nearest to the link `before` of those between it and a link."""
    joints = {name: j for j, names in links_of(body).items() for name in names}
    if link not in joints or before not in joints:
        return None
    joint, parents = joints[link], body.model.parents
    while joint and parents[joint] != joints[before]:
        joint = int(parents[joint])
    return joint or None


def _axes(y: np.ndarray, forward: np.ndarray | None, side: str) -> np.ndarray:
    """R_world_segment (3, 3): y along a vector, x as far forward as it can be, z to the right, or of a left segment to
    the left; without a forward direction x and z are any."""
    y = y / np.linalg.norm(y)
    ahead = np.eye(3)[np.argmin(np.abs(y))] if forward is None else forward
    x = ahead - (ahead @ y) * y
    if np.linalg.norm(x) < 1e-6 * np.linalg.norm(ahead):
        return _axes(y, None, side)
    x /= np.linalg.norm(x)
    z = np.cross(x, y)
    return np.column_stack([x, y, -z if side == "left_" else z])


def _of_flesh(body: Body, joint: int, mass: float) -> Mass:
    """A mass spread evenly over the joint's flesh, every part as an ellipsoid of its half-axes."""
    mass, parts = max(mass, LEAST), flesh_of(body, joint)
    if not parts:
        return Mass(mass, np.zeros(3), _ellipsoid(mass, (_BALL,) * 3))
    radii = [_half_axes(flesh) for flesh, _ in parts]
    masses = mass * np.prod(radii, axis=1) / np.prod(radii, axis=1).sum()
    centres = np.array([placed.translation for _, placed in parts])
    centre = masses @ centres / mass
    inertia = np.zeros((3, 3))
    for own, size, place, (_, placed) in zip(masses, radii, centres - centre, parts, strict=True):
        inertia += placed.rotation @ _ellipsoid(own, size) @ placed.rotation.T
        inertia += own * (place @ place * np.eye(3) - np.outer(place, place))
    return Mass(mass, centre, inertia)


def _half_axes(flesh: Flesh) -> tuple[float, float, float]:
    if flesh.shape == "capsule":
        return flesh.size[0], flesh.size[0], flesh.size[0] + 0.5 * flesh.size[1]
    return flesh.size


def _ellipsoid(mass: float, radii: Sequence[float]) -> np.ndarray:
    """Inertia (3, 3) of an even ellipsoid about its centre [kg m2]."""
    square = np.square(radii)
    return np.diag(mass / 5.0 * (square.sum() - square))
