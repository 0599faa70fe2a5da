"""Constraint-consistent covariance of a mode."""

from __future__ import annotations

import numpy as np

from estimator.numerics.linear import invert_definite
from humanoid.kinematics.body import Body
from humanoid.support.compiled import jit

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
