"""How Table 1's counts depend on the noise, the stabilisers and the potential, and which proposals find more useful
minima than spheres do: `python -m benchmarks css_tables --regimes`, `--proposals`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from benchmarks.papers_css.css_tables_minima import Searches, distinct, known_problem, low, searched_from
from benchmarks.papers_css.css_tables_problem import PAPERS, Problem, Regime
from benchmarks.papers_css.css_tables_proposals import TRIED
from benchmarks.support.common import in_processes
from kinemode.terminal import report

NOISES, STABILISERS, POTENTIALS = (1.0, 3.0, 5.0), (0.5, 0.9, 1.4), ("gaussian", "lorentzian")
TRACKERS = Regime(5.0, 0.0, "lorentzian")
"""Near the tracker's own energy: its keypoints' noise on this person, its stabilisers, its potentials."""
REGIMES = (*(Regime(n, s, p) for p in POTENTIALS for s in reversed(STABILISERS) for n in NOISES), TRACKERS)
COMPARED = (PAPERS, Regime(5.0), Regime(5.0, 0.5, "lorentzian"), TRACKERS)
"""Where proposals are compared: Table 1's regime, where the image is uncertain, where the prior is strong too."""
FEW = 100  # of the searches: what a tracker can afford for a frame
METHODS = ("CSS 8", "SS 8")


class TrialTask(NamedTuple):
    """A regime, a random pose, the seed of the samples, how many, and the proposals compared, keys of TRIED."""

    regime: Regime
    pose: int
    seed: int
    samples: int
    methods: tuple[str, ...]


class Count(NamedTuple):
    """Distinct minima besides the known mode: all, the useful ones, the useful ones after the first `FEW` searches, and
    useful ones that the methods compared know between them. cpu_s: of drawing and searching."""

    minima: int
    useful: int
    useful_soon: int
    known: int
    cpu_s: float


def counted(task: TrialTask) -> dict[str, Count]:
    """Counts of every method for a pose and a seed."""
    problem = known_problem(task.pose, regime=task.regime)
    rows = {
        m: searched_from(problem, TRIED[m], np.random.default_rng([task.seed, task.pose]), task.samples)
        for m in task.methods
    }
    known = len(low(problem, _pooled(list(rows.values()))))
    return {m: _count(problem, searches, known) for m, searches in rows.items()}


def _count(problem: Problem, searches: Searches, known: int) -> Count:
    soon = len(low(problem, searches.first(FEW)))
    return Count(len(distinct(problem, searches)), len(low(problem, searches)), soon, known, searches.cpu)


def _pooled(rows: Sequence[Searches]) -> Searches:
    """The searches of several methods as one."""
    arrays = {f.name: np.concatenate([getattr(r, f.name) for r in rows]) for f in fields(Searches) if f.name != "cpu"}
    return Searches(**arrays, cpu=sum(r.cpu for r in rows))


def measured(
    regimes: Sequence[Regime], methods: tuple[str, ...], poses: range, seeds: range, samples: int, jobs: int
) -> list[dict[str, Any]]:
    """Rows of mean and deviation over poses and seeds, by regime and method."""
    tasks = [TrialTask(r, p, s, samples, methods) for r in regimes for p in poses for s in seeds]
    counts = dict(zip(tasks, in_processes(counted, tasks, jobs), strict=True))
    rows = []
    for regime in regimes:
        for method in methods:
            of = [counts[t][method] for t in tasks if t.regime == regime]
            rows.append(
                {"regime": regime._asdict(), "method": method, **_spread(of), "each": [c._asdict() for c in of]}
            )
    return rows


def _spread(counts: Sequence[Count]) -> dict[str, Any]:
    """Mean and deviation of every count; the share of useful minima known that each found."""
    columns = np.array(counts, dtype=float)
    by_name = {name: (float(c.mean()), float(c.std())) for name, c in zip(Count._fields, columns.T, strict=True)}
    return {**by_name, "share": float(columns[:, 1].sum() / max(1.0, columns[:, 3].sum()))}


def show_regimes(poses: range, seeds: range, samples: int, jobs: int) -> list[dict[str, Any]]:
    """CSS beside SS at scale 8 in every regime."""
    rows = measured(REGIMES, METHODS, poses, seeds, samples, jobs)
    title = f"{samples} searches at scale 8, {len(poses)} poses, {len(seeds)} seeds: CSS / SS, mean (deviation)"
    names = ("minima", "times", "useful", "times", f"useful in {FEW}", "times", "of the useful known")
    made = report.table(title, "regime", *names)
    for css, ss in zip(rows[::2], rows[1::2], strict=True):
        cells = []
        for name in ("minima", "useful", "useful_soon"):
            cells += [f"{_spoken(css[name])} / {_spoken(ss[name])}", f"{css[name][0] / max(0.01, ss[name][0]):.2f}"]
        made.add_row(_named(css["regime"]), *cells, f"{css['share']:.0%} / {ss['share']:.0%}")
    _print(made)
    return rows


def show_proposals(methods: Sequence[str], poses: range, seeds: range, samples: int, jobs: int) -> list[dict[str, Any]]:
    """All proposals with equally many searches, in a few regimes."""
    rows = measured(COMPARED, tuple(methods), poses, seeds, samples, jobs)
    for regime in COMPARED:
        own = [r for r in rows if r["regime"] == regime._asdict()]
        title = f"{_named(regime._asdict())}: {samples} searches, mean (deviation)"
        names = ("minima", "useful", "of those known", f"useful in {FEW}", "cpu [s]")
        made = report.table(title, "proposal", *names)
        for r in own:
            useful, soon = _spoken(r["useful"]), _spoken(r["useful_soon"])
            made.add_row(r["method"], _spoken(r["minima"]), useful, f"{r['share']:.0%}", soon, f"{r['cpu_s'][0]:.2f}")
        _print(made)
    return rows


def _print(made: Any) -> None:
    out = report.console()
    out.width = max(out.width, 160)
    out.print(made)


def _spoken(spread: tuple[float, float]) -> str:
    return f"{spread[0]:.1f} ({spread[1]:.1f})"


def _named(regime: dict[str, Any]) -> str:
    width = f"{regime['stabilisers']:g} rad" if regime["stabilisers"] else "the subject's"
    return f"{regime['noise']:g} px, {width}, {'squared' if regime['potential'] == 'gaussian' else 'robust'}"


def proposals_by_name(parts: Sequence[str]) -> list[str]:
    """The keys of TRIED that contain one of some parts; all without any."""
    return [name for name in TRIED if not parts or any(p in name for p in parts)]
