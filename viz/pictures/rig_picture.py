"""A picture of cameras that were found from a person: where they stand, and how far off keypoints are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.rigs.calibrate import PersonCalibration
from estimator.numerics.typical import typical_distance
from humanoid.support.atomic import replacing
from viz.pictures.plot import COLOURS, MARKS, scale_values
from viz.pictures.rig_plan import ABOVE, ASIDE, PERSON, RigPlan, draw_rig, name_cameras, path_of
from viz.solids.body_solids import limb_segments

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _SPACE = 6.4, 0.9  # inches: of the rig; around each part of it
_LEAST, _MOST = 8.0, 16.0  # inches: height of the picture
_FIGURES = 6  # instants at which the person is drawn
_MARK, _LETTER = 0.45, 0.085  # inches: what a mark and a letter of the legend take
_ROW = 0.6  # of the distance of two joints: what the cameras' marks take


def write_rig_picture(rig: PersonCalibration, path: Path) -> Path:
    """Write a PNG and return its path: on the left the cameras from above and from the side, with the person at some
    instants; on the right how far keypoints are from where the points of all cameras are seen, by joint and over time.

    Raises
    ------
    InputError: a file that cannot be written.
    """
    drawing = rig_drawing(rig)
    with replacing(path) as temporary:
        drawing.savefig(temporary, format="png", dpi=110)
    return path


def rig_drawing(rig: PersonCalibration) -> Figure:
    """The picture, laid out."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    plan = RigPlan(list(rig.cameras.values()), path_of(rig.names, rig.points), rig.shift_stds)
    sizes = [high - low for low, high in (plan.limits(seen, rig.points) for seen in (ABOVE, ASIDE))]
    heights = [_SPACE + _WIDTH * tall / wide for wide, tall in sizes]
    drawing = Figure(figsize=(2.2 * _WIDTH, float(np.clip(sum(heights), _LEAST, _MOST))), layout="constrained")
    FigureCanvasAgg(drawing)  # no window, and none of pyplot's global state
    left, right = drawing.subfigures(1, 2, squeeze=False)[0]
    above, side = left.subplots(2, 1, height_ratios=heights)
    panels = {ABOVE: above, ASIDE: side}
    for seen, axes in panels.items():
        draw_rig(axes, plan, seen, rig.points)
        _draw_person(axes, rig, seen)
    first, *_ = rig.cameras
    above.set_title(f"from above; discs: deviation of places beside {first}, to scale", loc="left", fontsize="medium")
    side.set_title("from the side; lines: optical axes, and the floor", loc="left", fontsize="medium")
    joints, times = right.subplots(2, 1, height_ratios=[1.6, 1.0])
    _draw_joints(joints, rig)
    _draw_times(times, rig)
    lines, labels = joints.get_legend_handles_labels()
    columns = max(1, int(_WIDTH / (_MARK + _LETTER * max(map(len, labels)))))
    right.legend(lines, labels, loc="outside upper left", ncols=columns, frameon=False)
    name_cameras(drawing, plan, panels)
    return drawing


def _draw_person(axes: Axes, rig: PersonCalibration, seen: tuple[int, int]) -> None:
    segments, _ = limb_segments(rig.names)
    for t in np.unique(np.linspace(0, len(rig.times) - 1, _FIGURES).round().astype(int)):
        for ends in rig.points[t][segments]:
            axes.plot(*ends[:, seen].T, color=PERSON, linewidth=0.8, alpha=0.6)


def _draw_joints(axes: Axes, rig: PersonCalibration) -> None:
    rows, count = np.arange(len(rig.names)), len(rig.cameras)
    for c, (name, distances) in enumerate(rig.distances.items()):
        off = _ROW * ((c + 0.5) / count - 0.5)
        label = f"{name}: {rig.errors[name]:.1f} px"
        axes.plot(
            typical_distance(distances, axis=0), rows + off, linestyle="none", color=COLOURS[c % len(COLOURS)],
            marker=MARKS[c % len(MARKS)], markersize=5.0, label=label,
        )  # fmt: skip
    axes.set_yticks(rows, [name.replace("_", " ") for name in rig.names])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("root mean square without outliers [px]")
    axes.set_title("keypoints from where the points of all cameras are seen", loc="left", fontsize="medium")
    _dress(axes)


def _draw_times(axes: Axes, rig: PersonCalibration) -> None:
    curves = np.array([typical_distance(distances, axis=1) for distances in rig.distances.values()])
    for c, curve in enumerate(curves):
        axes.plot(rig.times, curve, color=COLOURS[c % len(COLOURS)], linewidth=1.2)
    scale_values(axes, curves)
    axes.set_ylabel("all joints [px]")
    axes.set_xlabel("time [s]")
    _dress(axes)


def _dress(axes: Axes) -> None:
    axes.grid(True, color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
