"""The measures of CSS's Table 1: the paper's regime, honest minima, rules of counting, and plots."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.css_figures import draw_all
from benchmarks.css_tables import PAPER, compared, statistics
from benchmarks.css_tables_jumps import SEARCHERS, Hunt, HuntTask, hunted
from benchmarks.css_tables_minima import WITHIN, RowTask, Rule, Searches, distinct, known_problem, searched

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
    """No admissible step a little away from a counted minimum is lower, and each differs from the others."""
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
    hunt = hunted(HuntTask(0, "joints", searcher, 8.0, 40))
    assert np.all(np.diff(hunt.known) >= 0)
    assert np.all(np.diff(hunt.cpu) >= 0.0)
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


def test_plots(rows: dict[str, Searches], tmp_path: Path) -> None:
    draw_all(tmp_path, 0, rows, points=9)
    for name in ("figure05", "figure07", "figure08", "figure13"):
        picture = cv2.imread(str(tmp_path / f"{name}.png"))
        assert picture is not None
        assert picture.std() > 5.0
        assert (tmp_path / f"{name}.png").stat().st_size < 150_000
