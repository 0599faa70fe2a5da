"""Table 1 of CSS: where covariance scaled and spherical samples lie and which minima searches from them find.

The problem is in `css_tables_problem`, the rules by which minima are counted in `css_tables_minima`, the comparison
with kinematic jumps in `css_tables_jumps`, the plots of Figures 5, 7, 8 and 13 in `css_figures`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from benchmarks.papers_css.css_tables_jumps import SEARCHERS, Hunt, HuntTask, hunted
from benchmarks.papers_css.css_tables_minima import (
    RULE,
    WITHIN,
    RowTask,
    Rule,
    Searches,
    distinct,
    known_problem,
    low,
    searched,
)
from benchmarks.papers_css.css_tables_regimes import proposals_by_name, show_proposals, show_regimes
from benchmarks.support.common import Json, Several, in_processes, save
from humanoid.support.errors import InputError
from kinemode.terminal import report

SCALES = (1.0, 4.0, 8.0)
METHODS = ("CSS", "SS")
OTHERS = ("CSS, Student t of 4", "8 weakest directions")
SEEN = ("body", "joints")
LOOSE, MIDDLE, TIGHT = 1e-2, 1e-4, 1e-6


class Statistics(NamedTuple):
    """A row of Table 1: distinct minima besides the known mode; medians over raw samples and over these minima."""

    minima: int
    raw_distance: float
    distance: float
    raw_deviations: float
    deviations: float
    raw_cost: float
    cost: float


PAPER = {
    ("CSS", 1.0): Statistics(8, 1.148, 2.55242, 10.9351, 47.6042, 116.951, 8.49689),
    ("CSS", 4.0): Statistics(59, 3.21239, 2.9474, 35.2918, 55.3163, 1995.12, 6.98109),
    ("CSS", 8.0): Statistics(180, 4.969, 3.34661, 75.1119, 109.813, 16200.8, 7.09866),
    ("SS", 1.0): Statistics(0, 0.199367, np.nan, 24.5274, np.nan, 273.509, np.nan),
    ("SS", 4.0): Statistics(11, 0.767306, 2.04928, 96.1519, 39.0745, 4291.12, 6.28014),
    ("SS", 8.0): Statistics(42, 1.47262, 2.54884, 188.157, 56.8268, 16856.1, 6.96481),
}
RULES = (
    Rule("parameter", 0.01),
    Rule("parameter", 0.03),
    RULE,
    Rule("parameter", 0.3),
    Rule("parameter", 1.0),
    Rule("landmark", 0.01),
    Rule("landmark", 0.05),
    Rule("landmark", 0.15),
    Rule("landmark", 0.30),
)


def main(
    *,
    pose: int = 0,
    poses: int = 1,
    samples: int = 2000,
    seed: int = 0,
    others: bool = False,
    sensitivity: bool = False,
    jumps: bool = True,
    regimes: bool = False,
    proposals: bool = False,
    only: Annotated[tuple[str, ...], Several] = (),
    seeds: int = 3,
    figures: Path | None = None,
    jobs: int = 2,
    json: Json = None,
) -> None:
    """Table 1 of CSS, its dependence on the rules, and what kinematic jumps add.

    Parameters
    ----------
    pose
        Seed of the random pose.
    poses
        So many poses, from `pose` on: the table is of the first, counts of all.
    samples
        Of a row.
    seed
        Of the samples.
    others
        Also rows of heavier tails and of regular samples along the weakest directions.
    sensitivity
        Also count by other rules and tolerances.
    jumps
        Also compare with kinematic jumps.
    regimes
        Only count in other regimes: more noise, stronger stabilisers, robust errors.
    proposals
        Only compare many proposals in some of these regimes.
    only
        Of the proposals, those whose names have one of these in them.
    seeds
        Of the samples, with --regimes and --proposals.
    figures
        Draw Figures 5, 7, 8 and 13 into this folder.
    jobs
        Rows computed at a time.
    """
    if samples < 1 or poses < 1:
        raise InputError("--samples, --poses", "are 1 or more")
    if regimes or proposals:
        many = range(pose, pose + poses), range(seed, seed + seeds), samples, jobs
        rows_of_regimes = show_regimes(*many) if regimes else show_proposals(proposals_by_name(only), *many)
        save(json, {"measure": "css_tables, regimes", "samples": samples, "rows": rows_of_regimes})
        return
    methods = METHODS + OTHERS if others else METHODS
    tasks = [RowTask(p, m, s, samples, seed) for p in range(pose, pose + poses) for m in methods for s in SCALES]
    rows = dict(zip(tasks, in_processes(searched, tasks, jobs), strict=True))
    table = {t: statistics(t, searches) for t, searches in rows.items()}
    show_problem(pose)
    show_table([(t, table[t]) for t in tasks if t.pose == pose], sum(rows[t].cpu for t in tasks if t.pose == pose))
    result: dict[str, Any] = {"measure": "css_tables", "pose": pose, "samples": samples, "seed": seed}
    result["rows"] = [{**t._asdict(), **s._asdict(), "cpu_s": rows[t].cpu} for t, s in table.items()]
    if poses > 1:
        show_poses(table)
    if sensitivity:
        result["sensitivity"] = show_sensitivity(rows, pose, samples, seed, jobs)
    if jumps:
        result["jumps"] = show_jumps(range(pose, pose + poses), samples, seed, jobs)
    if figures is not None:
        from benchmarks.papers_css.css_figures import draw_all

        draw_all(figures, pose, {m: rows[RowTask(pose, m, 8.0, samples, seed)] for m in METHODS})
    save(json, result)


def statistics(task: RowTask, searches: Searches) -> Statistics:
    """The row of a proposal."""
    problem = known_problem(task.pose)
    kept = distinct(problem, searches)
    raw, ends = problem.steps(searches.raw_q), problem.steps(searches.q[kept])
    return Statistics(
        len(kept),
        _median(np.linalg.norm(raw, axis=1)),
        _median(np.linalg.norm(ends, axis=1)),
        _median(problem.deviations(raw)),
        _median(problem.deviations(ends)),
        _median(searches.raw_energy),
        _median(searches.energy[kept]),
    )


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def show_problem(pose: int) -> None:
    problem = known_problem(pose)
    std = problem.std
    report.console().print(
        f"pose {pose}: {len(std)} free directions, standard deviations {std[0]:.3g} to {std[-1]:.3g}"
        f" ({std[0] / std[-1]:.0f}:1), cost of the known mode {problem.mode.quadratic.value:.2f}"
    )


def show_table(rows: list[tuple[RowTask, Statistics]], cpu: float) -> None:
    names = ("minima", "distance raw", "found", "deviations raw", "found", "cost raw", "found")
    made = report.table("Table 1: ours (the paper's); medians", "proposal, scale", *names)
    for task, ours in rows:
        theirs = PAPER.get((task.method, task.scale))
        cells = [_beside(a, None if theirs is None else b) for a, b in zip(ours, theirs or ours, strict=True)]
        made.add_row(f"{task.method}, {task.scale:g}", *cells)
    report.console().print(made)
    report.console().print(f"drawing and searching took {cpu:.1f} s of one core")


def _beside(ours: float, theirs: float | None) -> str:
    return _figure(ours) if theirs is None else f"{_figure(ours)} ({_figure(theirs)})"


def _figure(value: float) -> str:
    if np.isnan(value):
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def show_poses(table: dict[RowTask, Statistics]) -> None:
    """Counts of every pose, covariance scaled and spherical, and whether raw costs are lower."""
    columns = [f"minima at {s:g}" for s in SCALES] + ["times, at 8"] + [f"raw cost at {s:g}" for s in SCALES]
    made = report.table("other poses: CSS / SS", "pose", *columns)
    for pose in sorted({t.pose for t in table}):
        of = {(t.method, t.scale): row for t, row in table.items() if t.pose == pose}
        pairs = [(of["CSS", s], of["SS", s]) for s in SCALES]
        times = pairs[-1][0].minima / max(1, pairs[-1][1].minima)
        counts = [f"{a.minima} / {b.minima}" for a, b in pairs]
        costs = [f"{_figure(a.raw_cost)} / {_figure(b.raw_cost)}" for a, b in pairs]
        made.add_row(str(pose), *counts, f"{times:.1f}", *costs)
    report.console().print(made)


def show_sensitivity(
    rows: dict[RowTask, Searches], pose: int, samples: int, seed: int, jobs: int
) -> dict[str, dict[str, int]]:
    """Counts at scale 8 by other rules, and with searches that end at other tolerances."""
    problem, by_rule = known_problem(pose), {}
    standard = {m: rows[RowTask(pose, m, 8.0, samples, seed)] for m in METHODS}
    for rule in RULES:
        name = f"{rule.unit} apart by {rule.threshold:g} {'rad or m' if rule.unit == 'parameter' else 'm'}"
        by_rule[name] = {m: len(distinct(problem, standard[m], rule)) for m in METHODS}
    near = f"within {WITHIN:g} of the known mode's cost"
    by_rule[near] = {m: len(low(problem, standard[m])) for m in METHODS}
    tasks = [RowTask(pose, m, 8.0, samples, seed, t) for t in (LOOSE, MIDDLE, TIGHT) for m in METHODS]
    for task, searches in zip(tasks, in_processes(searched, tasks, jobs), strict=True):
        counts = by_rule.setdefault(f"searches end at a projected gradient of {task.tolerance:g}", {})
        counts[task.method] = len(distinct(problem, searches, RULE, task.tolerance))
        shares = by_rule.setdefault(f"of which per thousand searches, below {task.tolerance:g}", {})
        shares[task.method] = round(1000 * float(np.mean(searches.minima(task.tolerance))))
    made = report.table("minima at scale 8 by other rules", "rule", *METHODS, "times")
    for name, counts in by_rule.items():
        made.add_row(name, *(str(counts[m]) for m in METHODS), f"{counts['CSS'] / max(1, counts['SS']):.1f}")
    report.console().print(made)
    return by_rule


def show_jumps(poses: range, searches: int, seed: int, jobs: int) -> list[dict[str, Any]]:
    """Low-energy minima a second: of all searches, and until as many are known as the first searcher ends with."""
    tasks = [HuntTask(p, seen, s, SCALES[-1], searches, seed) for seen in SEEN for p in poses for s in SEARCHERS]
    hunts = dict(zip(tasks, in_processes(hunted, tasks, jobs), strict=True))
    title = f"distinct minima within {WITHIN:g} of the known mode, scale {SCALES[-1]:g}, {searches} searches"
    made = report.table(title, "landmarks, pose: searcher", "minima", "s", "a second", "times", "s to as many", "times")
    result = []
    for task, hunt in hunts.items():
        base = hunts[task._replace(searcher=SEARCHERS[0])]
        row = {**task._asdict(), **compared(hunt, base)}
        result.append(row)
        cells = [f"{row[k]:.3g}" for k in ("minima", "cpu_s", "a_second", "gain", "s_to_as_many", "gain_to_as_many")]
        made.add_row(f"{task.seen}, {task.pose}: {task.searcher}", *cells)
        if task.searcher == SEARCHERS[-1]:
            made.add_section()
    report.console().print(made)
    return result


def compared(hunt: Hunt, base: Hunt) -> dict[str, float]:
    """A hunt beside another: minima, seconds, and gains in minima a second; NaN where it never knows as many."""
    rate, base_rate = hunt.known[-1] / hunt.cpu[-1], base.known[-1] / base.cpu[-1]
    reached = np.flatnonzero(hunt.known >= base.known[-1])
    base_reached = np.flatnonzero(base.known >= base.known[-1])[0]
    seconds = float(hunt.cpu[reached[0]]) if len(reached) else float("nan")
    return {
        "minima": int(hunt.known[-1]),
        "cpu_s": float(hunt.cpu[-1]),
        "a_second": float(rate),
        "gain": float(rate / base_rate) if base_rate > 0.0 else float("nan"),
        "s_to_as_many": seconds,
        "gain_to_as_many": float(base.cpu[base_reached]) / seconds,
    }
