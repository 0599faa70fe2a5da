"""Priors on the configuration: stabilisers, and the transition from the previous frame."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.terms.kernels import diffuse, stabilise
from estimator.terms.potentials import POTENTIALS
from humanoid.kinematics.body import Body, PosedBody
from humanoid.support.errors import InputError


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
        """See `estimator.terms.term.Term`."""
        value: float = stabilise(
            posed.q, self._q_index, self._v_index, self._rest, self._precision, self._weight, self._kind, self._nu,
            gradient, hessian, exact,
        )  # fmt: skip
        return value


class Transition:
    """Diffusion from a previous configuration, 1/2 sum rho((q (-) q_previous)_i^2 / std_i^2) in its tangent space.

    q_previous (nq,): centre. std (nv,): scale of the change [m, rad]. The Gaussian potential is a random walk; a
    long-tailed one lets a mode jump at a price that grows with the logarithm of the distance, which is what lets a
    search recover from a wrong interpretation (CSS section 1.1).
    """

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
        """See `estimator.terms.term.Term`."""
        e = pin.difference(self._model, self._q_previous, posed.q)
        jacobian = self._identity
        if self._blocks:
            jacobian = pin.dDifference(self._model, self._q_previous, posed.q, pin.ARG1)
        value: float = diffuse(
            e, self._precision, self._kind, self._nu, exact, self._ranges, jacobian, self._pull, self._bend, gradient,
            hessian,
        )  # fmt: skip
        return value
