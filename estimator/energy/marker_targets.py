"""Markers of the body drawn to where they were measured."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.point_targets import PointTargets
from humanoid.kinematics.body import Body, PosedBody, points_in_world

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
