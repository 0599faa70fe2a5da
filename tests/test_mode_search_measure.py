"""The comparison with scipy uses one energy: values, gradients and minima agree, and the counting is right."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from benchmarks.speed.mode_search import figures
from benchmarks.speed.mode_search_duel import Contest, Duel, Start
from benchmarks.speed.mode_search_residuals import Residuals, robust
from benchmarks.speed.mode_search_scipy import Watched
from benchmarks.speed.mode_search_starts import EXCHANGED, JUMP, KEPT, KINDS, SAMPLE, subsample, tracker_starts

CONTEST = Contest()


def problem(seed: int, distance: float, changed: bool = False) -> tuple[Start, Residuals, np.ndarray]:
    """A start, its residuals and some x within the limits, the root well away from the start."""
    rng = np.random.default_rng(seed)
    start = CONTEST.random_start(distance, rng)
    if changed:
        q_previous = CONTEST.body.integrate(start.q, 0.3 * rng.normal(size=CONTEST.body.nv))
        start = replace(start, q_previous=q_previous, dt=1.0 / 30.0)
    residuals = CONTEST.forms(start)[1]
    x = np.clip(residuals.x0 + distance * rng.normal(size=CONTEST.body.nv), residuals.lower, residuals.upper)
    return start, residuals, x


@pytest.mark.parametrize("changed", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_half_the_squares_are_the_energy(seed: int, changed: bool) -> None:
    start, _, _ = problem(seed, 0.4, changed)
    rng = np.random.default_rng(seed)
    cost, residuals = CONTEST.forms(start)
    assert np.array_equal(residuals.q(residuals.x0), start.q)
    for step in (0.0, 0.1, 0.5):
        x = np.clip(residuals.x0 + step * rng.normal(size=CONTEST.body.nv), residuals.lower, residuals.upper)
        here = cost.at(residuals.q(x))
        r, J = residuals.residuals(x), residuals.jacobian(x)
        assert 0.5 * float(r @ r) == pytest.approx(here.value, rel=1e-12)
        # the joints' part of the gradient is in the same coordinates; the root's only where x's chart begins
        same = slice(6, None) if step else slice(None)
        assert np.allclose((J.T @ r)[same], here.gradient[same], rtol=1e-8, atol=1e-8)


def test_the_jacobian_is_the_derivative() -> None:
    for seed in range(3):
        _, residuals, x = problem(seed, 0.5, changed=True)
        J = residuals.jacobian(x).copy()
        for v in np.random.default_rng(seed).normal(size=(6, len(x))):
            slope = (residuals.residuals(x + 1e-6 * v) - residuals.residuals(x - 1e-6 * v)) / 2e-6
            assert np.allclose(J @ v, slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def test_a_robust_group_halved_and_squared_is_its_potential() -> None:
    e = np.array([[0.0, 0.0], [1e-9, -1e-9], [1e-4, 2e-4], [0.3, -0.4], [30.0, 50.0]])
    r, J = robust(e, np.tile(np.eye(2), (len(e), 1, 1)), 8.0)
    assert np.allclose(np.square(r).sum(axis=1), 8.0 * np.log1p(np.square(e).sum(axis=1) / 8.0), rtol=1e-12, atol=0.0)
    for v in np.eye(2):
        slope = (robust(e + 1e-6 * v, np.zeros((len(e), 2, 1)), 8.0)[0]
                 - robust(e - 1e-6 * v, np.zeros((len(e), 2, 1)), 8.0)[0]) / 2e-6  # fmt: skip
        assert np.allclose(J @ v, slope, atol=1e-8)


def test_near_the_truth_both_find_the_same_minimum() -> None:
    """With a clock that advances at every reading."""
    rng, ticks = np.random.default_rng(1), count()
    contest = Contest(lambda: float(next(ticks)))
    duels = [contest.duel(contest.random_start(0.02, rng), rng) for _ in range(5)]
    assert all(d.converged and d.in_a_tenth <= d.ours for d in duels)
    assert sum(d.ours == pytest.approx(d.theirs, rel=1e-5) for d in duels) >= 4
    assert all(0.0 < d.their_ms <= d.full_ms and 0.0 < d.residual_ms < d.full_ms for d in duels)
    assert all(max(d.ours, d.theirs) < d.energy for d in duels)


def test_reaching_a_level_is_noticed() -> None:
    _, residuals, x = problem(0, 0.2)
    value = 0.5 * float(np.square(residuals.residuals(x)).sum())
    for level, reached in ((1.001 * value, True), (0.999 * value, False)):
        watched = Watched(residuals, level)
        watched.residuals(x)
        assert (watched.reached is not None) == reached


def test_figures_count_what_they_name() -> None:
    def duel(ours: float, in_a_tenth: float) -> Duel:
        return Duel("0.1", 50.0, ours, 10.0, in_a_tenth, 1.0, 12.0, 20.0, 5.0, 10, 20, True)

    summary = figures([duel(10.0, 10.0), duel(10.0 + 1e-4, 8.0), duel(9.0, 9.0), duel(11.0, 11.0)])
    assert summary["ratio"] == summary["ratio_of_totals"] == pytest.approx(12.0)
    assert summary["ratio_to_the_end"] == pytest.approx(20.0)
    assert summary["ratio_without_residuals"] == pytest.approx(15.0)
    assert (summary["no_higher"], summary["scipy_no_higher"], summary["no_higher_in_a_tenth"]) == (0.5, 0.75, 0.75)


def test_the_trackers_starts_are_what_they_are_called() -> None:
    starts = tracker_starts(3, motions=("reach",), frames=4)
    frames = sorted({s.observation.time for s in starts})
    assert len(frames) == 3  # the first frame has no parents
    assert {s.kind for s in starts} == set(KINDS)
    for time in frames:
        here = [s for s in starts if s.observation.time == time]
        parents = {s.q.tobytes() for s in here if s.kind == KEPT}
        assert all(s.q_previous is not None and s.dt == pytest.approx(1.0 / 30.0) for s in here)
        assert all((s.q.tobytes() in parents) == (s.kind in (KEPT, EXCHANGED)) for s in here)
        assert all((s.kind == SAMPLE) != np.array_equal(s.q, s.q_previous) for s in here)
        kept = {s.q.tobytes(): s.observation.pixels for s in here if s.kind == KEPT}
        for s in here:
            assert s.kind == JUMP or s.q_previous.tobytes() in parents  # type: ignore[union-attr]
            assert s.kind != EXCHANGED or not np.array_equal(s.observation.pixels, kept[s.q.tobytes()], equal_nan=True)
    few = subsample(starts, 20, np.random.default_rng(0))
    assert len({id(s) for s in few}) == 20
    assert len(subsample(starts, 10**6, np.random.default_rng(0))) == len(starts)
