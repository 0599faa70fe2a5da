"""A figure of several trackers over time.

The colours are those of Okabe and Ito (Color Universal Design, 2008), which stay distinct under every common kind of
colour blindness; line styles and marks distinguish the trackers without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")
STYLES = ("-", "--", "-.", (0, (1, 1.2)))
MARKS = "os^Dv*P<dh>"
_COLUMNS = 3  # of the legend
_MARKED = 9  # marks along a line
_NEAR_LIMIT = 0.5  # share of the limit from which it is shown
_DECADES = 0.7  # range of the values, in powers of ten, from which the axis is logarithmic


@dataclass(frozen=True)
class Curve:
    """One tracker's line: a value (T,) at each time (T,) [s], NaN where there is none; lost: the times at which it is
    lost by the measure of its panel."""

    name: str
    time: np.ndarray
    value: np.ndarray
    lost: tuple[float, ...] = ()


@dataclass(frozen=True)
class MeasurePanel:
    """One measure: its name with the unit, a curve a tracker, and the value beyond which a pose is lost by it."""

    label: str
    curves: Sequence[Curve]
    limit: float | None = None


@dataclass(frozen=True)
class Plot:
    """Content of a figure: a title, and one panel or several below each other over the same time."""

    title: str
    panels: Sequence[MeasurePanel]


def write_plot(plot: Plot, path: str | Path) -> None:
    """Write the figure as a PNG; raises OSError where that fails."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    count = len(plot.panels)
    figure = Figure(figsize=(10.0, 1.4 + 3.2 * count), layout="constrained")
    FigureCanvasAgg(figure)  # no window, and none of pyplot's global state
    every = figure.subplots(count, sharex=True, squeeze=False)[:, 0]
    first = first_losses(plot)
    for axes, panel in zip(every, plot.panels, strict=True):
        for i, curve in enumerate(panel.curves):
            _draw(axes, i, curve, panel.limit, first.get(curve.name))
        _dress(axes, panel)
    every[0].set_title(f"{plot.title}{'; crosses: lost, a large one first' if first else ''}", loc="left")
    figure.legend(*every[0].get_legend_handles_labels(), loc="outside lower left", ncols=_COLUMNS, frameon=False)
    every[-1].set_xlabel("time [s]")
    figure.savefig(path, format="png", dpi=110)


def first_losses(plot: Plot) -> dict[str, float]:
    """When each tracker is first lost by any measure [s]; those that never are are left out."""
    lost = [(t, curve.name) for panel in plot.panels for curve in panel.curves for t in curve.lost]
    return {name: t for t, name in sorted(lost, reverse=True)}


def _draw(axes: Axes, i: int, curve: Curve, limit: float | None, first: float | None) -> None:
    """One line, thinner the later it is drawn, so that those below stay visible, with a cross where it is lost."""
    every = max(1, len(curve.time) // _MARKED)
    colour = COLOURS[i % len(COLOURS)]
    label = curve.name if first is None else f"{curve.name}, lost at {first:.2f} s"
    axes.plot(
        curve.time, curve.value, color=colour, linestyle=STYLES[i % len(STYLES)], linewidth=max(1.2, 2.4 - 0.2 * i),
        marker=MARKS[i % len(MARKS)], markersize=5.0, markevery=(i * every // 5 % every, every), label=label,
    )  # fmt: skip
    for lost in curve.lost:
        value = curve.value[int(np.argmin(np.abs(curve.time - lost)))]
        height = value if np.isfinite(value) else limit  # a frame without a pose has no value
        size = 13.0 if lost == first else 7.0
        if height is not None:
            axes.plot(lost, height, "x", color=colour, markersize=size, markeredgewidth=3.0 * size / 13.0, zorder=5)


def scale_values(axes: Axes, values: np.ndarray) -> tuple[float, float]:
    """Make the axis of values, NaN where unknown, logarithmic where they are far apart, and let it begin at 0 where
    they are not and none is below; returns their range, 0 and 1 where none is known."""
    from matplotlib.ticker import LogLocator

    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    if low > 0.0 and np.log10(high / low) > _DECADES:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
    elif low >= 0.0:
        axes.set_ylim(bottom=0.0)
    return low, high


def _dress(axes: Axes, panel: MeasurePanel) -> None:
    _, high = scale_values(axes, np.concatenate([curve.value for curve in panel.curves]))
    limit = panel.limit
    if limit is not None and high > _NEAR_LIMIT * limit:
        axes.axhline(limit, color="0.4", linewidth=1.0, linestyle=":")
        axes.set_ylim(top=max(1.1 * limit, axes.get_ylim()[1]))
        axes.annotate(
            f"lost above {limit:g}", (1.005, limit), xycoords=("axes fraction", "data"), va="center", color="0.4",
        )  # fmt: skip
    axes.set_ylabel(panel.label)
    axes.grid(True, which="major", color="0.9", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
