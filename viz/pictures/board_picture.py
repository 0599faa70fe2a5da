"""A picture of a calibration: the worst view of each camera, where corners were seen, and how far off they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.boards.board import BoardSighting
from estimator.data.boards.calibrate import BoardCalibration, BoardView
from humanoid.support.files import replacing
from viz.pictures.plot import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 8  # cameras
_ARROW = 0.06  # of the picture's longer side: length of the arrow of the 95th percentile's distance
_ROUND = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def write_board_picture(
    calibration: BoardCalibration, picture_of: Callable[[BoardSighting], np.ndarray], path: Path
) -> Path:
    """Write a PNG with a row for each camera, of the first eight; picture_of: the picture (H, W, 3) BGR of a view.

    On the left the view with the largest error, with corners as they were seen and where they should be; on the right
    all corners with arrows to where they should be, enlarged, so that a pattern shows a lens that does not fit.

    Raises
    ------
    InputError: a file that cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(calibration.cameras)[:_MOST]
    figure = Figure(figsize=(12.0, 4.8 * len(names)), layout="constrained")
    FigureCanvasAgg(figure)
    for name, (left, right) in zip(names, figure.subplots(len(names), 2, squeeze=False), strict=True):
        views = calibration.of(name)
        _draw_view(left, views[0], picture_of(views[0].view))
        _draw_corners(right, views, calibration.cameras[name].image_size)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
    return path


def _draw_view(axes: Axes, worst: BoardView, picture: np.ndarray) -> None:
    axes.imshow(picture[..., ::-1])
    seen = worst.view.pixels[worst.view.seen]
    there = worst.expected[worst.view.seen]
    axes.plot(*seen.T, "o", markersize=7, markerfacecolor="none", markeredgecolor=COLOURS[1], label="seen")
    axes.plot(*there.T, "+", markersize=6, color=COLOURS[6], label="where it should be")
    axes.set_title(f"{worst.view.camera}, the worst view: {worst.view.label}, {worst.error:.2f} px", loc="left")
    axes.legend(loc="lower right", fontsize="small")
    axes.set_xticks([])
    axes.set_yticks([])


def _draw_corners(axes: Axes, views: Sequence[BoardView], size: tuple[int, int]) -> None:
    seen = np.concatenate([v.view.pixels[v.view.seen] for v in views])
    off = np.concatenate([v.expected[v.view.seen] for v in views]) - seen
    most = float(np.nanpercentile(np.linalg.norm(off, axis=1), 95))
    enlarged = max((k for k in _ROUND if k * most <= _ARROW * max(size)), default=1)
    axes.plot(*seen.T, ".", markersize=2, color=COLOURS[0])
    axes.quiver(*seen.T, *(enlarged * off).T, angles="xy", scale_units="xy", scale=1.0, color=COLOURS[1], width=0.002)
    width, height = size
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_title(f"{len(views)} views; arrows to where corners should be, {enlarged} times as long", loc="left")
    axes.set_xlabel("x [px]")
    axes.set_ylabel("y [px]")
