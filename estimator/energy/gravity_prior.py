"""Which way is up: a long-tailed pull of a free root towards standing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.priors import STABILISER_NU
from estimator.energy.term import BatchTerm
from estimator.numerics.robust import POTENTIALS, rho
from humanoid.kinematics.body import ROOT_JOINT, Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit

_LEVEL = 1e-12  # of a cosine


class GravityPrior(BatchTerm):
    """1/2 rho(|u - up|^2 / std^2), u being the root's own up axis in the world.

    A stabiliser (CSS 3.2.2) of the root's tilt; its heading stays free. |u - up| is the tilt [rad] to second order.

    Parameters
    ----------
    body: with a free root and an up axis (`Subject.upright`).
    up (3,): unit vector in the world.
    weight, potential, nu: see `estimator.numerics.robust`.
    """

    name = "upright"

    def __init__(
        self, body: Body, up: np.ndarray, weight: float = 1.0, potential: str = "lorentzian", nu: float = STABILISER_NU
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
        """See `estimator.energy.term.Term`."""
        value: float = tilt(
            posed.placements[ROOT_JOINT], self._axis, self._up, self._precision, self._weight, self._kind, self._nu,
            exact, gradient, hessian,
        )  # fmt: skip
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        tilt_values(
            placed.placements, self._axis, self._up, self._precision, self._weight, self._kind, self._nu, values
        )
        return values


def world_up(cameras: Sequence[Camera]) -> np.ndarray:
    """The axis of the world, one of +-x, +-y, +-z, nearest to the cameras' mean upward direction, (3,).

    Worlds have z up, or y up, or are a camera's own with y down; cameras are held more or less level. Without cameras
    it is z: points in space are read so.
    """
    if not cameras:
        return np.array([0.0, 0.0, 1.0])
    upward = -np.sum([c.R_camera_world[1] for c in cameras], axis=0)
    axis = np.zeros(3)
    k = int(np.argmax(np.abs(upward)))
    axis[k] = 1.0 if upward[k] >= 0.0 else -1.0
    return axis


def up_is_assumed(cameras: Sequence[Camera]) -> bool:
    """Whether the world's up is no more than the picture's of its only camera: a guessed camera, or a file whose world
    is the camera itself. A calibrated one is never level to the last bit."""
    return len(cameras) == 1 and float(-cameras[0].R_camera_world[1] @ world_up(cameras)) > 1.0 - _LEVEL


@jit
def tilt(placement, axis, up, precision, weight, kind, nu, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of the pull of R axis (3,) towards up (3,), R from the root's placement (12,).

    Adds to the root's three angular degrees of freedom in gradient (nv,) and hessian (nv, nv): they turn about the
    root's own axes.
    """
    u, e = np.zeros(3), np.zeros(3)
    s = _lean(placement, axis, up, u, e)
    cost, slope, bending = rho(kind, s * precision, nu)
    pull, curve = weight * slope * precision, 2.0 * weight * bending * precision * precision
    J, along, w_e, w_u = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(3):  # column k: w x u for the root's axis w in the world
        w = placement[3 * k : 3 * k + 3]
        J[0, k] = w[1] * u[2] - w[2] * u[1]
        J[1, k] = w[2] * u[0] - w[0] * u[2]
        J[2, k] = w[0] * u[1] - w[1] * u[0]
        for i in range(3):
            along[k] += J[i, k] * e[i]
            w_e[k] += w[i] * e[i]
            w_u[k] += w[i] * u[i]
        gradient[3 + k] += pull * along[k]
    e_u = e[0] * u[0] + e[1] * u[1] + e[2] * u[2]
    for a in range(3):
        for b in range(3):
            for i in range(3):
                hessian[3 + a, 3 + b] += pull * J[i, a] * J[i, b]
            if exact:  # d2 u = w_a (w_b . u) - u (w_a . w_b), the symmetric half
                second = 0.5 * (w_e[a] * w_u[b] + w_u[a] * w_e[b]) - (e_u if a == b else 0.0)
                hessian[3 + a, 3 + b] += pull * second + curve * along[a] * along[b]
    return 0.5 * weight * cost


@jit
def tilt_values(placements, axis, up, precision, weight, kind, nu, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `tilt` for placements (N, njoints, 12)."""
    u, e = np.empty(3), np.empty(3)
    for n in range(placements.shape[0]):
        u[:] = 0.0
        s = _lean(placements[n, ROOT_JOINT], axis, up, u, e)
        values[n] = 0.5 * weight * rho(kind, s * precision, nu)[0]


@jit
def _lean(placement, axis, up, u, e):  # type: ignore[no-untyped-def]
    """Squared length of e = u - up with u = R axis, R of a placement (12,); axis, up (3,). Adds to u (3,), fills
    e (3,)."""
    for i in range(3):
        for k in range(3):
            u[i] += placement[3 * k + i] * axis[k]
        e[i] = u[i] - up[i]
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
