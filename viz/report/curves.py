"""The joint angles over time as small pictures, left and right together."""

from __future__ import annotations

import io
from typing import Any

from estimator.runs.joint_angle import joint_angles
from estimator.runs.run_file import Run
from viz.palette import ON_PAPER, web
from viz.pictures.joint_panels import JointPanel, panels_of
from viz.pictures.joint_plot import draw_panel
from viz.report.facts import Figure

COLOURS = {side: web(colour) for side, colour in ON_PAPER.items()}
"""Of the sides."""
_SIZE = (3.6, 2.3)  # inches


def angle_figures(run: Run) -> list[Figure]:
    """A picture for every joint, those of both sides in one, in degrees, or metres where it slides, as `kinemode plot`
    draws them."""
    return [_figure(panel, run) for panel in panels_of([angle.degrees for angle in joint_angles(run)])]


def _figure(panel: JointPanel, run: Run) -> Figure:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=_SIZE)
    drawing.subplots_adjust(left=0.19, right=0.985, bottom=0.19, top=0.89)  # alike in all, so that they line up
    FigureCanvasSVG(drawing)  # no window, and none of pyplot's global state
    axes = drawing.subplots()
    draw_panel(axes, run, panel)
    axes.set_xlabel("time [s]")
    file = io.BytesIO()
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": panel.title, "font.family": "sans-serif", "font.size": 9.0}
    with mpl.rc_context(style):
        drawing.savefig(file, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return Figure(panel.title.replace("_", " "), file.getvalue())
