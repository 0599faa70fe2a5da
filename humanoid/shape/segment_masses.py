"""Masses of a body's segments: those of the URDF where it has them, else those of an adult."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import Flesh
from humanoid.support.per_object import per_object

ADULT = 65.0
"""[kg] A person of 1.70 m with a body mass index of 22.5."""
SHARES = {
    "pelvis": 0.1182, "lumbar_flexion_link": 0.1549, "torso": 0.15705, "head": 0.0681, "upper_arm": 0.0263,
    "forearm": 0.0150, "hand": 0.00585, "thigh": 0.1447, "shank": 0.0457, "foot": 0.0133,
}  # fmt: skip
"""Shares of the body's mass, by link without its side: P. de Leva, J. Biomech. 29 (1996), table 4, mean of women and
men; the lower, middle and upper parts of the trunk are `pelvis`, `lumbar_flexion_link` and `torso`."""
LEAST = 1e-3
"""[kg] of a segment of unknown mass: OpenSim requires positive masses."""
_UNKNOWN = 1.0  # kg of each segment, where neither file nor names determine it
_BALL = 0.05  # m, radius of a segment without flesh


class Mass(NamedTuple):
    """mass [kg], centre (3,) [m], inertia (3, 3) about the centre [kg m2], in the frame of a joint."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray


def segment_masses(body: Body) -> tuple[dict[int, Mass], str]:
    """The mass that each joint carries itself, by its number (0 for what does not move), and where it comes from."""
    links = links_of(body)
    if has_own_masses(body):
        return {j: _of_file(body.model.inertias[j]) for j in links}, "Masses and inertias are those of the URDF."
    shares = {j: sum(SHARES.get(without_side(name), 0.0) for name in names) for j, names in links.items()}
    if not any(shares.values()):
        source = f"The URDF has no masses; every segment was given {_UNKNOWN:g} kg."
        return {j: _of_flesh(body, j, _UNKNOWN) for j in links}, source
    source = (
        f"The URDF has no masses; they are shares of an adult of {ADULT:g} kg (de Leva 1996, mean of women and men), "
        "spread evenly over ellipsoids as large as the flesh: scale them to the person's weight before dynamics."
    )
    return {j: _of_flesh(body, j, ADULT * share) for j, share in shares.items()}, source


class MassPoints(NamedTuple):
    """Points that carry a body's mass: joint (M,) that each is fixed to, local (M, 3) [m] in its frame, share (M,) of
    the whole mass, which sum to one. from_urdf: whether the masses are the URDF's, not an adult's."""

    joint: np.ndarray
    local: np.ndarray
    share: np.ndarray
    from_urdf: bool


@per_object
def mass_points(body: Body) -> MassPoints | None:
    """The centres of mass of all segments: with an adult's shares and the flesh's centres that of the whole body is 11
    mm from the centre of pressure of a person who stands still, and 7 +- 15 mm in squats (force plates of OpenCap's
    subject 4). None for a body with segments of unknown mass."""
    from_urdf = has_own_masses(body)
    if not from_urdf and not any(without_side(name) in SHARES for names in links_of(body).values() for name in names):
        return None
    masses = {j: mass for j, mass in segment_masses(body)[0].items() if mass.mass > LEAST}
    total = sum(mass.mass for mass in masses.values())
    share = np.array([mass.mass / total for mass in masses.values()])
    return MassPoints(np.array(list(masses)), np.array([mass.centre for mass in masses.values()]), share, from_urdf)


def has_own_masses(body: Body) -> bool:
    """Whether the URDF has the body's masses."""
    return bool(sum(inertia.mass for inertia in body.model.inertias) > 0.0)


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
