"""The joint angles over time as small pictures, left and right together."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.results.ranges import NINETY, JointCurve, joint_curves
from estimator.results.run_file import Run
from viz.report.facts import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"left": "#0072B2", "right": "#D55E00", "": "#333333"}
"""Of the sides, from the palette of Okabe and Ito (Color Universal Design, 2008)."""
_SIZE = (3.6, 2.3)  # inches
_FLAGGED = "#B98900"
_LEAST = 5.0  # degrees or millimetres that an axis shows at least


def angle_figures(run: Run) -> list[Figure]:
    """A picture for every joint, those of both sides in one: the best hypothesis with its 90 % band, in degrees, or
    millimetres where it slides; frames that are not to be trusted are marked below."""
    groups: dict[str, list[tuple[str, JointCurve]]] = {}
    for curve in joint_curves(run):
        side = next((s for s in ("left", "right") if curve.joint.startswith(s + "_")), "")
        groups.setdefault(curve.joint.removeprefix(side).lstrip("_") if side else curve.joint, []).append((side, curve))
    return [_figure(name, group, run) for name, group in groups.items()]


def _figure(name: str, group: Sequence[tuple[str, JointCurve]], run: Run) -> Figure:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=_SIZE)
    drawing.subplots_adjust(left=0.19, right=0.985, bottom=0.19, top=0.89)  # alike in all, so that they line up
    FigureCanvasSVG(drawing)  # no window, and none of pyplot's global state
    axes = drawing.subplots()
    for side, curve in group:
        _draw(axes, run.time, curve, COLOURS[side])
    _dress(axes, name, group, run)
    file = io.BytesIO()
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": name, "font.family": "sans-serif", "font.size": 9.0}
    with mpl.rc_context(style):
        drawing.savefig(file, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Figure(name.replace("_", " "), file.getvalue())


def _draw(axes: Axes, time: np.ndarray, curve: JointCurve, colour: str) -> None:
    unit = 1e3 if curve.slides else 180.0 / np.pi
    off = NINETY * curve.std
    low, high = np.maximum(curve.value - off, curve.lower), np.minimum(curve.value + off, curve.upper)
    axes.fill_between(time, unit * low, unit * high, color=colour, alpha=0.2, linewidth=0.0)
    alone = "." if len(time) == 1 else ""
    axes.plot(time, unit * curve.value, color=colour, linewidth=1.4, marker=alone)


def _dress(axes: Axes, name: str, group: Sequence[tuple[str, JointCurve]], run: Run) -> None:
    low, high = axes.get_ylim()
    if high - low < _LEAST:
        axes.set_ylim(0.5 * (low + high - _LEAST), 0.5 * (low + high + _LEAST))
    flagged = np.flatnonzero(run.status != "tracked")
    if len(flagged):
        axes.plot(
            run.time[flagged], np.full(len(flagged), 0.02), "|", color=_FLAGGED, transform=axes.get_xaxis_transform()
        )
    axes.set_title(name.replace("_", " "), loc="left", fontsize=10.0, fontweight="bold")
    axes.set_ylabel("mm" if group[0][1].slides else "degrees")
    axes.set_xlabel("time [s]")
    axes.grid(True, color="0.9", linewidth=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
