"""Which way is up: a long-tailed pull of a free root towards standing."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.kernels.records import TILT, Record
from estimator.energy.kernels.stabilisers import STABILISER_NU
from estimator.energy.kernels.tilt import tilt_record, tilt_values
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.robust import POTENTIALS
from humanoid.kinematics.body import Body, PlacedBodies

_LEVEL = 1e-12  # of a cosine


class GravityPrior(RecordedTerm):
    """1/2 rho(|u - up|^2 / std^2), u being the root's own up axis in the world.

    A stabiliser (CSS 3.2.2) of the root's tilt; its heading stays free. |u - up| is the tilt [rad] to second order.

    Parameters
    ----------
    body: with a free root and an up axis (`Subject.upright`).
    up (3,): unit vector in the world.
    weight, potential, nu: see `estimator.numerics.robust`.
    """

    name, kind, lasting = "upright", TILT, True

    def __init__(
        self, body: Body, up: np.ndarray, weight: float = 1.0, potential: str = "lorentzian", nu: float = STABILISER_NU
    ) -> None:
        assert body.subject.upright is not None
        self._body = body
        self._axis = np.array(body.subject.upright.axis)
        self._precision = 1.0 / body.subject.upright.std**2
        self._up, self._weight, self._kind, self._nu = (
            np.asarray(up, dtype=float),
            float(weight),
            POTENTIALS[potential],
            float(nu),
        )

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return tilt_record(self._axis, self._up, self._precision, self._weight, self._kind, self._nu)

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
