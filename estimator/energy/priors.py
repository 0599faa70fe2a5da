"""Priors on the configuration: stabilisers, and the transition from the previous frame."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from estimator.energy.term import BatchTerm
from estimator.numerics.robust import POTENTIALS, rho, robust_square, robust_sum
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

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


class Stabilisers(BatchTerm):
    """Long-tailed pull of every joint towards its rest position (CSS section 3.2.2), with a scale on either side of it,
    times `weight`, and for some joints times a factor besides, `relative` by their names."""

    name = "stabilisers"

    def __init__(
        self,
        body: Body,
        weight: float = 1.0,
        potential: str = "lorentzian",
        nu: float = STABILISER_NU,
        *,
        relative: Mapping[str, float] | None = None,
    ) -> None:
        model = body.model
        joints = []
        for stabiliser in body.subject.stabilisers:
            if not model.existJointName(stabiliser.joint):
                raise InputError(body.subject.source, f"no movable joint {stabiliser.joint!r}", place="<stabiliser>")
            joints.append(model.getJointId(stabiliser.joint))
        self._q_index = np.array([model.idx_qs[j] for j in joints], dtype=np.int64)
        self._v_index = np.array([model.idx_vs[j] for j in joints], dtype=np.int64)
        self._rest = np.array([s.rest for s in body.subject.stabilisers])
        self._precision = np.array([(s.std**-2, s.std_above**-2) for s in body.subject.stabilisers]).reshape(-1, 2)
        factors = {} if relative is None else relative
        self._weight = weight * np.array([factors.get(s.joint, 1.0) for s in body.subject.stabilisers])
        self._kind, self._nu = POTENTIALS[potential], float(nu)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value: float = stabilise(
            posed.q, self._q_index, self._v_index, self._rest, self._precision, self._weight, self._kind, self._nu,
            gradient, hessian, exact,
        )  # fmt: skip
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        stabiliser_values(
            placed.q, self._q_index, self._rest, self._precision, self._weight, self._kind, self._nu, values
        )
        return values


class Transition(BatchTerm):
    """Diffusion from a previous configuration, 1/2 sum rho((q (-) q_previous)_i^2 / std_i^2) in its tangent space.

    q_previous (nq,): centre. std (nv,): scale of the change [m, rad]. The Gaussian potential is a random walk; a
    long-tailed one lets a mode jump with a penalty that grows with the logarithm of the distance, which is what lets a
    search recover from a wrong interpretation (CSS section 1.1). The exact Hessian leaves out the curvature of (-) in
    joints of several degrees of freedom: with it searches take as many steps. One object serves one thread: it reuses
    buffers.
    """

    name = "transition"

    def __init__(
        self, body: Body, q_previous: np.ndarray, std: np.ndarray, potential: str = "gaussian", nu: float = 8.0
    ) -> None:
        self._model = model = body.model
        self._q_previous = q_previous
        self._precision = 1.0 / np.square(std)
        self._kind, self._nu = POTENTIALS[potential], float(nu)
        # only joints of several degrees of freedom have a difference whose derivative is not the identity
        self._blocks = [
            slice(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in range(1, model.njoints) if model.nvs[j] > 1
        ]
        self._pull, self._bend = np.zeros(body.nv), np.zeros(body.nv)
        self._ranges = np.array([(b.start, b.stop) for b in self._blocks], dtype=np.int64).reshape(-1, 2)
        self._identity = np.zeros((0, 0))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        e = self._change(posed.q)
        jacobian = self._identity
        if self._blocks:
            jacobian = pin.dDifference(self._model, self._q_previous, posed.q, pin.ARG1)
        value: float = diffuse(
            e, self._precision, self._kind, self._nu, exact, self._ranges, jacobian, self._pull, self._bend, gradient,
            hessian,
        )  # fmt: skip
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        return np.array([robust_sum(self._change(q), self._precision, self._kind, self._nu) for q in placed.q])

    def _change(self, q: np.ndarray) -> np.ndarray:
        """q (-) q_previous, (nv,)."""
        change: np.ndarray = pin.difference(self._model, self._q_previous, q)
        return change


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


@jit
def diffuse(e, precision, kind, nu, exact, ranges, jacobian, pull, bend, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of the transition; adds to gradient (nv,) and hessian (nv, nv).

    e, precision (nv,). jacobian (nv, nv): derivative of e, the identity outside the diagonal blocks in `ranges` (B, 2),
    and of no size where there are none. pull, bend (nv,): overwritten.
    """
    value = robust_square(e, precision, kind, nu, exact, pull, bend)
    first = 0
    for b in range(ranges.shape[0] + 1):
        start = ranges[b, 0] if b < ranges.shape[0] else e.shape[0]
        for i in range(first, start):
            gradient[i] += pull[i]
            hessian[i, i] += bend[i]
        if b < ranges.shape[0]:
            first = ranges[b, 1]
            for i in range(start, first):
                for m in range(start, first):
                    gradient[i] += jacobian[m, i] * pull[m]
                    for k in range(start, first):
                        hessian[i, k] += jacobian[m, i] * bend[m] * jacobian[m, k]
    return value
