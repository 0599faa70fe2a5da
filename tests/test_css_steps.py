"""The steps of CSS Figure 6, one by one, in the tracker that follows the figure as printed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.data.observation import Observation
from estimator.energy.descent.solution import MAX_STD
from estimator.inference.mixture import Mixture, Mode, bhattacharyya, mixture_of
from estimator.search.frame_search import FrameProblem, FrameSearch
from estimator.search.proposals import LimbProposal
from estimator.search.settings import ModeSearchSettings
from estimator.trackers.css.frame_proposals import Proposals
from estimator.trackers.css.settings import PAPER, REFINED
from estimator.trackers.css.tracker import CovarianceScaledSampling
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import MixtureState
from estimator.tracking.registry import make_tracker, settings_for

BODY = body_of("arm8")
CAMERA = camera_at(20.0, distance=4.0)


@cache
def prior() -> Mixture:
    """Four modes of known weights, far from each other."""
    rng = np.random.default_rng(3)
    covariance, zero = np.diag(np.linspace(0.01, 0.04, BODY.nv)), np.zeros(BODY.nv)
    modes = [Mode(random_pose(BODY, rng, share=0.5), covariance, 0.0, "converged", zero) for _ in range(4)]
    return mixture_of(tuple(modes), np.log([0.5, 0.3, 0.15, 0.05]))


@cache
def step(modes: int) -> tuple[CovarianceScaledSampling, FrameResult]:
    """What is kept of the frame of `seen`."""
    tracker = make_tracker("css-paper", BODY, settings_for("css-paper", modes=modes))
    assert isinstance(tracker, CovarianceScaledSampling)
    return tracker, tracker.step(np.random.default_rng(2), MixtureState(prior(), 0.0), seen())[1]


@cache
def seen() -> Observation:
    """A frame of one noisy camera, which leaves several modes."""
    q = random_pose(BODY, np.random.default_rng(33), share=0.5)
    return observe(BODY, q, [CAMERA], noise=2.0, rng=np.random.default_rng(8), time=0.04)


def test_step_1_the_proposal_is_the_rescaled_covariance() -> None:
    """s of the figure multiplies the covariance, by 4 to 14; here its root multiplies standard deviations."""
    assert 4.0 <= PAPER.scale**2 <= 14.0
    assert PAPER.shape == "covariance"
    assert PAPER.tail == 0.0  # Gaussian


def test_steps_2_1_and_2_2_components_are_drawn_by_their_weights_and_sampled_wide() -> None:
    tracker, mixture, count = step(4)[0], prior(), 4000
    search = tracker.search
    case = FrameProblem(search.associations(seen()), 0.04)
    settings = tracker.settings.proposals
    proposals = Proposals(search, LimbProposal(BODY), settings, np.random.default_rng(5), mixture, case, seen())
    samples = proposals.samples(count)
    shares = np.bincount([h.parent for h in samples], minlength=4) / count
    np.testing.assert_allclose(shares, mixture.weights, atol=4.0 * np.sqrt(0.25 / count))
    inner = 0.5 * (BODY.lower + BODY.upper)
    narrow = mixture_of((Mode(inner, 1e-4 * np.eye(BODY.nv), 0.0, "converged", np.zeros(BODY.nv)),), np.zeros(1))
    rng = np.random.default_rng(6)
    drawn = Proposals(search, LimbProposal(BODY), settings, rng, narrow, case, seen()).samples(count)
    spread = np.std([BODY.difference(inner, h.q) for h in drawn], axis=0)
    np.testing.assert_allclose(spread, PAPER.scale * 0.01, rtol=0.06)


def test_step_2_3_modes_are_minima_of_the_static_energy_and_distinct() -> None:
    """From this frame's data alone: changes since the previous frame are not penalised (footnote 5)."""
    tracker, result = step(4)
    search = tracker.search
    cost = search.model.cost(search.term(seen(), "as_detected"))
    for q, energy, covariance in zip(result.q, result.energy, result.covariance, strict=True):
        at = cost.at(q)
        assert energy == pytest.approx(at.value, rel=1e-12)
        free = np.diag(covariance) > 0.0
        assert free.sum() > 4
        assert np.abs(at.gradient[free]).max() < 1e-5
        precision = at.hessian[np.ix_(free, free)] + np.eye(free.sum()) / MAX_STD**2
        np.testing.assert_allclose(covariance[np.ix_(free, free)] @ precision, np.eye(free.sum()), atol=1e-9)
    points = [BODY.landmarks(BODY.at(q)) for q in result.q]
    apart = [np.abs(a - b).max() for i, a in enumerate(points) for b in points[:i]]
    assert min(apart) > 0.01


def test_step_2_3_every_sample_is_optimised_to_convergence(monkeypatch: pytest.MonkeyPatch) -> None:
    """As printed; otherwise only the best of those that differ after a short search, and some to spare."""
    counted: list[str] = []
    refine = FrameSearch.refine
    monkeypatch.setattr(FrameSearch, "refine", lambda self, c: (counted.append(str(c.q)), refine(self, c))[1])
    best = {}
    for how in REFINED:
        counted.clear()
        tracker = make_tracker("css-paper", BODY, settings_for("css-paper", changes={"css": {"refine": how}}))
        result = tracker.step(np.random.default_rng(2), MixtureState(prior(), 0.0), seen())[1]
        best[how] = len(counted), result.energy.min()
    assert best["all"][0] == PAPER.budget.searches == PAPER.samples
    assert best["best"][0] <= PAPER.modes + ModeSearchSettings().spare
    assert best["all"][1] <= best["best"][1] + 1e-9
    assert PAPER.refine == "all"


def test_steps_3_to_6_weights_are_heights_times_those_of_the_closest_prior_modes() -> None:
    """Each prior mode is used once, in the order of the new modes' heights (5); then all sum to one (6)."""
    _, result = step(4)
    mixture = prior()
    assert len(result.weight) == 4
    left, weights = [0, 1, 2, 3], np.zeros(len(result.weight))
    for k in np.argsort(result.energy, kind="stable"):
        closest = min(
            left,
            key=lambda i, k=k: bhattacharyya(  # type: ignore[misc]
                BODY, mixture.modes[i].q, mixture.modes[i].covariance, result.q[k], result.covariance[k]
            ),
        )
        left.remove(closest)
        assert result.parent[k] == closest
        weights[k] = np.exp(result.energy.min() - result.energy[k]) * mixture.weights[closest]  # 3, 5
    np.testing.assert_allclose(result.weight, weights / weights.sum(), rtol=1e-9)
    assert not np.allclose(result.weight, np.exp(-result.energy) / np.exp(-result.energy).sum(), rtol=0.01)


def test_step_4_the_best_are_kept() -> None:
    """From the same samples: those of the least energy, before the prior is applied."""
    (_, all_of_them), (_, kept) = step(4), step(2)
    least = np.argsort(all_of_them.energy)[:2]
    assert sorted(kept.energy) == pytest.approx(sorted(all_of_them.energy[least]))
    assert len(kept.weight) == 2
    assert kept.weight.sum() == pytest.approx(1.0)
