"""One figure of several trackers over time.

The colours are those of Okabe and Ito (Color Universal Design, 2008), which stay apart under every common kind of
colour blindness; line styles and marks tell the trackers apart without them.
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
_MARKED = 9  # marks along a line
_NEAR_LIMIT = 0.5  # share of the limit from which it is shown
_DECADES = 0.7  # range of the values, in powers of ten, from which the axis is logarithmic


@dataclass(frozen=True)
class Curve:
    """One tracker's line: a value (T,) at each time (T,) [s], NaN where there is none; lost: the time at which it is
    first lost, None where it never is."""

    name: str
    time: np.ndarray
    value: np.ndarray
    lost: float | None = None


@dataclass(frozen=True)
class Plot:
    """What is drawn: the curves, a title, what the values are, with their unit, and where a pose counts as lost."""

    title: str
    label: str
    curves: Sequence[Curve]
    limit: float | None = None


def write_plot(plot: Plot, path: str | Path) -> None:
    """Write the figure as a PNG; raises OSError where that cannot be done."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.8), layout="constrained")
    FigureCanvasAgg(figure)  # no window, and none of pyplot's global state
    axes = figure.add_subplot()
    for i, curve in enumerate(plot.curves):
        _draw(axes, i, curve)
    _dress(axes, plot)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    figure.savefig(path, format="png", dpi=110)


def _draw(axes: Axes, i: int, curve: Curve) -> None:
    """One line, thinner the later it is drawn, so that those below stay visible, with a cross where it is lost."""
    every = max(1, len(curve.time) // _MARKED)
    colour = COLOURS[i % len(COLOURS)]
    (line,) = axes.plot(
        curve.time, curve.value, color=colour, linestyle=STYLES[i % len(STYLES)], linewidth=max(1.2, 2.4 - 0.2 * i),
        marker=MARKS[i % len(MARKS)], markersize=5.0, markevery=(i * every // 5 % every, every), label=curve.name,
    )  # fmt: skip
    if curve.lost is None:
        return
    line.set_label(f"{curve.name}, lost at {curve.lost:.2f} s")
    at = int(np.argmin(np.abs(curve.time - curve.lost)))
    if np.isfinite(curve.value[at]):
        axes.plot(curve.time[at], curve.value[at], "x", color=colour, markersize=13.0, markeredgewidth=3.0, zorder=5)


def _dress(axes: Axes, plot: Plot) -> None:
    from matplotlib.ticker import LogLocator

    values = np.concatenate([curve.value for curve in plot.curves])
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    if low > 0.0 and np.log10(high / low) > _DECADES:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
    elif low >= 0.0:
        axes.set_ylim(bottom=0.0)
    if plot.limit is not None and high > _NEAR_LIMIT * plot.limit:
        axes.axhline(plot.limit, color="0.4", linewidth=1.0, linestyle=":")
        axes.set_ylim(top=max(1.1 * plot.limit, axes.get_ylim()[1]))
        axes.annotate(
            "lost", (1.0, plot.limit), xycoords=("axes fraction", "data"), ha="right", va="bottom", color="0.4"
        )
    axes.set_title(plot.title, loc="left")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(plot.label)
    axes.grid(True, which="major", color="0.9", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
