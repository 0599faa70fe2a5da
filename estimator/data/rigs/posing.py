"""A rig whose points are a body's: poses to begin with, the rig that fits best with them, and how sure it is."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from estimator.data.rigs.bundle import SIZE_KNOWN, RigRays, RigState, RigUncertainty, adjusted
from estimator.data.rigs.first import triangulated
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.person import FilmedBody, PersonProblem, PersonSystem
from estimator.data.rigs.search import RigFit, lasting
from estimator.numerics.alignment import similarity_onto
from estimator.numerics.newton import Damping, NewtonSettings, descend
from humanoid.kinematics.body import Body, PosedBody
from humanoid.kinematics.proportions import ProportionedBody

_POINT = 0.05  # m: of the points that poses begin from
_REST = 1.0  # rad: of joints beside their neutral position, there
_LEAST_GAIN = 1e-4  # of the cost
_DAMPING = Damping(first=1e-3, least=1e-7, most=1e5, growth=6.0, shrink=1.0 / 6.0)
_ALL = NewtonSettings(40, _DAMPING, share=_LEAST_GAIN, count_taken=True)
_ONE = NewtonSettings(30, replace(_DAMPING, first=1e-2, least=1e-6), share=_LEAST_GAIN)  # pose by itself
_FAR = 0.15  # m from the points, in the middle, of unusable poses
_FEWEST = 8  # joints of an instant from which it is posed
_HELD = 1e9  # precision of a joint at its limit
_TINY = 1e-6
_NearPoints: TypeAlias = tuple[PosedBody, np.ndarray]  # a pose, and how far its landmarks are off the points (J, 3) [m]


def posed_rig(body: Body, fit: RigFit, lengths: SegmentLengths) -> RigFit:
    """The rig that fits best with a body in place of points, near one that fits points; that one of a body that does
    not go freely, or is not posed as the points are."""
    if not body.has_free_root:
        return fit
    size = lengths.size(fit.state.points)
    q, posed = _poses(body, fit.state.points / size, lengths)
    if np.count_nonzero(posed) < len(posed) // 2:
        return fit
    some = np.flatnonzero(posed)
    seen = replace(
        fit.rays,
        rays=(fit.rays.rays + fit.rays.slope * fit.state.late[:, None, None, None])[:, some],
        slope=fit.rays.slope[:, some],
        late_std=np.zeros_like(fit.late),
    )
    proportioned = ProportionedBody(body.subject)
    problem = PersonProblem(proportioned, seen, lengths)
    marks = np.zeros((len(lengths.landmark), 3))
    begun = FilmedBody(replace(fit.state, t=fit.state.t / size), q[some], proportioned.mean.copy(), marks)
    best = descend(begun, problem.cost, problem.system, partial(_step, problem), _ALL).model.state
    unsure = lasting(_uncertainty(problem, best), fit.instants)
    unsure = replace(unsure, late_std=fit.unsure.late_std)
    return replace(fit, state=_with_points(best.rig, fit.rays, lengths), unsure=unsure)


def _with_points(rig: RigState, seen: RigRays, lengths: SegmentLengths) -> RigState:
    """The rig with the points that it sees, scaled to the subject."""
    points = triangulated(rig.straight(seen.rays), rig.R, rig.t, range(len(rig.R)))
    none = np.zeros(len(rig.R))
    known = replace(seen, focal_std=none, radial_std=none, late_std=none)
    points = adjusted(replace(rig, points=points), known, lengths, free=()).state.points
    size = lengths.size(points)
    return replace(rig, t=rig.t / size, points=points / size)


def _reduced(problem: PersonProblem, at: FilmedBody, system: PersonSystem, damping: float) -> tuple[np.ndarray, ...]:
    """Inverses of the poses' Hessians (T, nv, nv), and what is left of the common Hessian and gradient without them."""
    H = system.H.copy()
    diagonal = np.einsum("tvv->tv", H)
    diagonal *= 1.0 + damping
    diagonal += _TINY + _HELD * problem.held(at.q, system.h)
    inverse = np.linalg.inv(H)
    gain = system.B @ inverse
    A = system.A + damping * np.diag(np.diagonal(system.A)) + _TINY * np.eye(len(system.A))
    return inverse, A - np.einsum("tsv,tkv->sk", gain, system.B), system.g - np.einsum("tsv,tv->s", gain, system.h)


