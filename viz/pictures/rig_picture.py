"""Cameras that were found from a person: where they stand, from above or the side, and how far off keypoints are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.rigs.calibrate import PersonCalibration
from estimator.numerics.robust import typical_distance
from estimator.runs.pairs import HIPS
from humanoid.support.files import replacing
from viz.pictures.plot import COLOURS, MARKS, scale_values
from viz.solids.body_solids import limb_segments

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation


ABOVE, ASIDE = (0, 1), (0, 2)
"""The axes of the world, whose z points up, that are drawn to the right and up."""
PERSON, FLOOR = "0.35", "0.6"
_BEYOND = 1.1  # of the distance to the person: length of the lines that bound the field of view
_AROUND = 0.12  # of the larger side: empty, for the cameras' names
_LINE = 33  # pixels of a line across the picture, of which a fisheye may not see the outer ones
_AWAY, _WAYS = (9.0, 18.0, 30.0), 8  # points from a camera to its name, and ways in which it may stand
_DOT = 4.0  # points around a camera that its neighbours' names leave free


@dataclass(frozen=True)
class RigPlan:
    """cameras (C). path (T, 3) [m]: of the person, NaN where unknown. place_stds [m]: of the cameras' places by their
    names, root mean square; none where it is not known."""

    cameras: Sequence[Camera]
    path: np.ndarray
    place_stds: Mapping[str, float] = field(default_factory=dict)

    @property
    def centres(self) -> np.ndarray:
        """Centres of the cameras (C, 3) [m]."""
        return np.array([camera.origin_world for camera in self.cameras])

    @property
    def middle(self) -> np.ndarray:
        """Middle of the path (3,) [m]; of the cameras without a path."""
        known = self.path[np.isfinite(self.path).all(axis=1)]
        return np.asarray(np.median(known if len(known) else self.centres, axis=0))

    def limits(self, seen: tuple[int, int], others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest (2,) [m] of the drawing, with some room around it; others (..., 3) [m]: drawn too."""
        stds = np.array([self.place_stds.get(camera.name, 0.0) for camera in self.cameras])[:, None]
        drawn = [self.centres - stds, self.centres + stds, self.path, others.reshape(-1, 3)]
        places = np.concatenate(drawn)[:, seen]
        low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
        room = _AROUND * max(1.0, float(np.max(high - low)))
        return low - room, high + room


def path_of(names: Sequence[str], points: np.ndarray) -> np.ndarray:
    """Path (T, 3) of a person's named points (T, J, 3): the middle of the hips, of all where there are no hips."""
    hips = [names.index(name) for name in HIPS if name in names]
    own = points[:, hips] if len(hips) == len(HIPS) else points
    return np.asarray(np.where(np.isfinite(own).all(axis=1), own.mean(axis=1), np.nan))


