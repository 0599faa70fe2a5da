"""The picture of `rig_motions`: errors of rotations, and what was predicted of them, by what was filmed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.support.figure_file import new_figure, write_figure
from viz.pictures.plot import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDE, _HIGH = 3.4, 4.2  # inches of a panel
_LINE = 13  # letters of a line of a label
_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)


@dataclass(frozen=True)
class TrialColumn:
    """Errors of the rotation [deg] and their predicted deviations of the trials of a setting, and how many more were
    refused."""

    label: str
    errors: tuple[float, ...]
    deviations: tuple[float, ...]
    refused: int


def write_motions_picture(parts: Mapping[str, Sequence[TrialColumn]], path: Path) -> None:
    """Write a panel for each part: medians of the errors with their range, and of the
    predicted deviations."""
    figure = new_figure(_WIDE * len(parts), _HIGH)
    panels = figure.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    for axes, (part, columns) in zip(panels, parts.items(), strict=True):
        _draw(axes, part, columns)
    panels[0].set_ylabel("rotation of the second camera [deg]")
    panels[0].set_yscale("log")
    panels[0].set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    panels[0].minorticks_off()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(handles), frameon=False)
    write_figure(path, figure)


def _draw(axes: Axes, part: str, columns: Sequence[TrialColumn]) -> None:
    at = np.arange(len(columns))
    some = [k for k, column in enumerate(columns) if column.errors]
    middle = np.array([np.median(columns[k].errors) for k in some])
    ends = np.array([[min(columns[k].errors), max(columns[k].errors)] for k in some]).reshape(-1, 2)
    axes.errorbar(
        at[some] - 0.12, middle, np.abs(ends.T - middle), linestyle="none", marker="o", color=COLOURS[0], capsize=2.0,
        label="error: median and range",
    )  # fmt: skip
    predicted = [np.median(columns[k].deviations) for k in some]
    axes.plot(
        at[some] + 0.12, predicted, linestyle="none", marker="s", color=COLOURS[1], label="predicted deviation: median"
    )
    for k, column in enumerate(columns):
        if column.refused:
            note = f"{column.refused} refused"
            axes.annotate(
                note, (k, 1.0), (0.0, -3.0), xycoords=("data", "axes fraction"), textcoords="offset points",
                ha="center", va="top", rotation=90.0, fontsize=8.0, color="0.35",
            )  # fmt: skip
    long = max(len(column.label) for column in columns) > _LINE
    axes.set_xticks(at, [fill(column.label, _LINE) for column in columns], fontsize=7.0 if long else 9.0)
    axes.set_xlim(-0.6, len(columns) - 0.4)
    axes.set_xlabel(part)
    axes.grid(True, axis="y", color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
