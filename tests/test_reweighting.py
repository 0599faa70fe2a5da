"""The weights of modes that were found without the past (ELMO eqs. 4 to 6)."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from estimator.inference.mixture import Mixture, Mode, mixture_of
from estimator.trackers.elmo.tracker import diffusion_std, reweighted
from humanoid.kinematics.body import Body

ARM = body_of("arm8")


def covariance_of(rng: np.random.Generator, size: float) -> np.ndarray:
    """The covariance of a mode: correlated, with standard deviations about `size`."""
    root = size * (np.eye(ARM.nv) + 0.3 * rng.normal(size=(ARM.nv, ARM.nv)))
    return np.asarray(root @ root.T)


def mixture(rng: np.random.Generator, count: int, size: float) -> Mixture:
    """Modes of standard deviation `size` within a radian of the middle."""
    modes = [
        Mode(
            ARM.neutral + 0.5 * rng.uniform(-1.0, 1.0, ARM.nq),
            covariance_of(rng, size),
            0.0,
            "converged",
            np.zeros(ARM.nv),
        )
        for _ in range(count)
    ]
    return mixture_of(tuple(modes), rng.normal(size=count))


def exact(likelihood: Mixture, prior: Mixture, diffused: np.ndarray) -> np.ndarray:
    """Weight (L,) of the product of both mixtures about each mode of the likelihood: all L x K products of two
    Gaussians, in an arm's plain vector space."""
    terms = [
        [
            np.log(w) + multivariate_normal.logpdf(m.q, p.q, m.covariance + p.covariance + diffused)
            for p, w in zip(prior.modes, prior.weights, strict=True)
        ]
        for m in likelihood.modes
    ]
    scores = np.log(likelihood.weights) + logsumexp(terms, axis=1)
    return np.asarray(np.exp(scores - logsumexp(scores)))


def weights_of(likelihood: Mixture, prior: Mixture, std: np.ndarray, body: Body = ARM) -> np.ndarray:
    """By equation 6."""
    scores = reweighted(body, [m.q for m in likelihood.modes], np.log(likelihood.weights), prior, std).log_scores
    return np.asarray(np.exp(scores - logsumexp(scores)))


def test_it_converges_to_the_exact_product_as_the_diffusion_widens() -> None:
    rng = np.random.default_rng(0)
    std = np.full(ARM.nv, 0.4)
    worst = []
    for size in (0.2, 0.05, 0.01):
        pairs = [(mixture(rng, 5, size), mixture(rng, 4, size)) for _ in range(10)]
        off = [np.abs(weights_of(x, p, std) - exact(x, p, np.diag(std**2))).max() for x, p in pairs]
        worst.append(max(off))
    assert worst[0] > 0.02
    assert worst[1] < worst[0]
    assert worst[2] < 2e-3


def test_with_covariances_it_is_the_exact_product_however_wide_modes_are() -> None:
    rng = np.random.default_rng(6)
    std = rng.uniform(0.1, 0.4, ARM.nv)
    for size in (0.5, 0.05):
        x, prior = mixture(rng, 5, size), mixture(rng, 4, size)
        modes, wide = [m.q for m in x.modes], [m.covariance for m in x.modes]
        scores = reweighted(ARM, modes, np.log(x.weights), prior, std, covariance=wide).log_scores
        weights = np.exp(scores - logsumexp(scores))
        np.testing.assert_allclose(weights, exact(x, prior, np.diag(std**2)), rtol=1e-9)


def test_a_wide_prior_leaves_the_likelihood() -> None:
    rng = np.random.default_rng(1)
    likelihood, prior = mixture(rng, 5, 0.05), mixture(rng, 4, 0.05)
    np.testing.assert_allclose(weights_of(likelihood, prior, np.full(ARM.nv, 1e4)), likelihood.weights, rtol=1e-6)


def test_modes_far_from_the_prior_keep_weights() -> None:
    rng = np.random.default_rng(2)
    likelihood, prior = mixture(rng, 5, 0.05), mixture(rng, 4, 0.05)
    std = np.full(ARM.nv, 1e-4)  # thousands of standard deviations away
    modes, shares = [m.q for m in likelihood.modes], np.log(likelihood.weights)
    scores = reweighted(ARM, modes, shares, prior, std).log_scores
    terms = [[multivariate_normal.logpdf(q, p.q, np.diag(std**2)) for p in prior.modes] for q in modes]
    expected = shares + logsumexp(np.log(prior.weights) + terms, axis=1)
    np.testing.assert_allclose(scores - scores[0], expected - expected[0], rtol=1e-9)


def test_a_mode_descends_from_the_one_that_it_lies_at() -> None:
    rng = np.random.default_rng(3)
    prior = mixture(rng, 4, 0.05)
    near = [mode.q + 0.01 for mode in prior.modes[::-1]]
    assert reweighted(ARM, near, np.zeros(4), prior, np.full(ARM.nv, 0.1)).parent.tolist() == [3, 2, 1, 0]


def test_a_jump_costs_at_most_its_penalty_and_has_no_parent() -> None:
    """The bound is a uniform share beside the paper's sum, for any pose."""
    rng = np.random.default_rng(5)
    prior, std = mixture(rng, 4, 0.05), np.full(ARM.nv, 0.1)
    q = [prior.modes[0].q + away for away in (0.0, 0.05, 0.1, 3.0)]
    paper = reweighted(ARM, q, np.zeros(4), prior, std)
    bounded = reweighted(ARM, q, np.zeros(4), prior, std, jump=7.0)
    np.testing.assert_allclose(np.exp(bounded.log_scores), np.exp(paper.log_scores) + np.exp(-7.0), rtol=1e-12)
    assert paper.log_scores[3] < -1000.0
    assert bounded.log_scores[3] == pytest.approx(-7.0)
    assert bounded.parent[3] == -1
    assert bounded.parent[0] == paper.parent[0] >= 0


def test_scores_do_not_depend_on_where_the_body_stands() -> None:
    """Differences are those of the manifold: weights do not change when modes and prior are turned and moved
    together."""
    body, rng = body_of("human34"), np.random.default_rng(4)
    tangents = 0.2 * rng.normal(size=(5, body.nv))

    def scores(placed: np.ndarray) -> np.ndarray:
        q = [body.integrate(placed, v) for v in tangents]
        modes = tuple(Mode(x, np.eye(body.nv), 0.0, "converged", np.zeros(body.nv)) for x in q[:2])
        return reweighted(body, q[2:], np.zeros(3), mixture_of(modes, np.zeros(2)), np.full(body.nv, 0.5)).log_scores

    move = np.concatenate([3.0 * rng.normal(size=6), np.zeros(body.nv - 6)])
    np.testing.assert_allclose(scores(body.integrate(body.neutral, move)), scores(body.neutral), atol=1e-8)


def test_the_diffusion_grows_with_time_and_never_vanishes() -> None:
    speed, floor = np.array([6.0, 3.0]), np.array([0.2, 0.1])
    np.testing.assert_allclose(diffusion_std(speed, 0.0, floor), floor)
    np.testing.assert_allclose(diffusion_std(speed, 100.0, floor), 100.0 * speed, rtol=1e-6)
