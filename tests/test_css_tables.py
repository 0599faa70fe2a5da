"""The measures of CSS's Table 1: the paper's regime, honest minima, rules of counting, and plots."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.papers_css.css_figures import draw_all
from benchmarks.papers_css.css_figures_valleys import LEAP, valleys
from benchmarks.papers_css.css_tables import PAPER, compared, statistics
from benchmarks.papers_css.css_tables_jumps import SEARCHERS, Hunt, HuntTask, hunted
from benchmarks.papers_css.css_tables_minima import WITHIN, RowTask, Rule, Searches, distinct, known_problem, searched
from benchmarks.papers_css.css_tables_problem import SEARCH
from benchmarks.papers_css.css_tables_proposals import TRIED, tempered
from benchmarks.papers_css.css_tables_regimes import TRACKERS, TrialTask, counted
from benchmarks.support.figure_file import write_figure
from estimator.energy.descent.seek import Seeker

FEW = 60


@pytest.fixture(scope="module")
def rows() -> dict[str, Searches]:
    return {m: searched(RowTask(0, m, 8.0, FEW)) for m in ("CSS", "SS")}


def test_the_regime_is_the_papers() -> None:
    """A spectrum near 2000:1 and spherical samples as far away as in Table 1."""
    problem = known_problem(0)
    assert problem.mode.status == "converged"
    assert 1200.0 < problem.std[0] / problem.std[-1] < 2500.0
    for scale in (1.0, 4.0, 8.0):
        row = statistics(RowTask(0, "SS", scale, FEW), searched(RowTask(0, "SS", scale, FEW)))
        assert row.raw_distance == pytest.approx(PAPER["SS", scale].raw_distance, rel=0.25)


def test_deviations_are_mahalanobis_lengths() -> None:
    problem = known_problem(0)
    steps = np.random.default_rng(0).normal(size=(5, problem.body.nv))
    assert len(problem.std) == problem.body.nv
    squares = np.einsum("ni,ij,nj->n", steps, np.linalg.inv(problem.covariance), steps)
    np.testing.assert_allclose(problem.deviations(steps), np.sqrt(squares), rtol=1e-6)


def test_minima_are_minima(rows: dict[str, Searches]) -> None:
    """No small admissible step from a counted minimum is lower, and all minima differ."""
    problem, searches, rng = known_problem(0), rows["CSS"], np.random.default_rng(1)
    kept = distinct(problem, searches)
    assert len(kept) > 5
    for k in kept[:8]:
        for _ in range(40):
            q = problem.body.integrate(searches.q[k], 1e-4 * rng.normal(size=problem.body.nv))
            assert problem.cost.at(q).value > searches.energy[k] - 1e-9
    steps = problem.steps(searches.q[kept])
    gaps = np.abs(steps[:, None] - steps[None]).max(axis=-1) + np.eye(len(kept))
    assert gaps.min() > 0.1
    assert np.abs(steps).max(axis=1).min() > 0.1


def test_only_converged_and_distinct_ends_count(rows: dict[str, Searches]) -> None:
    problem, searches = known_problem(0), rows["CSS"]
    first = distinct(problem, searches)[0]
    spoilt = replace(searches, residual=np.where(np.arange(FEW) == first, 1e-3, searches.residual))
    assert first not in distinct(problem, spoilt)
    saddle = replace(searches, curvature=np.full(FEW, -1.0))
    assert len(distinct(problem, saddle)) == 0
    counts = [len(distinct(problem, searches, Rule("landmark", t))) for t in (0.001, 0.05, 0.2, 5.0)]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 0


def test_covariance_scaling_finds_more_at_lower_cost(rows: dict[str, Searches]) -> None:
    css, ss = (statistics(RowTask(0, m, 8.0, FEW), rows[m]) for m in ("CSS", "SS"))
    assert css.minima > 1.5 * ss.minima
    assert css.raw_deviations < ss.raw_deviations
    assert css.raw_distance > 3.0 * ss.raw_distance


@pytest.mark.parametrize("searcher", SEARCHERS)
def test_hunts_find_low_minima(searcher: str) -> None:
    ticks = iter(range(99))
    hunt = hunted(HuntTask(0, "joints", searcher, 8.0, 40), lambda: float(next(ticks)))
    assert np.all(np.diff(hunt.known) >= 0)
    assert hunt.cpu.tolist() == list(range(1, 41))  # read once before the first search, and after each
    assert hunt.known[-1] == len(hunt.energies) > 5
    assert np.all(hunt.energies <= known_problem(0, "joints").mode.quadratic.value + WITHIN)


def test_gains_count_the_same_minima() -> None:
    """Twice as many in the same time, and as many in a quarter of it."""
    base = Hunt(np.array([0, 1, 2, 2]), np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(2))
    other = Hunt(np.array([2, 3, 4, 4]), np.array([0.75, 2.0, 3.0, 4.0]), np.zeros(4))
    gains = compared(other, base)
    assert gains["gain"] == pytest.approx(2.0)
    assert gains["gain_to_as_many"] == pytest.approx(4.0)
    assert np.isnan(compared(base, other)["gain_to_as_many"])


@pytest.mark.paper
def test_plots(rows: dict[str, Searches], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every panel of every figure has curves or bars. One figure is painted too: layout takes longest."""
    figures: dict[str, Any] = {}
    monkeypatch.setattr(
        "benchmarks.papers_css.css_figures.write_figure", lambda path, figure: figures.update({path.stem: figure})
    )
    draw_all(tmp_path, 0, rows, points=9)
    panels = {name: figure.axes for name, figure in figures.items()}
    assert {name: len(axes) for name, axes in panels.items()} == {
        "figure05": 1,
        "figure07": 4,
        "figure08": 4,
        "figure13": 6,
    }
    for panel in (panel for axes in panels.values() for panel in axes):
        assert panel.has_data()
        assert panel.get_xlabel()
    write_figure(tmp_path / "figure05.png", figures["figure05"])
    picture = cv2.imread(str(tmp_path / "figure05.png"))
    assert picture is not None
    assert picture.std() > 5.0


