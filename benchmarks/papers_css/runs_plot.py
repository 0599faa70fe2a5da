"""Pictures of many runs: the error of each by tracker, with means and deviations; differences with their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.papers_css.failure_runs import Attempt
from benchmarks.papers_css.summaries import Spread
from benchmarks.support.figure_file import new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FILTERED, _SMOOTHED = "#1f4e79", "#c44e52"
_APART = 0.17  # of the two trajectories of a tracker, in rows


def write_runs(path: Path, by_tracker: Mapping[str, Sequence[Attempt]]) -> None:
    """A panel for each sequence, a row for each tracker: every run's mean error, a cross where it was lost, and their
    mean and deviation, filtered and smoothed, as a PNG."""
    motions = list(dict.fromkeys(a.motion for runs in by_tracker.values() for a in runs))
    figure, panels = _panels(len(motions), len(by_tracker))
    for axes, motion in zip(panels, motions, strict=True):
        for row, runs in enumerate(by_tracker.values()):
            of = [a for a in runs if a.motion == motion]
            _row_of_runs(axes, row - _APART, of, "filtered", _FILTERED)
            if all(a.smooths for a in of):
                _row_of_runs(axes, row + _APART, of, "smoothed", _SMOOTHED)
        axes.set(title=motion.replace("_", " "), xlabel="mean joint error [mm]")
        axes.set_xlim(left=0.0)
        _rows(axes, list(by_tracker))
    for name, colour, marker in (("filtered", _FILTERED, "o"), ("smoothed", _SMOOTHED, "o"), ("lost", "0.4", "x")):
        panels[-1].plot([], [], marker, color=colour, label=name, markersize=5, linestyle="none")
    _finish(path, figure, panels)


def _row_of_runs(axes: Axes, row: float, runs: Sequence[Attempt], trajectory: str, colour: str) -> None:
    errors = [a.outcome.errors[trajectory] for a in runs]
    for lost, marker in ((False, "o"), (True, "x")):
        values = [e.mean for e in errors if (e.lost is not None) == lost]
        axes.plot(values, [row] * len(values), marker, color=colour, markersize=4, alpha=0.55, linestyle="none")
    values = [e.mean for e in errors]
    deviation = np.std(values, ddof=1) if len(values) > 1 else 0.0
    axes.errorbar(np.mean(values), row, xerr=deviation, fmt="|", color=colour, markersize=11, linewidth=1.4, capsize=3)


class Difference(NamedTuple):
    """The difference of a row from the first row, in a panel of the picture: filtered and smoothed."""

    filtered: Spread
    smoothed: Spread


def write_differences(path: Path, by_panel: Mapping[str, Mapping[str, Difference]]) -> None:
    """A panel for each of several suites, a row for each thing left out: by how much the error rises, with two standard
    errors, filtered and smoothed, as a PNG."""
    names = list(dict.fromkeys(name for rows in by_panel.values() for name in rows))
    figure, panels = _panels(len(by_panel), len(names))
    for axes, (title, rows) in zip(panels, by_panel.items(), strict=True):
        axes.axvline(0.0, color="black", linewidth=0.8)
        for row, name in enumerate(names):
            if name in rows:
                for kind, shift, colour in (("filtered", -_APART, _FILTERED), ("smoothed", _APART, _SMOOTHED)):
                    s: Spread = getattr(rows[name], kind)
                    error = 2.0 * s.error if np.isfinite(s.error) else 0.0
                    label = kind if row == 0 else None
                    axes.errorbar(
                        s.mean, row + shift, xerr=error, fmt="o", color=colour, markersize=4, capsize=3, label=label
                    )
        axes.set(title=title, xlabel="error more than the whole [mm]")
        _rows(axes, names)
    _finish(path, figure, panels)


def _panels(count: int, rows: int) -> tuple[Figure, list[Axes]]:
    figure = new_figure(2.2 + 3.6 * count, 1.2 + 0.42 * rows)
    return figure, list(figure.subplots(1, count, sharey=True, squeeze=False)[0])


def _rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="x", color="0.9", linewidth=0.7)
    axes.set_axisbelow(True)


def _finish(path: Path, figure: Figure, panels: Sequence[Axes]) -> None:
    """Name the colours below the panels, and write the picture."""
    figure.legend(
        *panels[-1].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False
    )
    write_figure(path, figure)
