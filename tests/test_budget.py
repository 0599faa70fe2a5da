"""The budget of a frame, and the weights of modes."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose
from scipy.stats import multivariate_normal

from estimator.data.observation import Observation
from estimator.energy.cost import Cost, QuadraticModel
from estimator.search.cost_model import CostModel
from estimator.search.hypothesis import Hypothesis
from estimator.search.volumes import Surroundings, importance_log_volumes
from estimator.trackers.css.settings import BudgetSettings, Source, allocated
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body, PosedBody
from humanoid.support.errors import InputError


def source(share: float, most: int, mark: int) -> Source:
    return Source(share, lambda count: [Hypothesis(np.zeros(1), mark)] * min(count, most))


def marks(hypotheses: list[Hypothesis]) -> list[int]:
    return [sum(h.association == mark for h in hypotheses) for mark in range(3)]


def test_the_budget_is_shared_by_parts_and_never_exceeded() -> None:
    assert marks(allocated(20, [source(2, 99, 0), source(1, 99, 1), source(1, 99, 2)])) == [10, 5, 5]
    assert marks(allocated(20, [source(2, 4, 0), source(1, 99, 1), source(1, 99, 2)])) == [4, 8, 8]  # handed on
    assert marks(allocated(3, [source(1, 99, 0), source(0, 99, 1), source(9, 99, 2)])) == [0, 0, 3]
    assert allocated(0, [source(1, 99, 0)]) == []
    assert allocated(5, []) == []
    for count in range(12):
        assert len(allocated(count, [source(3, 99, 0), source(5, 99, 1), source(2, 99, 2)])) == count


def test_more_is_spent_when_the_energy_jumps_or_the_modes_are_equal() -> None:
    budget = BudgetSettings(searches=40, calm=0.25, alarm=10.0)
    assert budget.left(7, -3.0, 0.0) == round(0.25 * 33)
    assert budget.left(7, 10.0, 0.0) == 33
    assert budget.left(7, 0.0, 0.5) == round((0.25 + 0.75 * 0.5) * 33)
    assert [budget.left(7, r, 0.0) for r in range(11)] == sorted(budget.left(7, r, 0.0) for r in range(11))
    assert budget.left(50, 99.0, 1.0) == 0
    with pytest.raises(InputError, match="calm"):
        BudgetSettings(calm=1.5)


@pytest.mark.parametrize("searches", [9, 25])
def test_a_frame_never_has_more_searches_than_its_budget(searches: int, monkeypatch: pytest.MonkeyPatch) -> None:
    body, rng = body_of("human34"), np.random.default_rng(2)
    frames: list[Observation] = []
    for i in range(5):
        q = random_pose(body, rng) if i == 3 else body.neutral  # the fourth frame comes as a surprise
        frames.append(observe(body, q, [camera_at(20.0, distance=4.0)], noise=2.0, rng=rng, index=i, time=0.04 * i))
    tracker = make_tracker("css", body, settings_for("css", changes={"css": {"budget": {"searches": searches}}}))
    counts: list[int] = []
    explored = tracker.search.explored

    def counted(hypotheses, case):  # type: ignore[no-untyped-def]
        kept = explored(hypotheses, case)
        counts.append(len(kept))
        return kept

    steps = run(tracker, frames, 0)
    next(steps)
    monkeypatch.setattr(tracker.search, "explored", counted)
    list(steps)
    each = [a + b for a, b in zip(counts[::2], counts[1::2], strict=True)]
    assert len(each) == 4
    assert max(each) <= searches
    assert each[2] == searches  # the surprise
    assert each[0] < searches


class Bowl:
    """Energy of a Gaussian in the tangent space at `centre`, with a slope against the limits where one is given."""

    name = "bowl"

    def __init__(self, body: Body, centre: np.ndarray, hessian: np.ndarray, slope: np.ndarray) -> None:
        self._body, self._centre, self._hessian, self._slope = body, centre, hessian, slope

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        e = self._body.difference(self._centre, posed.q)
        gradient += self._hessian @ e + self._slope
        hessian += self._hessian
        return float(0.5 * e @ self._hessian @ e + self._slope @ e)

    def value(self, posed: PosedBody) -> float:
        """See `estimator.energy.term.Term`."""
        return self.accumulate(posed, np.zeros(self._body.nv), np.zeros((self._body.nv, self._body.nv)))


def bowl(seed: int, at_limit: int | None = None) -> tuple[Body, Cost, QuadraticModel]:
    body, rng = body_of("arm8"), np.random.default_rng(seed)
    spread = rng.uniform(0.02, 0.06, body.nv)
    turn = np.linalg.qr(rng.standard_normal((body.nv, body.nv)))[0]
    hessian = turn @ np.diag(spread**-2.0) @ turn.T
    q, slope = 0.5 * (body.lower + body.upper), np.zeros(body.nv)
    if at_limit is not None:
        hessian[at_limit] = hessian[:, at_limit] = 0.0  # the posterior falls exponentially away from the limit
        q[at_limit], slope[at_limit] = body.lower[at_limit], 30.0
    cost = Cost(body, [Bowl(body, q, hessian, slope)])
    return body, cost, cost.at(q)


@pytest.mark.parametrize("at_limit", [None, 2])
def test_the_volume_of_a_gaussian_is_known(at_limit: int | None) -> None:
    """Both estimates agree up to the weak prior on unobserved directions; against a limit the density is
    exponential."""
    body, cost, at = bowl(4, at_limit)
    free = [k for k in range(body.nv) if k != at_limit]
    known = 0.5 * (len(free) * np.log(2.0 * np.pi) - np.linalg.slogdet(at.hessian[np.ix_(free, free)])[1])
    known -= 0.0 if at_limit is None else np.log(30.0)
    assert Surroundings(body, at).log_volume == pytest.approx(known, abs=0.02)
    (volume,) = importance_log_volumes(np.random.default_rng(0), body, [(at, cost)], 4000)
    assert volume == pytest.approx(known, abs=0.08)


def test_surroundings_are_a_density() -> None:
    """Its own samples follow it, and its integral is one: the mean of another known density over it, taken over its
    samples, is that density's integral."""
    body, _, at = bowl(5)
    about = Surroundings(body, at)
    rng = np.random.default_rng(1)
    samples = [about.sample(rng) for _ in range(4000)]
    drawn = [q for q in samples if q is not None]
    assert len(drawn) > 0.99 * len(samples)  # a few are beyond the limits
    within = np.array([about.log_density(q) for q in drawn])
    steps = np.array([body.difference(at.posed.q, q) for q in drawn])
    narrow = multivariate_normal(np.zeros(body.nv), 0.8 * np.linalg.inv(at.hessian))
    assert np.exp(narrow.logpdf(steps) - within).sum() / len(samples) == pytest.approx(1.0, abs=0.05)
    beyond = about.log_density(body.integrate(at.posed.q, np.full(body.nv, 0.5)))
    assert beyond < within.min()


def test_modes_that_coincide_share_their_weight() -> None:
    body, cost, at = bowl(6)
    rng = np.random.default_rng(2)
    (alone,) = importance_log_volumes(rng, body, [(at, cost)], 3000)
    twice = importance_log_volumes(rng, body, [(at, cost), (at, cost)], 3000)
    np.testing.assert_allclose(twice, alone - np.log(2.0), atol=0.1)


def test_weights_by_volume_and_by_importance_agree_on_a_well_observed_body() -> None:
    body, rng = body_of("arm8"), np.random.default_rng(7)
    seen = observe(body, 0.5 * (body.lower + body.upper), [camera_at(20.0, distance=3.0)], noise=1.0, rng=rng)
    model = CostModel(body)
    cost = model.cost(model.observation_term(seen))
    at = make_tracker("css", body).search.seeker.seek(cost, 0.5 * (body.lower + body.upper)).quadratic
    laplace = Surroundings(body, cost.of(at.posed)).log_volume
    (sampled,) = importance_log_volumes(rng, body, [(cost.of(at.posed), cost)], 2000)
    assert sampled == pytest.approx(laplace, abs=1.0)
