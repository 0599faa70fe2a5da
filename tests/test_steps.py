"""Random steps in a box: their density is that of the samples, and nothing leaves the box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest

from estimator.trackers.dual_chain.steps import TruncatedSteps

GROUPS = (np.array([0]), np.array([2, 1]))
STEPS = TruncatedSteps(
    np.array([0.3, 0.2, 0.5]), np.array([-1.0, -np.inf, 0.0]), np.array([1.0, np.inf, 2.0]), GROUPS, 0.2, 4.0
)
CENTRES = np.array([[-1.5, 0.0, 0.1], [0.9, 0.3, 1.0], [0.0, -0.2, 2.0]])
WEIGHTS = np.array([0.5, 0.3, 0.2])


def test_the_density_of_each_dimension_integrates_to_one() -> None:
    steps = replace(STEPS, groups=tuple(np.array([d]) for d in range(3)))
    for d in range(3):

        def density(x: float, d: int = d) -> float:
            point = np.zeros((1, 3))
            point[0, d] = x
            return float(np.exp(steps.reach(CENTRES, WEIGHTS).log_density(point, d)[0]))

        low, high = max(steps.lower[d], -9.0), min(steps.upper[d], 9.0)
        assert quad(density, low, high, points=[0.0, 0.3], limit=200)[0] == pytest.approx(1.0, abs=1e-7)


def test_what_is_drawn_has_the_density() -> None:
    """The distribution of each dimension, by the integral of its density on a grid (Kolmogorov and Smirnov)."""
    rng = np.random.default_rng(0)
    chosen = CENTRES[rng.choice(3, size=20_000, p=WEIGHTS)]
    drawn = STEPS.moved(rng, chosen)
    assert (drawn >= STEPS.lower).all()
    assert (drawn <= STEPS.upper).all()
    steps = replace(STEPS, groups=tuple(np.array([d]) for d in range(3)))
    for d in range(3):
        grid = np.linspace(max(steps.lower[d], -8.0), min(steps.upper[d], 8.0), 20_001)
        at = np.zeros((len(grid), 3))
        at[:, d] = grid
        density = np.exp(steps.reach(CENTRES, WEIGHTS).log_density(at, d))
        level = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(grid))])
        assert kstest(drawn[:, d], lambda x, g=grid, p=level: np.interp(x, g, p)).pvalue > 0.01


def test_dimensions_of_a_group_step_far_together() -> None:
    rng = np.random.default_rng(1)
    free = replace(STEPS, lower=np.full(3, -np.inf), upper=np.full(3, np.inf))
    far = np.abs(free.moved(rng, np.zeros((20_000, 3)))) > 3.5 * free.std
    assert far.mean(axis=0) == pytest.approx(0.2 * 2.0 * 0.190787, abs=0.01)  # P(|N(0, 16)| > 3.5)
    both = (far[:, 1] & far[:, 2]).mean()
    assert both > 2.0 * far[:, 0].mean() * far[:, 1].mean()
    assert both == pytest.approx(0.2 * 0.3816**2, abs=0.005)


def test_a_point_far_from_everything_still_has_a_density() -> None:
    value = STEPS.reach(CENTRES, WEIGHTS).log_density(np.array([[0.0, 1e4, 1.0]]), 1)
    assert np.isfinite(value).all()
    assert value[0] < -1e6


def test_a_step_from_a_centre_of_its_own_is_a_mixture_of_that_alone() -> None:
    points = STEPS.moved(np.random.default_rng(3), CENTRES)
    for k in range(len(GROUPS)):
        each = STEPS.reach(CENTRES, WEIGHTS).log_density_each(points, np.arange(3), k)
        alone = [STEPS.reach(CENTRES[n : n + 1], np.ones(1)).log_density(points[n : n + 1], k)[0] for n in range(3)]
        np.testing.assert_allclose(each, alone, atol=1e-12)
