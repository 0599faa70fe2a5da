"""Many points at once equal the chains' own messages and updates for each alone."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.inference.chains.evidence import Detections, EvidenceSettings, evidence_of
from estimator.inference.chains.exchange import EXCHANGES, messages
from estimator.inference.chains.feature_density import gaussian
from estimator.inference.chains.kalman import PointChain, PointStates
from estimator.trackers.css.each_point import Normals, messages_each, updated_each

POINTS, NAMES = 12, ("keypoint",)
SETTINGS = EvidenceSettings(shared=0.0)


def positive(rng: np.random.Generator, size: int, scale: float) -> np.ndarray:
    """Covariances (POINTS, size, size)."""
    factor = rng.standard_normal((POINTS, size, size))
    return scale**2 * (factor @ np.swapaxes(factor, 1, 2) + 0.3 * np.eye(size))


@pytest.mark.parametrize("exchange", EXCHANGES)
def test_many_points_at_once_are_each_alone(exchange: str) -> None:
    rng = np.random.default_rng(0)
    chain = PointChain(NAMES, 100.0)
    mean, covariance = 20.0 * rng.standard_normal((POINTS, 4)), positive(rng, 4, 6.0)
    other = Normals(mean[:, :2] + 8.0 * rng.standard_normal((POINTS, 2)), positive(rng, 2, 5.0))
    detected = Normals(
        mean[:, None, :2] + 10.0 * rng.standard_normal((POINTS, 2, 2)), np.tile(16.0 * np.eye(2), (POINTS, 2, 1, 1))
    )
    suits = np.array([[1.0, 0.02], [1.0, 0.0], [0.0, 0.0]])[np.arange(POINTS) % 3]
    received = messages_each(detected, suits, other, SETTINGS, exchange)
    after, spread = updated_each(mean, covariance, received)
    for k in range(POINTS):
        seen = suits[k] > 0.0
        detections = Detections(
            NAMES,
            detected.mean[k, seen],
            detected.covariance[k, seen],
            suits[k, seen, None],
            np.zeros(seen.sum(), bool),
        )
        prior = PointStates(mean[k][None], covariance[k])
        own, theirs = chain.features(prior), gaussian(NAMES, other.mean[[k]], other.covariance[k])
        message = messages([theirs, own], evidence_of(detections, SETTINGS, own), exchange)[1]
        alone, _ = chain.update(prior, message)
        np.testing.assert_allclose(after[k], alone.mean[0], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(chain.bounded(spread)[k], alone.covariance, rtol=1e-5, atol=1e-5)


def test_a_point_without_evidence_stays() -> None:
    rng = np.random.default_rng(1)
    mean, covariance = rng.standard_normal((POINTS, 4)), positive(rng, 4, 1.0)
    nothing = Normals(np.full((POINTS, 2), np.nan), np.full((POINTS, 2, 2), np.nan))
    detected = Normals(np.full((POINTS, 2, 2), np.nan), np.tile(np.eye(2), (POINTS, 2, 1, 1)))
    received = messages_each(detected, np.zeros((POINTS, 2)), nothing, SETTINGS, "gated")
    after, spread = updated_each(mean, covariance, received)
    np.testing.assert_allclose(after, mean)
    np.testing.assert_allclose(spread, covariance)


def test_points_move_as_each_alone() -> None:
    rng = np.random.default_rng(2)
    chain = PointChain(NAMES, 100.0)
    mean, covariance = rng.standard_normal((POINTS, 4)), positive(rng, 4, 30.0)
    after, spread = chain.predict_each(mean, covariance, 0.04)
    for k in range(POINTS):
        alone = chain.predict(PointStates(mean[k][None], covariance[k]), 0.04)
        np.testing.assert_allclose(after[k], alone.mean[0], atol=1e-9)
        np.testing.assert_allclose(spread[k], alone.covariance, rtol=1e-9)
