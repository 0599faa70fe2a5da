"""The joint angles over time as small pictures, left and right together."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.results.joint_angle import joint_angles
from estimator.results.run_file import Run
from viz.palette import ON_PAPER, web
from viz.pictures.joint_panels import Panel, panels_of
from viz.pictures.joint_plot import draw_joint
from viz.report.facts import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {side: web(colour) for side, colour in ON_PAPER.items()}
"""Of the sides."""
_SIZE = (3.6, 2.3)  # inches
_FLAGGED = "#B98900"
_LEAST = 5.0  # degrees or millimetres that an axis shows at least


def angle_figures(run: Run) -> list[Figure]:
    """A picture for every joint, those of both sides in one: the best hypothesis with its 90 % band, in degrees, or
    millimetres where it slides; frames that are not to be trusted are marked below."""
    return [_figure(panel, run) for panel in panels_of([angle.degrees for angle in joint_angles(run)])]


def _figure(panel: Panel, run: Run) -> Figure:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=_SIZE)
    drawing.subplots_adjust(left=0.19, right=0.985, bottom=0.19, top=0.89)  # alike in all, so that they line up
    FigureCanvasSVG(drawing)  # no window, and none of pyplot's global state
    axes = drawing.subplots()
    for side, curve in panel.curves:
        draw_joint(axes, curve, COLOURS[side], 1e3 if curve.slides else 1.0)
    _dress(axes, panel, run)
    file = io.BytesIO()
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": panel.title, "font.family": "sans-serif", "font.size": 9.0}
    with mpl.rc_context(style):
        drawing.savefig(file, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Figure(panel.title.replace("_", " "), file.getvalue())


def _dress(axes: Axes, panel: Panel, run: Run) -> None:
    low, high = axes.get_ylim()
    if high - low < _LEAST:
        axes.set_ylim(0.5 * (low + high - _LEAST), 0.5 * (low + high + _LEAST))
    flagged = np.flatnonzero(run.status != "tracked")
    if len(flagged):
        axes.plot(
            run.time[flagged], np.full(len(flagged), 0.02), "|", color=_FLAGGED, transform=axes.get_xaxis_transform()
        )
    axes.set_title(panel.title.replace("_", " "), loc="left", fontsize=10.0, fontweight="bold")
    axes.set_ylabel("mm" if panel.curves[0][1].slides else "degrees")
    axes.set_xlabel("time [s]")
    axes.grid(True, color="0.9", linewidth=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
