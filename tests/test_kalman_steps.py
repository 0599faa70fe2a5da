"""Steps towards features: the Kalman update in closed form for linear features, and the density of the samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimator.inference.chains.feature_density import FeatureDensity, gaussian, uniform
from estimator.trackers.dual_chain.kalman_steps import Length, kalman_steps

NAMES = ("head", "hand")
STD = np.array([0.2, 0.1, 0.3])
CENTRES = np.array([[0.0, 0.1, -0.2], [0.5, 0.0, 0.3]])


def linear() -> tuple[np.ndarray, np.ndarray]:
    """Features (N, F, 2) [px] of the centres and their Jacobian (N, F, 2, D), of features linear in the pose."""
    rng = np.random.default_rng(0)
    H = 100.0 * rng.standard_normal((2, 2, 3))
    return np.einsum("fcd,nd->nfc", H, CENTRES), np.tile(H, (2, 1, 1, 1))


def received_features(spread: float = 5.0) -> FeatureDensity:
    """Two associations: both features, or the hand alone, which leaves the head unknown."""
    both = gaussian(NAMES, np.array([[10.0, 0.0], [-20.0, 5.0]]), spread**2 * np.eye(4))
    known = np.array([[True, True], [False, True]])
    mean = np.stack([both.mean[0], [[0.0, 0.0], [30.0, 30.0]]])
    return FeatureDensity(NAMES, np.log([0.6, 0.4]), known, mean, np.repeat(both.covariance, 2, axis=0))


def test_each_kernel_is_the_linear_gaussian_posterior() -> None:
    predicted, jacobian = linear()
    density = received_features()
    updated = kalman_steps(CENTRES, [Length(1.0, STD)], density, predicted, jacobian)
    for n, centre in enumerate(CENTRES):
        log_weights = []
        for k in range(2):
            dims = density.dims(k)
            H = jacobian[n].reshape(4, 3)[dims]
            R = density.covariance[k][np.ix_(dims, dims)]
            off = density.mean[k].ravel()[dims] - predicted[n].ravel()[dims]
            precision = np.diag(STD**-2) + H.T @ np.linalg.solve(R, H)
            C = np.linalg.inv(precision)
            np.testing.assert_allclose(updated.mean[n, k], centre + C @ H.T @ np.linalg.solve(R, off), atol=1e-9)
            np.testing.assert_allclose(updated.root[n, k] @ updated.root[n, k].T, precision, rtol=1e-9)
            surprise = multivariate_normal(np.zeros(len(dims)), H @ np.diag(STD**2) @ H.T + R).logpdf(off)
            log_weights.append(density.log_weight[k] + surprise)
        np.testing.assert_allclose(updated.log_weight[n], log_weights - np.logaddexp(*log_weights), atol=1e-9)


def test_the_density_is_that_of_what_is_drawn() -> None:
    """The mean of one over the density, over samples inside a box, is the volume of the box."""
    predicted, jacobian = linear()
    updated = kalman_steps(CENTRES, [Length(1.0, STD)], received_features(20.0), predicted, jacobian)
    drawn = updated.sample(np.random.default_rng(1), 200_000)
    log_density = updated.log_density(drawn)
    for n in range(2):
        heavy = int(np.argmax(updated.log_weight[n]))
        middle, scale = (
            updated.mean[n, heavy],
            np.sqrt(np.diag(np.linalg.inv(updated.root[n, heavy] @ updated.root[n, heavy].T))),
        )
        inside = (np.abs(drawn[n] - middle) < scale).all(axis=1)
        volume = np.where(inside, np.exp(-log_density[n]), 0.0).mean()
        assert volume == pytest.approx(np.prod(2.0 * scale), rel=0.05)


def test_without_evidence_or_image_a_step_is_unchanged() -> None:
    predicted, jacobian = linear()
    plain = kalman_steps(CENTRES, [Length(1.0, STD)], uniform(NAMES), predicted, jacobian)
    unseen = kalman_steps(CENTRES, [Length(1.0, STD)], received_features(), np.full_like(predicted, np.nan), jacobian)
    np.testing.assert_allclose(plain.mean[:, 0], CENTRES)
    np.testing.assert_allclose(unseen.mean, np.repeat(CENTRES[:, None], 2, axis=1), atol=1e-12)
    for root in (plain.root[:, 0], unseen.root[:, 1]):
        np.testing.assert_allclose(root, np.tile(np.diag(1.0 / STD), (2, 1, 1)), atol=1e-9)


def test_a_long_step_reaches_farther_than_a_short_one() -> None:
    predicted, jacobian = linear()
    lengths = [Length(0.9, 1e-3 * STD), Length(0.1, STD)]
    updated = kalman_steps(CENTRES, lengths, received_features(), predicted, jacobian)
    assert updated.mean.shape == (2, 4, 3)  # both lengths and both associations
    alone = kalman_steps(CENTRES, lengths[1:], received_features(), predicted, jacobian)
    np.testing.assert_allclose(updated.mean[:, 2:], alone.mean)
    assert (np.exp(updated.log_weight[:, 2:]).sum(axis=1) > 0.99).all()
