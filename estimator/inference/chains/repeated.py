"""What a detection that several features share, as a blob of a hand before the face, adds to what is known already.

Where a feature is inside such a detection hardly changes from frame to frame, and is not measured independently each
time: a chain that multiplied by its density in every frame would be sure after half a second that a hand is in the
middle of the face.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.inference.chains.feature_density import FeatureDensity

_LEAST = 1e-9  # of a share: information is never nothing


def new_share(inside: float, dt: float) -> float:
    """Share of a shared detection's information that is new `dt` [s] after the same; 1 where `inside` is 0.

    inside [s]: correlation time of a feature's place inside the detection. Measurements whose errors have a correlation
    of r from one to the next inform on a constant, each after the first, by (1 - r) / (1 + r) of what one alone does.
    """
    return 1.0 if inside <= 0.0 else float(np.tanh(0.5 * dt / inside))


def _news(covariance: np.ndarray, prior: np.ndarray, share: float) -> np.ndarray:
    """Covariance (2, 2) [px^2] with which a detection is a measurement of a feature that is independent of the past.

    Of its information only what is not yet known counts, in each direction, and beyond that a share, as the feature
    moves around inside. With a share of 0 the feature becomes as certain as the more certain of the two, which along
    one direction is covariance intersection (Julier and Uhlmann 1997), for estimates with unknown dependence.

    covariance (2, 2) [px^2]: of a feature in the detection. prior (2, 2) [px^2]: of the feature by its past.
    """
    if share >= 1.0:
        return covariance
    factor = np.linalg.cholesky(prior)
    white = np.linalg.solve(factor, np.linalg.solve(factor, covariance).T)
    variance, ways = np.linalg.eigh(white)
    information = np.maximum(1.0 / variance - 1.0, np.maximum(share, _LEAST) / variance)
    return np.asarray(covariance + factor @ (ways * (1.0 / information - variance)) @ ways.T @ factor.T)


def covariance_of_news(received: FeatureDensity, k: int, prior: np.ndarray, share: float) -> np.ndarray:
    """Covariance (2F, 2F) [px^2] of kernel k of a message in which shared detections count as news; prior (2F, 2F)
    [px^2]: of the features by the past."""
    covariance = received.covariance[k].copy()
    for f in () if received.sharers is None else np.flatnonzero(received.sharers[k] > 1):
        own = slice(2 * f, 2 * f + 2)
        covariance[own, own] = _news(covariance[own, own], prior[own, own], share)
    return covariance


def as_news(received: FeatureDensity, expected: FeatureDensity, share: float) -> FeatureDensity:
    """A message to a chain that has received the same shared detections before; expected: of the features, by that
    chain. Each association keeps its weight under what is expected: only its information on places is less."""
    if received.sharers is None or share >= 1.0 or not (received.sharers > 1).any():
        return received
    prior = expected.over(received.names).collapsed()
    if not prior.known.all():
        return received
    covariance = received.covariance.copy()
    for k in np.flatnonzero((received.sharers > 1).any(axis=1)):
        covariance[k] = covariance_of_news(received, int(k), prior.covariance[0], share)
    after = replace(received, covariance=covariance)
    return replace(after, log_weight=received.log_weight + received.log_mass(prior) - after.log_mass(prior))
