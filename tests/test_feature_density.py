"""Densities of image features: products, marginals and moments equal those of the functions that they represent."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.inference.chains.feature_density import FeatureDensity, gaussian, product, uniform
from humanoid.support.errors import InputError

NAMES = ("head", "left_hand", "right_hand")


def mixture(seed: int, names: tuple[str, ...] = NAMES, kernels: int = 3, spread: float = 2.0) -> FeatureDensity:
    """A random mixture in which each kernel but the first is uninformative on one feature."""
    rng = np.random.default_rng(seed)
    size = len(names)
    known = np.ones((kernels, size), dtype=bool)
    known[1:, rng.integers(size)] = False
    roots = rng.normal(size=(kernels, 2 * size, 2 * size))
    covariance = roots @ roots.transpose(0, 2, 1) + 0.5 * np.eye(2 * size)
    return FeatureDensity(
        names, rng.normal(size=kernels), known, spread * rng.normal(size=(kernels, size, 2)), covariance
    )


def test_a_product_is_the_product_of_the_values() -> None:
    a, b = mixture(0), mixture(1, ("left_hand", "other"))
    points = np.random.default_rng(2).normal(size=(50, 4, 2))
    both = a.times(b)
    assert both.names == (*NAMES, "other")
    expected = a.log_density(points[:, :3]) + b.log_density(points[:, [1, 3]])
    np.testing.assert_allclose(both.log_density(points), expected, atol=1e-9)


def test_the_order_of_factors_does_not_matter() -> None:
    factors = [mixture(k) for k in range(3)]
    points = np.random.default_rng(3).normal(size=(20, 3, 2))
    one_way, other_way = (product(f, NAMES, most=1000).log_density(points) for f in (factors, factors[::-1]))
    np.testing.assert_allclose(one_way, other_way, atol=1e-8)


def test_what_is_uniform_changes_nothing() -> None:
    a = mixture(4)
    points = np.random.default_rng(5).normal(size=(20, 3, 2))
    same = a.times(uniform(("right_hand", "head")))
    np.testing.assert_allclose(same.log_density(points), a.log_density(points), atol=1e-12)


def test_a_marginal_is_the_integral() -> None:
    """Over one hand, by a fine grid; the kernels there cover both hands."""
    a = mixture(6, ("left_hand", "right_hand"), kernels=1, spread=0.5)
    h = 0.25
    grid = np.stack(np.meshgrid(*[np.arange(-20.0, 20.0, h)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    for place in (np.zeros(2), np.array([0.7, -0.4])):
        points = np.stack([np.tile(place, (len(grid), 1)), grid], axis=1)
        summed = np.exp(a.log_density(points)).sum() * h * h
        value = np.exp(a.marginal(["left_hand"]).log_density(place[None, None]))[0]
        assert value == pytest.approx(summed, rel=1e-6)


def test_one_kernel_keeps_mean_covariance_and_weight() -> None:
    rng = np.random.default_rng(7)
    a = mixture(8)
    a = FeatureDensity(a.names, a.log_weight, np.ones_like(a.known), a.mean, a.covariance)
    drawn = a.sample(rng, 200_000)[0].reshape(-1, 6)
    single = a.collapsed()
    scale = np.sqrt(np.diag(single.covariance[0]))
    np.testing.assert_allclose(single.mean[0].ravel(), drawn.mean(axis=0), atol=0.02 * scale.max())
    np.testing.assert_allclose(single.covariance[0], np.cov(drawn.T), atol=0.03 * scale.max() ** 2)
    assert np.exp(single.log_weight).sum() == pytest.approx(np.exp(a.log_weight).sum())
    assert np.exp(a.reduced(1).log_weight).sum() == pytest.approx(np.exp(a.log_weight).sum())


def test_what_contradicts_itself_loses_weight_and_nothing_else() -> None:
    a, b = gaussian(("p",), np.zeros((1, 2)), np.eye(2)), gaussian(("p",), np.full((1, 2), 1e5), 1e-6 * np.eye(2))
    both = a.times(b)
    assert both.log_weight[0] < -1e9
    assert np.isfinite(both.mean).all()
    assert np.linalg.eigvalsh(both.covariance[0])[0] > 0.0


@pytest.mark.parametrize("covariance", [np.zeros((2, 2)), np.full((2, 2), np.nan), -np.eye(2)])
def test_an_invalid_covariance_is_refused(covariance: np.ndarray) -> None:
    with pytest.raises(InputError, match="positive definite"):
        gaussian(("p",), np.zeros((1, 2)), covariance)


def test_equal_kernels_are_merged_and_others_are_not() -> None:
    """Features integrated out leave copies, which must not crowd out another association when few are kept."""
    wide = gaussian(("a", "b"), np.array([[0.0, 0.0], [5.0, 5.0]]), np.eye(4))
    away = wide.mean[0] + [[40.0, 0.0], [0.0, 0.0]]
    copies = FeatureDensity(
        wide.names, np.log([0.3, 0.3, 0.25, 0.15]), np.ones((4, 2), bool),
        np.stack([wide.mean[0], wide.mean[0] + [[0.0, 0.0], [90.0, 0.0]], wide.mean[0] + 0.1, away]),
        np.repeat(wide.covariance, 4, axis=0),
    )  # fmt: skip
    few = copies.marginal(["a"]).merged().reduced(2)
    np.testing.assert_allclose(few.weights, [0.85, 0.15])
    np.testing.assert_allclose(few.mean[:, 0], [[0.0, 0.0], [40.0, 0.0]])
