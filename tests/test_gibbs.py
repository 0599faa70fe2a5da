"""Maximum entropy densities: known answers, and the required moments."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.trackers.loose_limbed.limbs.models import Gibbs, all_pairs, fitted, log_marginal

LEVELS = (3, 2, 4)


def drawn(p: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    flat = rng.choice(p.size, size=count, p=p.ravel())
    return np.stack(np.unravel_index(flat, p.shape), axis=1)


@pytest.fixture(scope="module")
def examples() -> np.ndarray:
    rng = np.random.default_rng(0)
    p = rng.uniform(0.2, 1.0, LEVELS)
    return drawn(p / p.sum(), 4000, rng)


def shares(states: np.ndarray, kept: tuple[int, ...]) -> np.ndarray:
    counted = np.zeros([LEVELS[i] for i in kept])
    np.add.at(counted, tuple(states[:, i] for i in kept), 1.0 / len(states))
    return counted


def test_its_joint_marginals_are_those_of_the_examples(examples: np.ndarray) -> None:
    log_p = fitted(examples, LEVELS, all_pairs(3), regularisation=0.0).log_density()
    assert np.exp(log_p).sum() == pytest.approx(1.0)
    for pair in all_pairs(3):
        np.testing.assert_allclose(np.exp(log_marginal(log_p, pair)), shares(examples, pair), atol=1e-4)


def test_of_a_chain_it_is_the_product_of_conditionals(examples: np.ndarray) -> None:
    """Of densities with the marginals (0, 1) and (1, 2) that of greatest entropy has 0 and 2 independent given 1."""
    p = np.exp(fitted(examples, LEVELS, ((0, 1), (1, 2)), regularisation=0.0).log_density())
    left, right, middle = shares(examples, (0, 1)), shares(examples, (1, 2)), shares(examples, (1,))
    np.testing.assert_allclose(p, left[:, :, None] * right[None] / middle[:, None], atol=1e-4)


def test_no_other_weights_are_likelier(examples: np.ndarray) -> None:
    best = fitted(examples, LEVELS, all_pairs(3), regularisation=0.0)
    rng, at = np.random.default_rng(1), tuple(examples.T)
    likeliest = best.log_density()[at].mean()
    for _ in range(20):
        other = tuple(w + 0.05 * rng.standard_normal(w.shape) for w in best.weights)
        assert Gibbs(LEVELS, best.marginals, other).log_density()[at].mean() < likeliest


def test_what_was_never_seen_stays_possible() -> None:
    states = np.zeros((1000, 3), dtype=int)
    log_p = fitted(states, LEVELS, all_pairs(3)).log_density()
    assert log_p[0, 0, 0] > np.log(0.9)
    assert np.isfinite(log_p).all()
    assert log_p.min() > -40.0
