"""Result of a search: status, counts, and the constraint-consistent covariance of a mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.energy.cost import QuadraticModel
from estimator.numerics.linear import invert_definite
from humanoid.kinematics.body import Body
from humanoid.support.compiled import jit

# Ends of a search other than those of descents in `estimator.numerics.newton`.
# Parts that overlapped were parted, and the residual did not become small; a mean of particles, no end of a search.
SEPARATED, SAMPLED = "separated", "sampled"


class StepCounts(NamedTuple):
    """The number of a search's steps solved by each solver.

    free: no bound was active, by Cholesky decomposition. active_set: by the compiled active set. proxqp: by ProxQP.
    failed: by none, as no answer was certified. A model that is not convex has a step only where the active set leaves
    a convex part of it free; elsewhere it has none and is not counted.
    """

    free: int = 0
    active_set: int = 0
    proxqp: int = 0
    failed: int = 0

    @property
    def guessed(self) -> int:
        """Steps that needed no ProxQP."""
        return self.free + self.active_set

    @staticmethod
    def between(before: Sequence[int], after: Sequence[int]) -> StepCounts:
        """The difference of two counts."""
        return StepCounts(
            after[0] - before[0], after[1] - before[1], after[2] - before[2], after[3] - before[3]
        )  # fmt: skip

    def plus(self, other: StepCounts) -> StepCounts:
        """The steps of both."""
        return StepCounts(self[0] + other[0], self[1] + other[1], self[2] + other[2], self[3] + other[3])


class Solution(NamedTuple):
    """End of a search.

    quadratic: the quadratic model at the last accepted q. status: CONVERGED, STALLED, ITERATIONS or SEPARATED.
    kkt_residual: recomputed there. iterations: steps tried. steps: which solvers solved them; more than were tried
    where one step was solved several times, each with more damping.
    """

    quadratic: QuadraticModel
    status: str
    kkt_residual: float
    iterations: int
    steps: StepCounts = StepCounts()

    @property
    def q(self) -> np.ndarray:
        """Configuration (nq,)."""
        return self.quadratic.posed.q


MAX_STD = 2.0  # rad or m: directions that nothing observes


def mode_covariance(
    body: Body, q: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, max_std: float = MAX_STD
) -> np.ndarray:
    """Inverse Hessian (nv, nv) on the directions that no active limit holds, zero on the others (CSS section 4.2).

    A limit is active where q lies on it and the gradient (nv,) presses against it. `hessian` (nv, nv) is positive
    semi-definite; a weak isotropic prior of standard deviation `max_std` bounds what is not observed at all.
    """
    index, nv = free_directions(body, q, gradient), body.nv
    precision, covariance = hessian + np.eye(nv) / max_std**2, np.zeros((nv, nv))
    factor, inverse_factor = np.empty((2, nv, nv))
    if not invert_definite(precision, index, len(index), factor, inverse_factor, covariance):
        block = np.ix_(index, index)
        covariance[block] = np.linalg.inv(precision[block])
        covariance = 0.5 * (covariance + covariance.T)
    return covariance


def free_directions(body: Body, q: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Indices of the degrees of freedom that no active limit holds, see `free_mask`."""
    return np.flatnonzero(free_mask(body, q, gradient))


def free_mask(body: Body, q: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Degrees of freedom that no active limit holds, (..., nv) bool: q (..., nq) on it, gradient (..., nv) pressing."""
    free = np.ones(gradient.shape, dtype=bool)
    _hold(
        np.ascontiguousarray(q).reshape(-1, body.nq), np.ascontiguousarray(gradient).reshape(-1, body.nv),
        body.bounded_q, body.bounded_v, body.lower, body.upper, free.reshape(-1, body.nv),
    )  # fmt: skip
    return free


@jit
def _hold(q, gradient, bounded_q, bounded_v, lower, upper, free):  # type: ignore[no-untyped-def]
    """Set free (N, nv) to False where an active limit holds; q (N, nq), gradient (N, nv), bounded_q, bounded_v (B,),
    lower, upper (nq,): see `Body`."""
    for n in range(q.shape[0]):
        for k, i in zip(bounded_q, bounded_v):  # noqa: B905
            pull = gradient[n, i]
            if (q[n, k] <= lower[k] and pull > 0.0) or (q[n, k] >= upper[k] and pull < 0.0):
                free[n, i] = False
