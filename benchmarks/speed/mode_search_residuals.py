"""The energy of a frame as a sum of squares, 1/2 |r|^2 to the last digits, with its exact Jacobian: for solvers that
want residuals.

A robust group of residuals e with s = |e|^2, which costs rho(s) / 2, becomes e sqrt(rho(s) / s): it has the same
direction, and its square is rho(s). So a keypoint stays two residuals, and the Gauss-Newton matrix of the new ones
knows how the potential flattens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.cameras.projection import pack_cameras, project_with_jacobian
from estimator.data.observation import Observation
from estimator.energy.kernels.keypoints import BEHIND
from humanoid.kinematics.body import ROOT_JOINT, Body, PosedBody

FREE = 6  # degrees of freedom of a free root


def robust(e: np.ndarray, D: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Groups e (G, d) with derivatives D (G, d, n) -> those of which half the square is the Lorentzian of e, halved."""
    s = np.square(e).sum(axis=1)
    z = np.maximum(s / nu, 1e-12)  # below, the quotients are their limits to rounding
    h = np.sqrt(np.log1p(z) / z)
    slope = (1.0 / (1.0 + z) - np.log1p(z) / z) / (2.0 * h * z * nu)  # dh/ds
    slope = np.where(z < 1e-6, -0.25 / nu, slope)  # its limit, before cancellation spoils the difference
    inward = np.einsum("gd,gdn->gn", e, D)
    return h[:, None] * e, h[:, None, None] * D + 2.0 * slope[:, None, None] * e[:, :, None] * inward[:, None]


class Change(NamedTuple):
    """What a change since the frame before costs: from q_previous (nq,), by std (nv,) [m, rad] and nu, see
    `estimator.energy.priors.Transition`."""

    q_previous: np.ndarray
    std: np.ndarray
    nu: float


class Residuals:
    """Keypoints, stabilisers, the root's tilt and the change since the frame before, all Lorentzian, as residuals of
    x (nv,).

    x: the root's motion from its start, in the tangent space there (metres and radians, no bound, no singularity within
    half a turn), then the joints' angles themselves, so that their limits are bounds of x.

    Parameters
    ----------
    body: with a free root, every other joint of one degree of freedom. start (nq,): where x's root is zero.
    observation, sigma (C, L), nu: see `estimator.energy.reprojection.Reprojection`. up (3,): see `Upright`.
    prior_nu: of stabilisers and tilt. change: None where it is not penalised.
    """

    def __init__(
        self, body: Body, start: np.ndarray, observation: Observation, sigma: np.ndarray, nu: float, up: np.ndarray,
        prior_nu: float = 4.0, change: Change | None = None,
    ) -> None:  # fmt: skip
        self._body, self._start, self._nu, self._up, self._prior_nu = body, start, nu, up, prior_nu
        self._seen = np.argwhere(observation.confidence > 0.0)
        self._confidence = np.sqrt(observation.confidence)[tuple(self._seen.T)]
        self._sigma = sigma[tuple(self._seen.T)]
        self._pixels = observation.pixels[tuple(self._seen.T)]
        self._cameras = pack_cameras(observation.cameras)
        places = {body.model.names[j]: int(body.model.idx_vs[j]) for j in range(1, body.njoints)}
        stabilisers = body.subject.stabilisers
        self._joint_v = np.array([places[s.joint] for s in stabilisers])
        self._rest = np.array([s.rest for s in stabilisers])
        self._stds = np.array([(s.std, s.std_above) for s in stabilisers])
        assert body.subject.upright is not None
        self._axis, self._tilt_std = np.array(body.subject.upright.axis), body.subject.upright.std
        self.lower, self.upper = np.full(body.nv, -np.inf), np.full(body.nv, np.inf)
        self.lower[body.bounded_v], self.upper[body.bounded_v] = body.lower[body.bounded_q], body.upper[body.bounded_q]
        self._change = change
        self._known: tuple[bytes, np.ndarray, np.ndarray] | None = None

    @property
    def x0(self) -> np.ndarray:
        """The start."""
        return np.concatenate([np.zeros(FREE), self._start[FREE + 1 :]])

    def q(self, x: np.ndarray) -> np.ndarray:
        """Configuration (nq,) of x (nv,)."""
        moved = pin.integrate(self._body.model, self._start, _root_only(x))
        return np.concatenate([moved[: FREE + 1], x[FREE:]])

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """r (M,): energy is half its square."""
        return self._at(x)[0]

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """dr/dx (M, nv)."""
        return self._at(x)[1]

    def _at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and Jacobian; solvers request both at the same x in succession."""
        key = x.tobytes()
        if self._known is None or self._known[0] != key:
            posed = self._body.at(self.q(x))
            parts = [self._keypoints(posed), self._stabilisers(x), self._tilt(posed)]
            if self._change is not None:
                parts.append(self._changed(posed, self._change))
            r, J = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
            chart = pin.dIntegrate(self._body.model, self._start, _root_only(x), pin.ARG1)[:FREE, :FREE]
            J[:, :FREE] = J[:, :FREE] @ chart
            self._known = key, r, J
        return self._known[1:]

    def _keypoints(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        points = self._body.landmarks(posed)
        by_q = self._body.landmark_jacobians(posed)
        e, D = np.zeros((len(self._seen), 2)), np.zeros((len(self._seen), 2, self._body.nv))
        image = np.zeros((2, 3))
        K, distortion, R, t = self._cameras
        for n, (c, k) in enumerate(self._seen):
            u, v, visible = project_with_jacobian(points[k], K[c], distortion[c], R[c], t[c], image)
            e[n] = (u, v) - self._pixels[n] if visible else (np.sqrt(BEHIND) * self._sigma[n], 0.0)
            D[n] = image @ by_q[k] if visible else 0.0
        r, J = robust(e / self._sigma[:, None], D / self._sigma[:, None, None], self._nu)
        weight = self._confidence
        return (weight[:, None] * r).ravel(), (weight[:, None, None] * J).reshape(-1, self._body.nv)

    def _stabilisers(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        D, off = np.zeros((len(self._rest), 1, self._body.nv)), x[self._joint_v] - self._rest
        std = np.where(off > 0.0, self._stds[:, 1], self._stds[:, 0])
        D[np.arange(len(self._rest)), 0, self._joint_v] = 1.0 / std
        r, J = robust((off / std)[:, None], D, self._prior_nu)
        return r.ravel(), J[:, 0]

    def _tilt(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        u = posed.rotations[ROOT_JOINT] @ self._axis
        D = np.zeros((3, self._body.nv))
        D[:, :FREE] = np.cross(posed.spatial_jacobian[:FREE, 3:], u).T
        r, J = robust(((u - self._up) / self._tilt_std)[None], D[None] / self._tilt_std, self._prior_nu)
        return r[0], J[0]

    def _changed(self, posed: PosedBody, change: Change) -> tuple[np.ndarray, np.ndarray]:
        model = self._body.model
        e = pin.difference(model, change.q_previous, posed.q) / change.std
        D = pin.dDifference(model, change.q_previous, posed.q, pin.ARG1) / change.std[:, None]
        r, J = robust(e[:, None], D[:, None], change.nu)
        return r.ravel(), J[:, 0]


def _root_only(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x[:FREE], np.zeros(len(x) - FREE)])
