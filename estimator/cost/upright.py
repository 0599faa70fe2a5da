"""Which way is up: a long-tailed pull of a free root towards standing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.cost.kernels import rho
from estimator.cost.potentials import POTENTIALS
from estimator.imaging.camera import Camera
from humanoid.body import Body, PosedBody

ROOT = 1  # Pinocchio's joint of a free root
ANGULAR = slice(3, 6)


class Upright:
    """1/2 rho(|u - up|^2 / std^2), u being the root's own up axis in the world.

    A stabiliser (CSS 3.2.2) of the root's tilt; its heading stays free. |u - up| is the tilt [rad] to second order.

    Parameters
    ----------
    body: with a free root and an up axis (`Subject.upright`).
    up (3,): unit vector in the world.
    weight, potential, nu: see `estimator.cost.potentials`.
    """

    def __init__(
        self, body: Body, up: np.ndarray, weight: float = 1.0, potential: str = "lorentzian", nu: float = 4.0
    ) -> None:
        assert body.subject.upright is not None
        self._axis = np.array(body.subject.upright.axis)
        self._precision = 1.0 / body.subject.upright.std**2
        self._up, self._weight, self._kind, self._nu = up, weight, POTENTIALS[potential], nu
        x, y, z = self._axis
        self._cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.cost.term.Term`."""
        R = posed.rotations[ROOT]
        u = R @ self._axis
        e = u - self._up
        cost, slope, bend = rho(self._kind, float(e @ e) * self._precision, self._nu)
        J = -R @ self._cross  # d u for a turn in the root's own frame
        along = J.T @ e
        pull = self._weight * slope * self._precision
        gradient[ANGULAR] += pull * along
        hessian[ANGULAR, ANGULAR] += pull * (J.T @ J)
        if exact:  # d2 u = w_i (w_j . u) - u (w_i . w_j), w the root's axes in the world
            w_e, w_u = R.T @ e, R.T @ u
            second = 0.5 * (np.outer(w_e, w_u) + np.outer(w_u, w_e)) - np.eye(3) * (e @ u)
            curve = 2.0 * self._weight * bend * self._precision**2
            hessian[ANGULAR, ANGULAR] += pull * second + curve * np.outer(along, along)
        return 0.5 * self._weight * cost


def world_up(cameras: Sequence[Camera]) -> np.ndarray:
    """The axis of the world, one of +-x, +-y, +-z, nearest to the cameras' mean upward direction, (3,).

    Worlds have z up, or y up, or are a camera's own with y down; cameras are held more or less level.
    """
    upward = -np.sum([c.R_camera_world[1] for c in cameras], axis=0)
    axis = np.zeros(3)
    k = int(np.argmax(np.abs(upward)))
    axis[k] = 1.0 if upward[k] >= 0.0 else -1.0
    return axis
