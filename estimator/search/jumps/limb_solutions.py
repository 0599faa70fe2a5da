"""The solutions of one limb's inverse kinematics on the lines of sight of its landmarks: the depths its two segments
can have.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.numerics.vectors import dot, plus
from estimator.search.jumps.anatomy import TwoSegmentLimb
from estimator.search.jumps.angles import limb_alternatives
from estimator.search.jumps.subproblems import axes_of
from humanoid.kinematics.body import Body
from humanoid.support.compiled import jit


class PoseOnRays(NamedTuple):
    """A pose and the rays its landmarks are to stay on.

    q (nq,); points (L, 3) [m]: its landmarks; spatial_jacobian (nv, 6): see `Body.dof_jacobian`; eyes (L, 3) [m]: a
    point of each ray, the optical centre unless the camera is parallel; rays (L, 3): unit vectors along them, away from
    the camera, of the first pose.
    """

    q: np.ndarray
    points: np.ndarray
    spatial_jacobian: np.ndarray
    eyes: np.ndarray
    rays: np.ndarray


def pose_on_rays(body: Body, q: np.ndarray, camera: Camera) -> PoseOnRays:
    """q (nq,) and the rays of the camera on which its landmarks are."""
    posed = body.at(q)
    points = body.landmarks(posed)
    return PoseOnRays(q, points, body.dof_jacobian(posed), *camera.sight_lines(points))


def moved_to(body: Body, on_rays: PoseOnRays, q: np.ndarray) -> PoseOnRays:
    """Another pose (nq,) that is to be on the same rays."""
    posed = body.at(q)
    return on_rays._replace(q=q, points=body.landmarks(posed), spatial_jacobian=body.dof_jacobian(posed))


def turned(body: Body, q: np.ndarray, dofs: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """q (nq,) with some degrees of freedom (m,) turned by `turns` (m,) [rad], limits kept."""
    step = np.zeros(body.nv)
    step[dofs] = turns
    return body.integrate(q, step)


REACHED = 0.06  # m; near enough to be refined by the mode search
ROUGHLY = 0.25  # m; where a limb that takes another's place may start its search from
SAME_PLACE = 0.01  # m; two solutions that limits bring this near to each other are one


class LimbSolution(NamedTuple):
    """A limb on its rays: turns (m,) [rad] of its joints, the largest distance [m] of its middle and end from their
    rays, and by how much they move at most [m]."""

    turns: np.ndarray
    error: float
    moved: float


def limb_solutions(body: Body, on_rays: PoseOnRays, limb: TwoSegmentLimb, near: float = REACHED) -> list[LimbSolution]:
    """The limb's poses on its rays: up to four solutions that its joints reach within `near` [m]."""
    axes, through = axes_of(on_rays.spatial_jacobian, limb.dofs)
    lower, upper = body.tangent_bounds(on_rays.q)
    points = on_rays.points[limb.landmarks]
    turns, errors, reached = np.zeros((4, len(limb.dofs))), np.zeros(4), np.zeros((4, 2, 3))
    eyes, rays = on_rays.eyes[limb.landmarks[1:]], on_rays.rays[limb.landmarks[1:]]
    limb_alternatives(
        axes, through, points, limb.counts, eyes, rays, lower[limb.dofs], upper[limb.dofs], turns, errors, reached
    )
    missed, moved, chosen = np.zeros(4), np.zeros(4), np.zeros(4, dtype=np.bool_)
    _choose(reached, errors, eyes, rays, points[1:], near, missed, moved, chosen)
    return [LimbSolution(turns[k], float(missed[k]), float(moved[k])) for k in np.flatnonzero(chosen).tolist()]


@jit
def _choose(reached, errors, eyes, rays, points, near, missed, moved, chosen):  # type: ignore[no-untyped-def]
    """Mark in chosen (4,) which of four alternatives, reached (4, 2, 3), errors (4,), have an error below `near`, the
    best of each place; fill missed (4,) [m], how far they are from the rays, eyes, rays (2, 3), and moved (4,) [m], how
    far from points (2, 3)."""
    for k in range(4):
        for i in range(2):
            off = plus(reached[k, i], -1.0, eyes[i])
            along = dot(off, rays[i])
            missed[k] = max(missed[k], math.sqrt(max(dot(off, off) - along * along, 0.0)))
            way = plus(reached[k, i], -1.0, points[i])
            moved[k] = max(moved[k], math.sqrt(dot(way, way)))
    for k in np.argsort(errors, kind="mergesort"):
        new = errors[k] < near
        for other in range(4):
            if chosen[other] and np.abs(reached[k] - reached[other]).max() <= SAME_PLACE:
                new = False
        chosen[k] = new
