"""Rigid parts mirrored in depth: trunk, head, shoulder girdles, hands, and the whole of a free body."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.numerics.alignment import rotation_onto
from estimator.numerics.vectors import cross, furthest
from estimator.search.jumps.anatomy import Anatomy, RigidPart, TwoSegmentLimb
from estimator.search.jumps.angles import part_turns
from estimator.search.jumps.limb_solutions import (
    REACHED,
    ROUGHLY,
    LimbSolution,
    PoseOnRays,
    limb_solutions,
    moved_to,
    turned,
)
from estimator.search.jumps.subproblems import axes_of, meeting_point, other_depths
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_TURN_Q, Body
from humanoid.support.compiled import jit


def part_mirrored(body: Body, anatomy: Anatomy, on_rays: PoseOnRays, part: RigidPart) -> PoseOnRays | None:
    """A part whose landmarks are at their other depths about its pivot, as nearly as a rigid part within limits can.

    What is behind it goes along, except that parts of other landmarks (the head behind the trunk) are turned back.
    Limbs are left off their rays. None where the part cannot get there, or would hardly move.
    """
    pivot, before = _pivot(on_rays, part), on_rays.points[part.landmarks]
    targets = np.empty_like(before)
    other_depths(on_rays.eyes[part.landmarks], on_rays.rays[part.landmarks], before, pivot, targets)
    if furthest(targets, before) < anatomy.same:
        return None
    mirrored = _turned_to(body, on_rays, part, targets)
    after = mirrored.points[part.landmarks]
    if furthest(after, targets) > REACHED or furthest(after, before) < anatomy.same:
        return None
    for k in part.behind:
        other = anatomy.parts[k]
        if not set(other.landmarks.tolist()) & set(part.landmarks.tolist()):
            shift = _pivot(mirrored, other) - _pivot(on_rays, other)
            mirrored = _turned_to(body, mirrored, other, on_rays.points[other.landmarks] + shift)
    return mirrored


def with_limbs_on_rays(
    body: Body, anatomy: Anatomy, on_rays: PoseOnRays, part: RigidPart, before: PoseOnRays
) -> np.ndarray:
    """The pose (nq,) with the limbs behind a part that was turned back on their rays, as near to where they are as a
    solution within reach is; those about whose roots it turned, to where they were before."""
    q = on_rays.q
    for k in part.limbs:
        limb = anatomy.limbs[k]
        stays = int(limb.landmarks[0]) in part.about
        solutions = [
            (s.error > REACHED, furthest(_reached(body, on_rays, limb, s), before.points[limb.landmarks]), s)
            if stays
            else (s.error > REACHED, s.moved, s)
            for s in limb_solutions(body, on_rays, limb, ROUGHLY)
        ]
        if solutions:
            q = turned(body, q, limb.dofs, min(solutions, key=lambda entry: entry[:2])[2].turns)
    return q


def _reached(body: Body, on_rays: PoseOnRays, limb: TwoSegmentLimb, solution: LimbSolution) -> np.ndarray:
    """Landmarks (3, 3) of a limb in a solution [m]."""
    return body.landmarks(body.at(turned(body, on_rays.q, limb.dofs, solution.turns)))[limb.landmarks]


def _turned_to(body: Body, on_rays: PoseOnRays, part: RigidPart, targets: np.ndarray) -> PoseOnRays:
    """The pose with a part turned as near to targets (k, 3) [m] of its landmarks as its limits allow."""
    pivot, points = _pivot(on_rays, part), on_rays.points[part.landmarks]
    turn = _rotation(points - pivot, targets - pivot)
    if len(part.dofs) == 0:
        return moved_to(body, on_rays, _root_turned(on_rays.q, turn, pivot))
    axes, through = axes_of(on_rays.spatial_jacobian, part.dofs)
    lower, upper = body.tangent_bounds(on_rays.q)
    turns = np.zeros(len(part.dofs))
    rays = on_rays.rays[part.landmarks]
    part_turns(axes, through, points, pivot, turn, targets, rays, lower[part.dofs], upper[part.dofs], turns)
    return moved_to(body, on_rays, turned(body, on_rays.q, part.dofs, turns))


def _pivot(on_rays: PoseOnRays, part: RigidPart) -> np.ndarray:
    if len(part.dofs) == 0:
        return np.asarray(on_rays.points[list(part.about) or part.landmarks].mean(axis=0))
    return np.asarray(meeting_point(*axes_of(on_rays.spatial_jacobian, part.dofs)))


def _rotation(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that brings vectors (k, 3) nearest to others; the smallest where one direction is all there
    is."""
    axis = np.zeros((1, 3))
    _add_axes(before, after, axis[0])
    axis *= 1e-3
    return rotation_onto(np.concatenate((before, axis)), np.concatenate((after, axis)))


@jit
def _add_axes(before, after, axis):  # type: ignore[no-untyped-def]
    """Add to axis (3,) the vector products of vectors before and after (k, 3)."""
    for i in range(before.shape[0]):
        x, y, z = cross(before[i], after[i])
        axis[0] += x
        axis[1] += y
        axis[2] += z


def _root_turned(q: np.ndarray, turn: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """q (nq,) of a free body turned as a whole by `turn` (3, 3) about a point (3,) [m]."""
    q = q.copy()
    q[ROOT_PLACE_Q] = turn @ (q[ROOT_PLACE_Q] - pivot) + pivot
    q[ROOT_TURN_Q] = pin.Quaternion(turn @ pin.Quaternion(q[ROOT_TURN_Q]).matrix()).coeffs()
    return q