def draw_rig(axes: Axes, plan: RigPlan, seen: tuple[int, int], others: np.ndarray) -> None:
    """Draw cameras and path with equal axes; seen: `ABOVE`, with fields of view, or `ASIDE`, with optical axes and the
    floor. others (..., 3) [m]: what else is drawn into them. `name_cameras` comes last."""
    from matplotlib.patches import Circle

    for c, camera in enumerate(plan.cameras):
        colour, centre = COLOURS[c % len(COLOURS)], camera.origin_world
        reach = _BEYOND * float(np.linalg.norm(plan.middle - centre))
        ends = (centre + reach * _bounds(camera, seen))[:, seen]
        if len(ends) > 1:
            axes.fill(*np.vstack([centre[list(seen)], ends]).T, color=colour, alpha=0.05, linewidth=0.0)
        for end in ends:
            axes.plot(*np.vstack([centre[list(seen)], end]).T, color=colour, linewidth=0.8, alpha=0.6)
        std = plan.place_stds.get(camera.name, 0.0)
        if std > 0.0:
            axes.add_patch(Circle(tuple(centre[list(seen)]), std, facecolor=colour, edgecolor=colour, alpha=0.35))
        mark = MARKS[c % len(MARKS)]
        axes.plot(*centre[list(seen)], mark, color=colour, markersize=5.0, gid=f"camera {camera.name}")
    axes.plot(*plan.path[:, seen].T, color="black", linewidth=2.0, zorder=3.0)
    if seen == ASIDE:
        axes.axhline(0.0, color=FLOOR, linewidth=1.0)
    low, high = plan.limits(seen, others)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=f"{'xyz'[seen[0]]} [m]")
    axes.set_ylabel("height [m]" if seen == ASIDE else f"{'xyz'[seen[1]]} [m]")
    axes.set_aspect("equal")
    axes.grid(True, color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _bounds(camera: Camera, seen: tuple[int, int]) -> np.ndarray:
    """Unit directions (N, 3) in the world of the lines drawn from a camera: from above the ends of that line through
    the middle of the picture which is wider there, so that cameras may stand on their side; else the optical axis."""
    if seen != ABOVE:
        return camera.R_camera_world[2:]
    size = np.array(camera.image_size)
    along = np.linspace(-0.5, 0.5, _LINE)[:, None]
    lines = [(size - 1) / 2.0 + along * size * way for way in np.eye(2)]
    ends = []
    for line in lines:
        ways = camera.rays(line)[1]
        ways = ways[np.isfinite(ways).all(axis=1)]
        ends.append(ways[[0, -1]] if len(ways) else np.tile(camera.R_camera_world[2], (2, 1)))
    return max(ends, key=lambda pair: float(np.linalg.norm((pair[1] - pair[0])[list(seen)])))


def name_cameras(drawing: Figure, plan: RigPlan, panels: Mapping[tuple[int, int], Axes]) -> None:
    """Lay out a figure, once, and write each camera's name beside it in its panels, see `draw_rig`, where neither names
    nor cameras are."""
    drawing.draw_without_rendering()
    drawing.set_layout_engine("none")
    for seen, axes in panels.items():
        _name_in(axes, plan, seen)


def _name_in(axes: Axes, plan: RigPlan, seen: tuple[int, int]) -> None:
    at = axes.transData.transform(plan.centres[:, seen])
    middle = axes.transData.transform(plan.middle[list(seen)])
    taken = [_around(place, axes.figure.dpi) for place in at]
    for c, camera in enumerate(plan.cameras):
        note = axes.annotate(
            camera.name, plan.centres[c][list(seen)], (0.0, 0.0), textcoords="offset points", ha="center", va="center",
            fontsize=9.0,
        )  # fmt: skip
        others = [box for k, box in enumerate(taken) if k != c]
        taken.append(_placed(note, axes, others, at[c] - middle))


def _around(place: np.ndarray, dpi: float) -> np.ndarray:
    """Corners (2, 2) of a camera's mark [px]."""
    return np.array([place - _DOT * dpi / 72.0, place + _DOT * dpi / 72.0])


def _placed(note: Annotation, axes: Axes, taken: Sequence[np.ndarray], outwards: np.ndarray) -> np.ndarray:
    """Move a name to the nearest free place, away from the person first; returns its corners (2, 2) [px]."""
    first = float(np.arctan2(outwards[1], outwards[0]))
    turns = sorted(2.0 * np.pi * np.arange(_WAYS) / _WAYS, key=lambda turn: min(turn, 2.0 * np.pi - turn))
    size = note.get_window_extent()
    half = np.array([size.width, size.height]) * 36.0 / axes.figure.dpi
    corners = np.array([[size.x0, size.y0], [size.x1, size.y1]])
    frame = np.array(axes.bbox.get_points())
    for away, turn in product(_AWAY, turns):
        way = np.array([np.cos(first + turn), np.sin(first + turn)])
        offset = way * (away + half)
        box = corners + offset * axes.figure.dpi / 72.0
        inside = bool(np.all(box[0] >= frame[0]) and np.all(box[1] <= frame[1]))
        if inside and not any(_overlap(box, other) for other in taken):
            note.xyann = tuple(offset)
            return box
    note.xyann = tuple(np.array([0.0, _AWAY[0] + half[1]]))
    return corners


def _overlap(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.all(a[0] < b[1]) and np.all(b[0] < a[1]))


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
