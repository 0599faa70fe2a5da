"""Entries of clips in a batch, which of them to review first, and a small picture by which each is known again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import TRACKED
from humanoid.kinematics.body import PosedBody
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from viz import palette
from viz.pictures.overlay import reduced
from viz.pictures.painter import BodyPainter, CameraProjection, camera_view
from viz.scene import Frames, Scene, pictured_scene

WIDTH, HEIGHT = 160, 120  # px, of thumbnails
DONE, FAILED, WAITING = "done", "failed", "waiting"
STATUSES = (DONE, FAILED, WAITING)
"""Statuses of a clip; an interrupted one waits."""


@dataclass(frozen=True)
class BatchEntry:
    """One clip of a batch, or one run of a clip in which everybody is tracked.

    status: one of `STATUSES`. message: the error of a failed one, else a finding. frames, hard, unobserved, doubtful:
    as `run_facts` counts them. error [m]: mean joint error against the row's reference. seconds: of wall-clock
    time. processor_seconds: of all its threads. thumbnail, report, run: paths relative to the page, "" where there is
    none; exports: those of the run in other formats.

    Raises
    ------
    ValueError: another status.
    """

    name: str
    status: str = DONE
    person: str = ""
    message: str = ""
    subject: str = ""
    tracker: str = ""
    frames: int | None = None
    hard: int | None = None
    unobserved: int | None = None
    doubtful: float | None = None
    error: float | None = None
    seconds: float | None = None
    processor_seconds: float | None = None
    thumbnail: str = ""
    report: str = ""
    run: str = ""
    exports: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"status must be one of {', '.join(STATUSES)}, got {self.status!r}")


def known(value: float | None) -> bool:
    """Whether there is such a number: neither None nor NaN or infinite."""
    return value is not None and math.isfinite(value)


def look_ranks(entries: Sequence[BatchEntry]) -> tuple[int | None, ...]:
    """Rank of each clip to be reviewed: 1, 2, ...; None for those without a problem.

    Failed ones come first, then by the share of untrustworthy frames, by the share of hard ones, and among equal ones
    those with a finding; otherwise in the given order.
    """
    doubted = [i for i, entry in enumerate(entries) if _is_doubted(entry)]
    ranks = {i: rank for rank, i in enumerate(sorted(doubted, key=lambda i: _sureness(entries[i])), 1)}
    return tuple(ranks.get(i) for i in range(len(entries)))


def _is_doubted(entry: BatchEntry) -> bool:
    if entry.status != DONE:
        return entry.status == FAILED
    return bool(entry.message) or any(map(_positive, (entry.doubtful, entry.hard)))


def _sureness(entry: BatchEntry) -> tuple[bool, float, float, bool]:
    """Sort key that rises from the clip to be reviewed first."""
    if entry.status == FAILED:
        return False, 0.0, 0.0, False
    hard = _number(entry.hard) / max(1.0, _number(entry.frames))
    return True, -_number(entry.doubtful), -hard, not entry.message


def _number(value: float | None) -> float:
    return float(value) if value is not None and known(value) else 0.0


def _positive(value: float | None) -> bool:
    return _number(value) > 0.0


BYTES = 10_000
"""A thumbnail takes at most so much."""
_QUALITIES = (82, 70, 55, 40, 25, 10, 1)  # of a JPEG
_FINE = 3  # it is drawn this many times larger and then reduced
_MARGIN = 0.1  # around the person, of its longer side, on each side
_LEAST = 80  # width of the picture that is shown: a person far away is not made up from a few pixels [px]
_VISIBLE = 4.0  # of the person in the picture, across and down [px]
_NEAR = 0.05  # what is closer to the eye than this is not drawn [m]
_RIM, _LIMB = 7, 4  # widths of lines [px of the larger picture]


def write_thumbnail(run: Run | Scene, path: str | Path, pictures: Mapping[str, Frames] | None = None) -> Path:
    """Write a JPEG of `WIDTH` x `HEIGHT` px and at most `BYTES`, and return its path.

    It shows the middle one of the tracked frames (of all with a pose where none is), by the first camera whose clip is
    available and shows the person; without a clip the skeleton on a plain ground, as seen by the first camera.

    pictures: opens the frames of cameras, by their names, in place of the clips that the run names.
    Raises InputError for a run without a tracked frame, or a file that cannot be written.
    """
    scene = pictured_scene(run)
    if pictures is not None:
        own = zip(scene.cameras, scene.frames, strict=True)
        scene = replace(scene, frames=tuple(pictures.get(camera.name, frames) for camera, frames in own))
    with replacing(path) as temporary:
        temporary.write_bytes(_small_jpeg(thumbnail(scene)))
    return Path(path)


def thumbnail(scene: Scene) -> np.ndarray:
    """The picture that `write_thumbnail` writes, (HEIGHT, WIDTH, 3) uint8 BGR."""
    t = shown_row(scene)
    painter, posed = BodyPainter(scene.body), scene.body.at(scene.q[t])
    window, image = _best_window(scene, painter, posed, t)
    canvas = window.part_of(image)
    _draw_skeleton(canvas, window, painter, posed)
    return cv2.resize(canvas, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


def shown_row(scene: Scene) -> int:
    """Row of the middle one of the tracked frames; of all with a pose where none is."""
    posed = [t for t in range(len(scene)) if scene.has_body(t)]
    rows = [t for t in posed if scene.status[t] == TRACKED] or posed
    return rows[len(rows) // 2]


@dataclass(frozen=True)
class _Window:
    """A part of a camera's view. low (2,) [px]: its upper left corner. extent: its width and height [px]."""

    view: CameraProjection
    low: np.ndarray
    extent: tuple[int, int]

    def pixels(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World points (N, 3) [m] -> places (N, 2) in the picture of `part_of` and depths (N,) [m]."""
        pixels, depth = self.view.project(points)
        scale = np.array([WIDTH, HEIGHT]) * _FINE / np.array(self.extent)
        return (pixels - self.low + 0.5) * scale - 0.5, depth

    def part_of(self, image: np.ndarray | None) -> np.ndarray:
        """The part of the camera's picture that it shows, `_FINE` times as large as the thumbnail; plain without a
        picture."""
        size = (WIDTH * _FINE, HEIGHT * _FINE)
        if image is None:
            return palette.plain(*size)
        whole = reduced(image, self.view)
        part = palette.plain(*self.extent, palette.PANEL)
        first, last = np.maximum(self.low, 0), np.minimum(self.low + self.extent, self.view.size)
        (x, y), (right, bottom) = first - self.low, last - self.low
        part[y:bottom, x:right] = whole[first[1] : last[1], first[0] : last[0]]
        reduces = self.extent[0] > size[0]
        return cv2.resize(part, size, interpolation=cv2.INTER_AREA if reduces else cv2.INTER_LINEAR)


def _best_window(scene: Scene, painter: BodyPainter, posed: PosedBody, t: int) -> tuple[_Window, np.ndarray | None]:
    """The shown part, and the camera's whole picture."""
    vertices = painter.vertices(posed)
    views = [camera_view(camera, max(camera.image_size)) for camera in scene.cameras]
    for c, view in enumerate(views):
        box = _box(view, vertices)
        image = None if box is None else _picture(scene, c, t)
        if image is not None:
            return _window(view, box), image
    return _window(views[0], _box(views[0], vertices)), None


def _picture(scene: Scene, camera: int, t: int) -> np.ndarray | None:
    try:
        return next(scene.images(camera, [t]), None)
    except (InputError, OSError):  # a clip that was damaged, or went away, since
        return None


def _box(view: CameraProjection, vertices: np.ndarray) -> np.ndarray | None:
    """Upper left and lower right of what is in the picture of a body's vertices (V, 3) [m], (2, 2) [px]; None where it
    is almost empty."""
    pixels, depth = view.project(vertices)
    pixels = pixels[np.isfinite(pixels).all(axis=1) & (depth > _NEAR)]
    if not len(pixels):
        return None
    box = np.clip([pixels.min(axis=0), pixels.max(axis=0)], 0.0, np.array(view.size) - 1.0)
    return box if (box[1] - box[0] >= _VISIBLE).all() else None


def _window(view: CameraProjection, box: np.ndarray | None) -> _Window:
    """The part around a box, all of the picture for None: within the picture where it is large enough."""
    size, shape = np.array(view.size), np.array([1.0, HEIGHT / WIDTH])
    low, high = np.array([[0.0, 0.0], size - 1.0]) if box is None else box
    extent = high - low + 1.0 + (0.0 if box is None else 2.0 * _MARGIN * (high - low).max())
    wide = min(max(_LEAST, (extent / shape).max()), (size / shape).max())
    extent = np.maximum(1, np.round(wide * shape)).astype(int)
    corner = np.round(0.5 * (low + high + 1.0) - 0.5 * extent)
    inside = np.clip(corner, 0, np.maximum(0, size - extent))
    corner = np.where(extent <= size, inside, np.round(0.5 * (size - extent)))  # the rest stays plain, on both sides
    return _Window(view, corner.astype(int), (int(extent[0]), int(extent[1])))


def _draw_skeleton(canvas: np.ndarray, window: _Window, painter: BodyPainter, posed: PosedBody) -> None:
    """Limbs in the colours of their sides, with dark rims, into a picture (H, W, 3) uint8 BGR in place."""
    skeleton = painter.skeleton
    pixels, depth = window.pixels(skeleton.at(posed))
    there = np.isfinite(pixels).all(axis=1) & (depth > _NEAR) & (np.abs(pixels).max(axis=1) < 8000.0)
    lines = [
        (np.round(16.0 * pixels[list(ends)]).astype(int).tolist(), palette.SIDES[side])
        for ends, side in zip(skeleton.segments.tolist(), skeleton.sides, strict=True)
        if there[ends].all()
    ]
    for width, rim in ((_RIM, palette.PANEL), (_LIMB, None)):
        for (first, second), colour in lines:
            cv2.line(canvas, first, second, palette.bgr(rim or colour), width, cv2.LINE_AA, 4)


def _small_jpeg(picture: np.ndarray) -> bytes:
    """The picture as JPEG, as good as fits."""
    for quality in _QUALITIES:
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(data) <= BYTES:
            break
    return data
