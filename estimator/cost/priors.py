"""Priors on the configuration: stabilisers, and the transition from the previous frame."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.cost.potentials import POTENTIALS, rho
from humanoid.body import Body, PosedBody
from humanoid.compiled import jit
from humanoid.errors import InputError


class Stabilisers:
    """Long-tailed pull of every joint towards its rest position (CSS section 3.2.2), scaled by `weight`."""

    def __init__(self, body: Body, weight: float = 1.0, potential: str = "lorentzian", nu: float = 4.0) -> None:
        model = body.model
        joints = []
        for stabiliser in body.subject.stabilisers:
            if not model.existJointName(stabiliser.joint):
                raise InputError(body.subject.source, f"no movable joint {stabiliser.joint!r}", place="<stabiliser>")
            joints.append(model.getJointId(stabiliser.joint))
        self._q_index = np.array([model.idx_qs[j] for j in joints], dtype=np.int64)
        self._v_index = np.array([model.idx_vs[j] for j in joints], dtype=np.int64)
        self._rest = np.array([s.rest for s in body.subject.stabilisers])
        self._precision = np.array([1.0 / s.std**2 for s in body.subject.stabilisers])
        self._weight, self._kind, self._nu = float(weight), POTENTIALS[potential], float(nu)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.cost.term.Term`."""
        value: float = _stabilise(
            posed.q, self._q_index, self._v_index, self._rest, self._precision, self._weight, self._kind, self._nu,
            gradient, hessian, exact,
        )  # fmt: skip
        return value


@jit
def _stabilise(q, q_index, v_index, rest, precision, weight, kind, nu, gradient, hessian, exact):  # type: ignore[no-untyped-def]
    value = 0.0
    for i in range(q_index.shape[0]):
        e = q[q_index[i]] - rest[i]
        cost, slope, bend = rho(kind, e * e * precision[i], nu)
        value += 0.5 * weight * cost
        gradient[v_index[i]] += weight * slope * precision[i] * e
        curvature = slope + 2.0 * bend * e * e * precision[i] if exact else slope
        hessian[v_index[i], v_index[i]] += weight * curvature * precision[i]
    return value


class Transition:
    """Gaussian diffusion from a previous configuration: 1/2 sum (q (-) q_previous)_i^2 / std_i^2 in its tangent space.

    q_previous (nq,): centre. std (nv,): standard deviation of the change [m, rad].
    """

    def __init__(self, body: Body, q_previous: np.ndarray, std: np.ndarray) -> None:
        self._model = body.model
        self._q_previous = q_previous
        self._precision = 1.0 / np.square(std)
        model = body.model
        # only joints of several degrees of freedom have a difference whose derivative is not the identity
        self._blocks = [
            slice(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in range(1, model.njoints) if model.nvs[j] > 1
        ]
        self._diagonal = np.ones(body.nv, dtype=bool)
        for block in self._blocks:
            self._diagonal[block] = False
        self._index = np.flatnonzero(self._diagonal)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.cost.term.Term`."""
        e = pin.difference(self._model, self._q_previous, posed.q)
        pull = self._precision * e
        i = self._index
        gradient[i] += pull[i]
        hessian[i, i] += self._precision[i]
        if self._blocks:
            jacobian = pin.dDifference(self._model, self._q_previous, posed.q, pin.ARG1)
            for block in self._blocks:
                J = jacobian[block, block]
                gradient[block] += J.T @ pull[block]
                hessian[block, block] += (J.T * self._precision[block]) @ J
        return float(0.5 * e @ pull)
