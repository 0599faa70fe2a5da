"""The frame of a limb at rest: from its proximal joint to its distal joint, its section's main axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid.limbs.bodies import Bodies
from humanoid.limbs.merging import Group

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
