"""The picture of an index: errors of the best neighbours by what it is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.papers_elmo.index_curves import Row
from benchmarks.support.figure_file import new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLES = {"examples": "examples N", "key_bits": "bits of a key k", "tables": "tables l", "neighbours": "neighbours K"}
_LINES = {
    "chance": ("as many at random", "0.6"), "hashed": ("hashed", "#c44e52"), "exact": ("all compared", "#1f4e79"),
    "nearest": ("nearest of all examples", "black"),
}  # fmt: skip
_LOOKED_AT = "#55a868"


def write_curves(path: Path, curves: Mapping[str, Sequence[Row]]) -> None:
    """A panel for each curve, by the field of `Made` that changes: errors, and the share of the examples that a query
    is compared with on the right, as a PNG."""
    figure = new_figure(3.4 * len(curves), 3.8)
    panels = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for axes, (name, rows) in zip(panels, curves.items(), strict=True):
        at = [getattr(row.made, name) for row in rows]
        for field, (label, colour) in _LINES.items():
            axes.plot(at, [getattr(row, field) for row in rows], marker="o", markersize=3, color=colour, label=label)
        _shares(axes, at, [100.0 * row.looked_at for row in rows])
        axes.set(xscale="log", xlabel=TITLES[name])
        axes.set_xticks(at, [f"{x:,}" for x in at], fontsize=7)
        axes.minorticks_off()
    panels[0].set_ylim(bottom=0.0)
    panels[0].set_ylabel("error of the best [mm]")
    panels[0].plot([], [], "--", color=_LOOKED_AT, label="share compared (right)")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8, frameon=False
    )
    write_figure(path, figure)


def _shares(axes: Axes, at: Sequence[int], percent: Sequence[float]) -> None:
    beside = axes.twinx()
    beside.plot(at, percent, "--", color=_LOOKED_AT, linewidth=1.0)
    beside.set_ylim(bottom=0.0)
    beside.tick_params(labelsize=7, labelcolor=_LOOKED_AT)
    beside.set_ylabel("compared [%]", color=_LOOKED_AT, fontsize=8)
