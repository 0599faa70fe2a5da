"""Likelihoods applied by powers, with moves: known posteriors and evidence, and moves that preserve a density."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from estimator.inference.annealing import normalised, systematic
from estimator.trackers.dual_chain.walk import SampleBox, TemperingSettings, Walk, tempered

GROUPS = (np.array([0, 1]), np.array([2]))
WELLS = np.array([[1.2, -0.8, 0.5], [-1.0, 1.0, -1.5]])
SHARES, WIDTH = np.array([0.3, 0.7]), 0.15


def log_normal(x: np.ndarray, mean: np.ndarray, std: float) -> np.ndarray:
    """Logarithms (N,) of a normal density at x (N, D)."""
    return np.asarray(-0.5 * np.square((x - mean) / std).sum(axis=1) - x.shape[1] * np.log(std * np.sqrt(2.0 * np.pi)))


@dataclass(frozen=True)
class Rows:
    """Samples unchanged."""

    x: np.ndarray

    def of(self, rows: np.ndarray) -> Rows:
        return Rows(self.x[rows])


@dataclass(frozen=True)
class Plain:
    """A standard normal past, a message, a likelihood."""

    log_message_of: Callable[[np.ndarray], np.ndarray]
    likelihood_of: Callable[[np.ndarray], np.ndarray]

    def of_group(self, x: np.ndarray, group: int) -> np.ndarray:
        return log_normal(x[:, GROUPS[group]], np.zeros(len(GROUPS[group])), 1.0)

    def prepared(self, x: np.ndarray) -> Rows:
        return Rows(x)

    def log_message(self, samples: Rows) -> np.ndarray:
        return self.log_message_of(samples.x)

    def likelihood(self, samples: Rows) -> np.ndarray:
        return self.likelihood_of(samples.x)


def nothing(x: np.ndarray) -> np.ndarray:
    return np.zeros(len(x))


def wells(x: np.ndarray) -> np.ndarray:
    each = [np.log(share) + log_normal(x, well, WIDTH) for share, well in zip(SHARES, WELLS, strict=True)]
    return np.asarray(np.logaddexp(*each))


def box(reach: float = np.inf) -> SampleBox:
    return SampleBox(GROUPS, np.ones(3), np.full(3, -reach), np.full(3, reach))


@pytest.mark.parametrize("chosen_by", [0.0, 0.3])
def test_two_wells_have_their_shares_places_and_evidence(chosen_by: float) -> None:
    """A standard normal past and two narrow wells: every figure of the posterior has a closed form. Also from samples
    preselected by a power of the likelihood."""
    masses = SHARES * np.exp([log_normal(well[None], np.zeros(3), np.hypot(1.0, WIDTH))[0] for well in WELLS])
    runs = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        x = rng.standard_normal((30_000 if chosen_by else 1500, 3))
        weights, before = normalised(chosen_by * wells(x))
        x = x[systematic(rng, weights, 1500)]
        slowly = TemperingSettings(survival=0.5, moves=3)
        result = tempered(rng, x, -chosen_by * wells(x), Plain(nothing, wells), box(), slowly, chosen_by)
        assert result is not None
        first = np.linalg.norm(result.x - WELLS[0], axis=1) < np.linalg.norm(result.x - WELLS[1], axis=1)
        runs.append(
            (
                result.log_evidence + before,
                first.mean(),
                *result.x[~first].mean(axis=0),
                result.x[~first].std(axis=0).mean(),
            )
        )
        assert result.powers > (1 if chosen_by else 3)
        assert 0.05 < result.accepted < 0.95
    runs_of = np.array(runs)
    error = runs_of.std(axis=0) / np.sqrt(len(runs))
    shrunk = WELLS[1] / (1.0 + WIDTH**2)
    spread = np.sqrt(1.0 / (1.0 + WIDTH**-2))
    expected = [np.log(masses.sum()), masses[0] / masses.sum(), *shrunk]
    assert (np.abs(runs_of.mean(axis=0)[:5] - expected) < 4.0 * error[:5] + [0.05, 0.02, 0.01, 0.01, 0.01]).all()
    assert runs_of[:, 5].mean() == pytest.approx(spread, rel=0.05)


def test_moves_leave_a_density_as_it_is() -> None:
    """Samples of the posterior, with groups coupled by messages: still its samples after many moves, though each of
    them moved."""
    pull = np.array([[1.0, 0.0, -1.0]])

    def log_message(x: np.ndarray) -> np.ndarray:
        return np.asarray(-2.0 * np.square(x @ pull[0] - 0.5))

    def likelihood(x: np.ndarray) -> np.ndarray:
        return np.asarray(-3.0 * np.square(x[:, 1] - 1.0))

    precision = np.eye(3) + 4.0 * pull.T @ pull + 0.5 * 6.0 * np.diag([0.0, 1.0, 0.0])
    covariance = np.linalg.inv(precision)
    mean = covariance @ (4.0 * 0.5 * pull[0] + 0.5 * 6.0 * np.array([0.0, 1.0, 0.0]))
    rng = np.random.default_rng(3)
    x = rng.multivariate_normal(mean, covariance, size=20_000)
    walk = Walk(rng, Plain(log_message, likelihood), box())
    samples, shares = walk.initial_samples(x, likelihood(x)), []
    for _ in range(15):
        samples, share = walk.moved(samples, 0.5)
        shares.append(share)
    np.testing.assert_allclose(samples.x.mean(axis=0), mean, atol=0.025)
    np.testing.assert_allclose(np.cov(samples.x.T), covariance, atol=0.025)
    assert min(shares) > 0.2
    assert not np.isin(samples.x, x).all(axis=1).any()
    np.testing.assert_allclose(samples.log_message, log_message(samples.x))
    np.testing.assert_allclose(samples.likelihood, likelihood(samples.x))


def test_nothing_moves_out_of_its_box() -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(-1.0, 1.0, size=(400, 3))
    result = tempered(rng, x, np.zeros(400), Plain(nothing, wells), box(1.0), TemperingSettings())
    assert result is not None
    assert np.abs(result.x).max() <= 1.0


def test_all_at_once_is_plain_selection() -> None:
    rng = np.random.default_rng(5)
    x = rng.standard_normal((300, 3))
    log_weight = rng.standard_normal(300)
    result = tempered(
        np.random.default_rng(6), x, log_weight, Plain(nothing, wells), box(), TemperingSettings(powers=1)
    )
    assert result is not None
    weights, log_mean = normalised(log_weight + wells(x))
    np.testing.assert_array_equal(result.x, x[systematic(np.random.default_rng(6), weights, 300)])
    assert result.log_evidence == log_mean
    assert result.powers == 1


def test_impossible_states_are_left_out_and_all_of_them_give_none() -> None:
    def half(x: np.ndarray) -> np.ndarray:
        return np.where(x[:, 0] > 0.0, wells(x), -np.inf)

    rng = np.random.default_rng(7)
    x = rng.standard_normal((300, 3))
    result = tempered(rng, x, np.zeros(300), Plain(nothing, half), box(), TemperingSettings())
    assert result is not None
    assert (result.x[:, 0] > 0.0).all()
    never = Plain(nothing, lambda x: np.full(len(x), -np.inf))
    assert tempered(rng, x, np.zeros(300), never, box(), TemperingSettings()) is None
    assert tempered(rng, x, np.full(300, -np.inf), Plain(nothing, wells), box(), TemperingSettings()) is None


def test_powers_respect_their_bound_and_equal_generators_give_equal_bits() -> None:
    runs = []
    for powers in (2, 4, 4):
        rng = np.random.default_rng(8)
        x = rng.standard_normal((200, 3))
        result = tempered(rng, x, np.zeros(200), Plain(nothing, wells), box(), TemperingSettings(powers=powers))
        assert result is not None
        assert result.powers <= powers
        runs.append(result.x)
    assert any(not np.array_equal(a, b) for a, b in pairwise(runs[:2]))
    np.testing.assert_array_equal(runs[1], runs[2])
