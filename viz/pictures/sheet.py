"""Contact sheet: a run at a glance, from the camera and from the side."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from estimator.data.media.picture import write_picture
from estimator.runs.run_reader import Run
from viz import palette
from viz.pictures.overlay import chosen_cameras, drawn
from viz.pictures.painter import BodyPainter, CameraProjection, OrthographicView, camera_view
from viz.scene import Scene, evenly, pictured_scene

FRAMES = 6
TILE = (300, 380)  # width, height of one picture [px]
_SIDE_METRES = 2.3  # height of the world that a side view shows
_GAP = 6
_CAPTION = 26
_HEADER = 40
_OTHERS = 3  # hypotheses shown from the side, beside the best


def write_sheet(run: Run | Scene, path: str | Path, *, frames: int = FRAMES, camera: str | None = None) -> Path:
    """Write a PNG: evenly spaced instants; above, the overlay around the person; below, the bodies from the side.

    The side view is a parallel projection from the camera's left, the depths of that camera running to the right:
    there the hypotheses, alike in the image, differ.
    """
    scene = pictured_scene(run)
    chosen = chosen_cameras(scene, camera)[0]
    rows = evenly(len(scene), frames)
    painter = BodyPainter(scene.body)
    view = camera_view(scene.cameras[chosen], max(scene.cameras[chosen].image_size))
    columns = []
    for t, image in zip(rows, scene.images(chosen, rows), strict=True):
        columns.append(_column(scene, painter, view, chosen, t, image))
    gap = palette.plain(_GAP, columns[0].shape[0], palette.PANEL)
    pieces = [piece for column in columns for piece in (gap, column)] + [gap]
    body = np.concatenate(pieces, axis=1)
    sheet = np.concatenate([_header(scene, painter, chosen, body.shape[1]), body], axis=0)
    return write_picture(path, sheet)


def _column(
    scene: Scene, painter: BodyPainter, view: CameraProjection, camera: int, t: int, image: np.ndarray | None
) -> np.ndarray:
    canvas = drawn(scene, painter, view, camera, t, image, caption=False)
    above = _crop(canvas, _box(scene, painter, view, t))
    gap = palette.plain(TILE[0], _GAP, palette.PANEL)
    return np.concatenate([above, gap, _side(scene, painter, view, t), _caption(scene, camera, t)], axis=0)


def _box(scene: Scene, painter: BodyPainter, view: CameraProjection, t: int) -> tuple[np.ndarray, float]:
    """Centre and height [px] of a crop of the tile's shape with the whole body and some room around it."""
    if not scene.has_body(t):
        return np.array(view.size) / 2.0, float(view.size[1])
    pixels, _ = view.project(painter.vertices(scene.body.at(scene.q[t])))
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if len(pixels) == 0:
        return np.array(view.size) / 2.0, float(view.size[1])
    low, high = np.clip(pixels.min(axis=0), 0, view.size), np.clip(pixels.max(axis=0), 0, view.size)
    extent = high - low
    height = 1.25 * max(float(extent[1]), float(extent[0]) * TILE[1] / TILE[0], 40.0)
    return (low + high) / 2.0, height


def _crop(canvas: np.ndarray, box: tuple[np.ndarray, float]) -> np.ndarray:
    centre, height = box
    scale = TILE[1] / height
    if scale < 0.5:  # an affine warp alone would skip pixels
        canvas = cv2.resize(canvas, None, fx=2 * scale, fy=2 * scale, interpolation=cv2.INTER_AREA)
        centre, scale = centre * 2 * scale, 0.5
    matrix = np.array([[scale, 0.0, TILE[0] / 2 - scale * centre[0]], [0.0, scale, TILE[1] / 2 - scale * centre[1]]])
    return cv2.warpAffine(canvas, matrix, TILE, flags=cv2.INTER_AREA, borderValue=palette.bgr(palette.BACKGROUND))


def _side(scene: Scene, painter: BodyPainter, view: CameraProjection, t: int) -> np.ndarray:
    if not scene.has_body(t):
        return palette.plain(*TILE)
    forward = view.axes()[2] * np.array([1.0, 1.0, 0.0])
    if np.linalg.norm(forward) < 1e-6:
        forward = np.array([1.0, 0.0, 0.0])
    right = forward / np.linalg.norm(forward)
    R_view_world = np.stack([right, [0.0, 0.0, -1.0], np.cross(right, [0.0, 0.0, -1.0])])
    posed = scene.body.at(scene.q[t])
    vertices = painter.vertices(posed)
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    span = max(_SIDE_METRES, 1.25 * float(np.ptp(vertices[:, 2])))
    side = OrthographicView(R_view_world, centre, TILE[1] / span, TILE)
    canvas = palette.plain(*TILE)
    _ground(canvas, side, float(vertices[:, 2].min()))
    for _, q, weight in scene.others(t)[-_OTHERS:]:
        painter.solid(canvas, side, scene.body.at(q), 0.25 + 0.4 * weight, palette.HYPOTHESIS)
    painter.solid(canvas, side, posed, 0.95)
    return canvas


def _ground(canvas: np.ndarray, side: OrthographicView, height: float) -> None:
    level, _ = side.project(np.array([side.centre[0], side.centre[1], height]))
    y = round(float(level[1]))
    cv2.line(canvas, (0, y), (canvas.shape[1], y), palette.bgr(palette.GRID), 1, cv2.LINE_AA)


def _caption(scene: Scene, camera: int, t: int) -> np.ndarray:
    strip = palette.plain(TILE[0], _CAPTION, palette.PANEL)
    x = palette.text(strip, f"{scene.label(camera, t)}   {scene.time[t]:.2f} s", (4, 18), 10.0)
    status = scene.status[t]
    palette.text(strip, status, (x + 12, 18), 10.0, palette.STATUS.get(status, palette.TEXT))
    count = f"{len(scene.others(t)) + 1} modes"
    palette.text(strip, count, (TILE[0] - 4 - palette.text_width(count, 10.0), 18), 10.0, palette.MUTED)
    return strip


def _header(scene: Scene, painter: BodyPainter, camera: int, width: int) -> np.ndarray:
    strip = palette.plain(width, _HEADER, palette.PANEL)
    x = palette.text(strip, scene.body.subject.name, (_GAP + 4, 26), 13.0)
    x = palette.text(strip, f"camera {scene.cameras[camera].name}", (x + 18, 26), 11.0, palette.MUTED)
    for side in painter.sides:
        if side != "trunk":
            x = palette.text(strip, side, (x + 18, 26), 11.0, palette.SIDES[side])
    x = palette.text(strip, "other hypotheses", (x + 18, 26), 11.0, palette.HYPOTHESIS)
    note = "below: from the side, away from the camera to the right"
    if x + 40 + palette.text_width(note, 11.0) < width:
        palette.text(strip, note, (width - _GAP - 4 - palette.text_width(note, 11.0), 26), 11.0, palette.MUTED)
    return strip
