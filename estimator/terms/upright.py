"""Which way is up: a long-tailed pull of a free root towards standing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.cameras.camera import Camera
from estimator.terms.kernels import tilt
from estimator.terms.potentials import POTENTIALS
from humanoid.kinematics.body import Body, PosedBody

ROOT = 1  # Pinocchio's joint of a free root


class Upright:
    """1/2 rho(|u - up|^2 / std^2), u being the root's own up axis in the world.

    A stabiliser (CSS 3.2.2) of the root's tilt; its heading stays free. |u - up| is the tilt [rad] to second order.

    Parameters
    ----------
    body: with a free root and an up axis (`Subject.upright`).
    up (3,): unit vector in the world.
    weight, potential, nu: see `estimator.terms.potentials`.
    """

    def __init__(
        self, body: Body, up: np.ndarray, weight: float = 1.0, potential: str = "lorentzian", nu: float = 4.0
    ) -> None:
        assert body.subject.upright is not None
        self._axis = np.array(body.subject.upright.axis)
        self._precision = 1.0 / body.subject.upright.std**2
        self._up, self._weight, self._kind, self._nu = (
            np.asarray(up, dtype=float),
            float(weight),
            POTENTIALS[potential],
            float(nu),
        )

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.terms.term.Term`."""
        value: float = tilt(
            posed.placements[ROOT], self._axis, self._up, self._precision, self._weight, self._kind, self._nu, exact,
            gradient, hessian,
        )  # fmt: skip
        return value


def world_up(cameras: Sequence[Camera]) -> np.ndarray:
    """The axis of the world, one of +-x, +-y, +-z, nearest to the cameras' mean upward direction, (3,).

    Worlds have z up, or y up, or are a camera's own with y down; cameras are held more or less level.
    """
    upward = -np.sum([c.R_camera_world[1] for c in cameras], axis=0)
    axis = np.zeros(3)
    k = int(np.argmax(np.abs(upward)))
    axis[k] = 1.0 if upward[k] >= 0.0 else -1.0
    return axis
