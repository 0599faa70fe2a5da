"""Cameras of a rig and the path of a person as they are seen from above or from the side, in metres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.runs.pairs import HIPS
from viz.pictures.plot import COLOURS, MARKS

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
