"""The solutions of one limb's inverse kinematics on its rays: the depths its two segments can have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.search.jumps.anatomy import TwoSegmentLimb
from estimator.search.jumps.angles import limb_alternatives
from estimator.search.jumps.lines import axes_of
from estimator.search.jumps.pose_on_rays import PoseOnRays
from humanoid.kinematics.body import Body

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
    """What the limb can be on its rays: up to four solutions that its joints reach within `near` [m]."""
    axes, through = axes_of(on_rays.spatial_jacobian, limb.dofs)
    lower, upper = body.tangent_bounds(on_rays.q)
    points = on_rays.points[limb.landmarks]
    turns, errors, reached = np.zeros((4, len(limb.dofs))), np.zeros(4), np.zeros((4, 2, 3))
    eyes, rays = on_rays.eyes[limb.landmarks[1:]], on_rays.rays[limb.landmarks[1:]]
    limb_alternatives(
        axes, through, points, limb.counts, eyes, rays, lower[limb.dofs], upper[limb.dofs], turns, errors, reached
    )
    off = reached - eyes
    missed = np.sqrt((np.square(off).sum(axis=2) - np.square((off * rays).sum(axis=2)).clip(0.0)).clip(0.0).max(axis=1))
    moved = np.sqrt(np.square(reached - points[1:]).sum(axis=2).max(axis=1))
    distinct: list[int] = []
    for k in np.argsort(errors, kind="stable"):
        if errors[k] < near and all(np.abs(reached[k] - reached[i]).max() > SAME_PLACE for i in distinct):
            distinct.append(int(k))
    return [LimbSolution(turns[k], float(missed[k]), float(moved[k])) for k in sorted(distinct)]