@pytest.mark.paper
def test_plots_are_small_files(rows: dict[str, Searches], tmp_path: Path) -> None:
    draw_all(tmp_path, 0, rows, points=9)
    for name in ("figure05", "figure07", "figure08", "figure13"):
        picture = cv2.imread(str(tmp_path / f"{name}.png"))
        assert picture is not None
        assert picture.std() > 5.0
        assert (tmp_path / f"{name}.png").stat().st_size < 150_000


def test_valleys_are_continuous_and_end_where_searches_fall() -> None:
    """The third direction: two valleys that overlap. Neither jumps, and their minima are minima of the energy."""
    problem, reach = known_problem(0), 1.14
    first, second = valleys(problem, 2, reach, 61)
    assert first.folded == (True, False)
    assert second.folded == (False, True)
    assert first.t[0] < second.t[-1]  # they overlap, and differ there
    for valley in (first, second):
        assert np.all(np.diff(valley.t) > 0.0)
        steps = problem.steps(valley.q)
        assert np.abs(np.diff(steps, axis=0)).max() <= LEAP
        np.testing.assert_allclose(steps @ problem.axes[:, 2], valley.t, atol=5e-3)
    lowest = int(np.argmin(np.where(second.t < -0.4, second.cost, np.inf)))
    end = Seeker(problem.body, replace(SEARCH, max_turn=0.02, max_slide=0.02)).seek(problem.cost, second.q[lowest])
    assert end.status == "converged"
    assert np.abs(problem.body.difference(problem.mode.q, end.q)).max() > 0.3
    assert end.quadratic.value == pytest.approx(second.cost[lowest], abs=0.01)


def test_counts_in_a_regime() -> None:
    """Useful minima are some of all, and all methods together know at least as many as each."""
    counts = counted(TrialTask(TRACKERS, 2, 0, 40, ("CSS 8", "SS 8", "CSS 4 and jumps about known minima")))
    for count in counts.values():
        assert 0 < count.useful <= count.minima
        assert count.useful_soon == count.useful  # 40 searches are fewer than FEW
        assert count.useful <= count.known


@pytest.mark.parametrize("name", TRIED)
def test_proposals_stay_within_the_limits_and_repeat(name: str) -> None:
    problem = known_problem(0)
    first, again = ([TRIED[name](problem).sample(np.random.default_rng(s)) for s in (3, 4)] for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first[0], first[1])
    for q in first:
        assert np.array_equal(q, problem.body.clamp(q))


def test_powers_of_the_covariance_lie_between_spheres_and_covariance_scaling() -> None:
    problem = known_problem(0)
    sphere, whole = tempered(problem, 8.0, 0.0), tempered(problem, 8.0, 1.0)
    shapes = [s._factor @ s._factor.T for s in (sphere, whole)]
    np.testing.assert_allclose(shapes[1], 64.0 * problem.covariance, rtol=1e-6, atol=1e-9 * shapes[1].max())
    n = len(problem.std)
    scaled = shapes[0] / (np.trace(shapes[0]) / n)
    np.testing.assert_allclose(scaled, problem.axes @ problem.axes.T, atol=1e-9)
    assert np.linalg.slogdet(shapes[0])[1] == pytest.approx(np.linalg.slogdet(shapes[1])[1])
