"""Markers of the body drawn to where they were measured."""

from __future__ import annotations

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.point_targets import PointTargets
from humanoid.kinematics.body import Body, PosedBody, points_in_world

NAME = "markers"


def marker_stds(body: Body, noise: float) -> np.ndarray:
    """How far each marker (M,) may be measured from its place on the body [m], as one standard deviation along each
    axis: the noise of the measurement, and how unsure its place is."""
    return np.asarray(np.hypot(noise, body.marker_std))


def marker_targets(body: Body, observation: Observation, noise: float, nu: float) -> list[PointTargets]:
    """What draws a body's markers to where a frame has them, Lorentzian with `nu`; nothing where it has none.

    noise [m]: standard deviation of the measurement.
    """
    some = observation.known_markers
    if observation.markers is None or not len(some):
        return []
    precision = np.eye(3) / np.square(marker_stds(body, noise))[some, None, None]
    places = body.marker_joint[some], body.marker_local[some], observation.markers[some]
    return [PointTargets(body, *places, precision, potential="lorentzian", nu=nu, name=NAME)]


def marker_distances(posed: PosedBody, body: Body, observation: Observation, noise: float) -> np.ndarray:
    """How far the markers that a frame has (N,) lie from their places on a posed body, in standard deviations along one
    axis."""
    some = observation.known_markers
    if observation.markers is None or not len(some):
        return np.zeros(0)
    places = points_in_world(posed, body.marker_joint[some], body.marker_local[some])
    away = np.linalg.norm(observation.markers[some] - places, axis=1)
    return np.asarray(away / marker_stds(body, noise)[some])
