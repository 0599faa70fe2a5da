"""The readings of one limb: the depths its two segments can have on their rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.cameras.camera import Camera
from estimator.search.jumps.anatomy import Limb
from estimator.search.jumps.angles import axes_of, limb_alternatives
from humanoid.kinematics.body import Body

REACHED = 0.06  # m; near enough to be refined by the mode search
ROUGHLY = 0.25  # m; where a limb that takes another's place may start its search from
SAME_PLACE = 0.01  # m; two readings that limits bring this near to each other are one


class Sight(NamedTuple):
    """A pose and the rays its landmarks are to stay on.

    q (nq,); points (L, 3) [m]: its landmarks; spatial_jacobian (nv, 6): see `PosedBody`; eye (3,) [m]; rays (L, 3):
    unit vectors from the eye, of the pose first looked at.
    """

    q: np.ndarray
    points: np.ndarray
    spatial_jacobian: np.ndarray
    eye: np.ndarray
    rays: np.ndarray


class Reading(NamedTuple):
    """A limb on its rays: turns (m,) [rad] of its joints, the largest distance [m] of its middle and end from their
    rays, and by how much they move at most [m]."""

    turns: np.ndarray
    error: float
    moved: float


def sight_of(body: Body, q: np.ndarray, camera: Camera) -> Sight:
    """q (nq,) and the rays of the camera on which its landmarks are."""
    posed = body.at(q)
    points, eye = body.landmarks(posed), camera.centre_world
    rays = points - eye
    return Sight(q, points, posed.spatial_jacobian, eye, rays / np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None])


def moved_to(body: Body, sight: Sight, q: np.ndarray) -> Sight:
    """Another pose (nq,) that is to be on the same rays."""
    posed = body.at(q)
    return sight._replace(q=q, points=body.landmarks(posed), spatial_jacobian=posed.spatial_jacobian)


def turned(body: Body, q: np.ndarray, dofs: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """q (nq,) with some degrees of freedom (m,) turned by `turns` (m,) [rad], limits kept."""
    step = np.zeros(body.nv)
    step[dofs] = turns
    return body.integrate(q, step)


def limb_readings(body: Body, sight: Sight, limb: Limb, near: float = REACHED) -> list[Reading]:
    """What the limb can be on its rays: up to four readings that its joints reach within `near` [m]."""
    axes, through = axes_of(sight.spatial_jacobian, limb.dofs)
    lower, upper = body.tangent_bounds(sight.q)
    points = sight.points[limb.landmarks]
    turns, errors, reached = np.zeros((4, len(limb.dofs))), np.zeros(4), np.zeros((4, 2, 3))
    rays = sight.rays[limb.landmarks[1:]]
    limb_alternatives(
        axes, through, points, limb.counts, sight.eye, rays, lower[limb.dofs], upper[limb.dofs], turns, errors, reached
    )
    off = reached - sight.eye
    missed = np.sqrt((np.square(off).sum(axis=2) - np.square((off * rays).sum(axis=2)).clip(0.0)).clip(0.0).max(axis=1))
    moved = np.sqrt(np.square(reached - points[1:]).sum(axis=2).max(axis=1))
    kept: list[int] = []
    for k in np.argsort(errors, kind="stable"):
        if errors[k] < near and all(np.abs(reached[k] - reached[i]).max() > SAME_PLACE for i in kept):
            kept.append(int(k))
    return [Reading(turns[k], float(missed[k]), float(moved[k])) for k in sorted(kept)]
