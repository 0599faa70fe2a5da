"""Compiled kernels of the pull towards rest positions."""

from __future__ import annotations

import math

import numpy as np

from estimator.energy.kernels.records import STABILISERS, Record, record_of
from estimator.numerics.robust import rho
from humanoid.support.compiled import jit

STABILISER_NU = 4.0
"""Spread of the stabilisers' outliers: with the Lorentzian exp(-energy) is Student's t with 3 degrees of freedom, the
fewest that have a variance; the pose prior's background and the order of kinematic jumps are the same density."""


def stabiliser_log_integral() -> float:
    """Logarithm of the integral of (1 + z^2 / nu)^(-nu / 2) over z, by which exp(-energy) is a density."""
    return (
        0.5 * math.log(math.pi * STABILISER_NU)
        + math.lgamma(0.5 * (STABILISER_NU - 1.0))
        - math.lgamma(0.5 * STABILISER_NU)
    )


@jit
def stabilise(q, q_index, v_index, rest, precision, weight, kind, nu, gradient, hessian, exact):  # type: ignore[no-untyped-def]
    """Value of S stabilisers; adds their gradient (nv,) and diagonal hessian (nv, nv).

    q (nq,). q_index, v_index (S,): places of their joints in q and in the tangent. rest, weight (S,). precision (S, 2):
    below and above rest.
    """
    value = 0.0
    for i in range(q_index.shape[0]):
        e = q[q_index[i]] - rest[i]
        own = precision[i, 1 if e > 0.0 else 0]
        cost, slope, bend = rho(kind, e * e * own, nu)
        value += 0.5 * weight[i] * cost
        gradient[v_index[i]] += weight[i] * slope * own * e
        curvature = slope + 2.0 * bend * e * e * own if exact else slope
        hessian[v_index[i], v_index[i]] += weight[i] * curvature * own
    return value


@jit
def stabiliser_values(q, q_index, rest, precision, weight, kind, nu, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `stabilise` at q (N, nq)."""
    for n in range(q.shape[0]):
        value = 0.0
        for i in range(q_index.shape[0]):
            e = q[n, q_index[i]] - rest[i]
            value += 0.5 * weight[i] * rho(kind, e * e * precision[i, 1 if e > 0.0 else 0], nu)[0]
        values[n] = value


def stabiliser_record(
    q_index: np.ndarray, v_index: np.ndarray, rest: np.ndarray, precision: np.ndarray, weight: np.ndarray, kind: int,
    nu: float,
) -> Record:  # fmt: skip
    """The term, see `stabilise`."""
    return record_of(STABILISERS, [len(rest), kind, q_index, v_index], [nu, rest, precision, weight])


@jit
def recorded_stabilisers(integers, numbers, q, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`stabilise` of a record's integers (I,) and numbers (F,)."""
    S, kind, q_index, v_index = integers[0], integers[1], integers[2:], integers[2 + integers[0] :]
    nu, rest, precision = numbers[0], numbers[1 : 1 + S], numbers[1 + S : 1 + 3 * S].reshape(S, 2)
    weight = numbers[1 + 3 * S : 1 + 4 * S]
    return stabilise(q, q_index[:S], v_index[:S], rest, precision, weight, kind, nu, gradient, hessian, exact)
