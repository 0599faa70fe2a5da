"""Points of the body drawn to places in the world: captured landmarks, measured depth, markers."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.kernels.records import TARGETS, Record
from estimator.energy.kernels.targets import record_with_targets, target_loads, target_record, target_values
from estimator.energy.points import LoadedPoints
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.robust import POTENTIALS
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody, points_in_world
from humanoid.support.errors import InputError


class PointTargets(RecordedTerm):
    """1/2 sum weight rho(e' W e) with e = point - target in the world (CSS eqs. 5 and 6, in space instead of an image).

    Parameters
    ----------
    body: whose points they are.
    joint (N,), local (N, 3): points fixed to joints, in the joints' frames [m]; of landmarks, `Body.landmark_joint` and
        `Body.landmark_local`.
    target (N, 3): where they should be, in the world [m].
    precision (N, 3, 3): W, symmetric and positive semi-definite [1/m^2]: singular where a direction is not known.
    weight (N,): of each; 1 by default.
    potential, nu: see `estimator.numerics.robust`.
    name: of what they are drawn by.

    Raises
    ------
    InputError: sizes that do not fit each other, or an array that is not finite.
    """

    kind = TARGETS

    def __init__(
        self,
        body: Body,
        joint: np.ndarray,
        local: np.ndarray,
        target: np.ndarray,
        precision: np.ndarray,
        *,
        weight: np.ndarray | None = None,
        potential: str = "gaussian",
        nu: float = 4.0,
        name: str = "point targets",
    ) -> None:
        self.name = name
        count = len(joint)
        self._body, self._joint = body, np.asarray(joint, dtype=np.int64)
        self._local, self._target = _sized("local", local, (count, 3)), _sized("target", target, (count, 3))
        self._precision = _sized("precision", precision, (count, 3, 3))
        self._weight = _sized("weight", np.ones(count) if weight is None else weight, (count,))
        self._kind, self._nu = POTENTIALS[potential], float(nu)

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        arrays = self._joint, self._local, self._target, self._precision, self._weight
        return target_record(*arrays, self._kind, self._nu)

    def with_targets(self, target: np.ndarray) -> PointTargets:
        """The same points drawn to other places, target (N, 3) [m]."""
        moved = copy(self)
        moved._target, moved.record = target, record_with_targets(self.record, target)
        return moved

    def point_loads(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (N, 3) [1/m] and Gauss-Newton Hessian (N, 3, 3) of the value with respect to each point."""
        points, force, weight = LoadedPoints.on(self._joint)[1:]
        target_loads(
            posed.placements, self._joint, self._local, self._target, self._precision, self._weight, self._kind,
            self._nu, False, points, force, weight,
        )  # fmt: skip
        return force, weight

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        target_values(
            placed.placements, self._joint, self._local, self._target, self._precision, self._weight, self._kind,
            self._nu, values,
        )  # fmt: skip
        return values


def _sized(name: str, given: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.ascontiguousarray(given, dtype=float)
    if array.shape != shape:
        raise InputError("point targets", f"{name} has shape {array.shape}", remedy=f"{shape}, as the joints")
    if not np.isfinite(array).all():
        raise InputError("point targets", f"{name} is not finite", remedy="leave out points without a target")
    return array


NAME = "markers"


class MarkerNoise(NamedTuple):
    """Noise of a marker's measurement about its place on a body. measured [m]: standard deviation of the measurement.
    place: share of the deviation of its place that counts as noise of a frame; all of it is alike in all frames, but
    takes other values where skin moves. nu: of the Lorentzian whose long tails tolerate outliers."""

    measured: float
    place: float
    nu: float

    def stds(self, body: Body) -> np.ndarray:
        """Standard deviation of each marker (M,) [m], along each axis."""
        return np.asarray(np.hypot(self.measured, self.place * body.marker_std))


def marker_targets(body: Body, observation: Observation, noise: MarkerNoise) -> list[PointTargets]:
    """Terms that pull a body's markers to their measured places in a frame; none without markers."""
    some = observation.known_markers
    if observation.markers is None or not len(some):
        return []
    precision = np.eye(3) / np.square(noise.stds(body))[some, None, None]
    places = body.marker_joint[some], body.marker_local[some], observation.markers[some]
    return [PointTargets(body, *places, precision, potential="lorentzian", nu=noise.nu, name=NAME)]


def marker_distances(posed: PosedBody, body: Body, observation: Observation, noise: MarkerNoise) -> np.ndarray:
    """Distances of a frame's measured markers (N,) from their places on a posed body, in standard deviations along one
    axis."""
    some = observation.known_markers
    if observation.markers is None or not len(some):
        return np.zeros(0)
    places = points_in_world(posed, body.marker_joint[some], body.marker_local[some])
    away = np.linalg.norm(observation.markers[some] - places, axis=1)
    return np.asarray(away / noise.stds(body)[some])