def _step(problem: PersonProblem, at: FilmedBody, system: PersonSystem, damping: float) -> FilmedBody:
    inverse, A, g = _reduced(problem, at, system, damping)
    common = -np.linalg.solve(A, g)
    poses = -np.einsum("tvw,tw->tv", inverse, system.h + np.einsum("tsv,s->tv", system.B, common))
    return problem.moved(at, common, poses)


def _uncertainty(problem: PersonProblem, at: FilmedBody) -> RigUncertainty:
    """As `estimator.data.rigs.bundle.RigProblem.uncertainty`; clocks are unknown here."""
    system, column = problem.system(at), problem.places
    inverse, A, _ = _reduced(problem, at, system, 0.0)
    size = problem.size_slope(at)
    covariance = np.linalg.inv(A + SIZE_KNOWN * np.outer(size, size))
    biases = covariance[column[column >= 0]] @ problem.pulls(at, system, inverse)
    radial = problem.radial_std(covariance)
    return RigUncertainty.of(column, covariance, biases, np.zeros(len(column)), radial)


def _poses(body: Body, points: np.ndarray, lengths: SegmentLengths) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, nq) nearest to points (T, J, 3) [m], and which of them are near (T,)."""
    q, posed = np.tile(body.neutral, (len(points), 1)), np.zeros(len(points), dtype=bool)
    last: np.ndarray | None = None
    for t, own in enumerate(points):
        known = np.isfinite(own).all(axis=1)
        if np.count_nonzero(known) < _FEWEST:
            continue
        starts = [_turned(body, own, known, lengths), *([] if last is None else [last])]
        tries = [_posed(body, start, own[known], lengths.landmark[known]) for start in starts]
        q[t], off = min(tries, key=lambda pair: pair[1])
        posed[t] = off < _FAR
        last = q[t] if posed[t] else last
    return q, posed


def _turned(body: Body, points: np.ndarray, known: np.ndarray, lengths: SegmentLengths) -> np.ndarray:
    """The neutral pose turned and moved onto points (J, 3)."""
    neutral = body.landmarks(body.at(body.neutral))[lengths.landmark][known]
    motion = similarity_onto(neutral, points[known])
    placed = pin.SE3(motion.R, motion.t) * pin.XYZQUATToSE3(body.neutral[:7])
    return np.concatenate([pin.SE3ToXYZQUAT(placed), body.neutral[7:]])


def _posed(body: Body, start: np.ndarray, points: np.ndarray, landmark: np.ndarray) -> tuple[np.ndarray, float]:
    """The pose nearest to points (J, 3), from a start, and how far it is from them in the middle [m]."""

    def at(q: np.ndarray) -> _NearPoints:
        posed = body.at(q)
        return posed, body.landmarks(posed)[landmark] - points

    def equations(near: _NearPoints) -> tuple[np.ndarray, np.ndarray]:
        posed, off = near
        J = body.landmark_jacobians(posed, landmark).reshape(-1, body.nv) / _POINT
        A, g = J.T @ J, J.T @ (off.ravel() / _POINT)
        A[body.bounded_v, body.bounded_v] += _REST**-2.0
        g[body.bounded_v] += (posed.q - body.neutral)[body.bounded_q] / _REST**2
        return A, g

    def step(near: _NearPoints, equations: tuple[np.ndarray, np.ndarray], damping: float) -> _NearPoints:
        A, g = equations
        move = -np.linalg.solve(A + (damping * np.diagonal(A) + _TINY) * np.eye(body.nv), g)
        return at(body.integrate(near[0].q, move))

    def cost(near: _NearPoints) -> float:
        rest = (near[0].q - body.neutral)[body.bounded_q] / _REST
        return 0.5 * float(np.square(near[1] / _POINT).sum() + rest @ rest)

    posed, off = descend(at(start), cost, equations, step, _ONE).model.state
    return posed.q, float(np.median(np.linalg.norm(off, axis=1)))
