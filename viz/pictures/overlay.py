"""The tracked body drawn over the video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from estimator.data.media.film import check_film_name, write_film
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from viz import palette
from viz.pictures.limb_layer import LimbLayer, limb_layer
from viz.pictures.painter import BodyPainter, CameraProjection, camera_view
from viz.pictures.source_layer import SourceLayer
from viz.scene import Scene, pictured_scene
from viz.solids.body_solids import side_of

LONGEST = 960  # longer side of a camera's picture in the overlay [px]
OPACITY = 0.62
CONFIDENT = 0.3  # keypoints below are drawn hollow
Progress = Callable[[int, int], None]


def write_overlay(
    run: Run | Scene,
    path: str | Path,
    *,
    camera: str | None = None,
    hypotheses: bool = True,
    limbs: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Write the overlay as .mp4, .webm or .gif; several cameras stand side by side.

    camera: draw only this one. hypotheses: draw the others as thin skeletons, fainter the smaller their weight.
    limbs: in place of all bodies draw a run's beliefs of each limb. progress: called with (frames done, frames in all).
    Raises InputError where the camera does not exist, there are no limb estimates, or the file cannot be written.
    """
    check_film_name(Path(path))
    layer = limb_layer(run) if limbs and isinstance(run, Run) else None
    scene = pictured_scene(run)
    chosen = chosen_cameras(scene, camera)
    frames = pictures(scene, chosen, hypotheses, progress, limbs=layer)
    return write_film(path, scene.paced(frames, range(len(scene))), scene.rate)


def pictures(
    scene: Scene,
    chosen: list[int],
    hypotheses: bool,
    progress: Progress | None,
    *,
    rows: range | None = None,
    longest: int = LONGEST,
    limbs: LimbLayer | None = None,
) -> Iterator[np.ndarray]:
    """One picture an instant (H, W, 3) uint8 BGR, the chosen cameras side by side.

    rows: the instants, by default all. longest: longer side of a camera's picture [px]. limbs: see `drawn`.
    """
    views = [camera_view(scene.cameras[c], longest) for c in chosen]
    painter = BodyPainter(scene.body)
    rows = range(len(scene)) if rows is None else rows
    streams = [scene.images(c, rows) for c in chosen]
    for t, *images in zip(rows, *streams, strict=True):
        tiles = [
            drawn(scene, painter, view, c, t, image, hypotheses=hypotheses, limbs=limbs)
            for view, c, image in zip(views, chosen, images, strict=True)
        ]
        yield side_by_side(tiles)
        if progress is not None:
            progress(t + 1 - rows[0], len(rows))


def chosen_cameras(scene: Scene, camera: str | None) -> list[int]:
    """Indices of the cameras to draw."""
    names = [c.name for c in scene.cameras]
    if camera is None:
        return list(range(len(names)))
    if camera not in names:
        raise InputError("camera", f"no camera is called {camera!r}", remedy=f"choose from {', '.join(names)}")
    return [names.index(camera)]


def drawn(
    scene: Scene,
    painter: BodyPainter,
    view: CameraProjection,
    camera: int,
    t: int,
    image: np.ndarray | None,
    *,
    hypotheses: bool = True,
    caption: bool = True,
    limbs: LimbLayer | None = None,
) -> np.ndarray:
    """One camera's picture at one instant with everything on it, (H, W, 3) uint8 BGR.

    limbs: drawn in place of the bodies, which would hide them.
    """
    canvas = reduced(image, view)
    if limbs is not None:
        limbs.draw(canvas, view, t)
    elif scene.source is not None:
        _draw_both(SourceLayer(scene.body, scene.source, view, t, scene.q[t]), painter, canvas)
    elif scene.has_body(t):
        painter.solid(canvas, view, scene.body.at(scene.q[t]), OPACITY if image is not None else 1.0)
    if hypotheses and limbs is None:
        _draw_others(scene, painter, view, t, canvas)
    _draw_keypoints(scene, view, camera, t, canvas)
    if caption:
        _draw_caption(scene, painter, camera, t, canvas)
    return canvas


def reduced(image: np.ndarray | None, view: CameraProjection) -> np.ndarray:
    """The camera's picture at the view's size, or a plain dark one."""
    if image is None:
        return palette.plain(*view.size)
    return cv2.resize(image, view.size, interpolation=cv2.INTER_AREA)


def side_by_side(tiles: list[np.ndarray]) -> np.ndarray:
    """Pictures in a row, shorter ones padded below."""
    height = max(tile.shape[0] for tile in tiles)
    padded = [
        cv2.copyMakeBorder(t, 0, height - t.shape[0], 0, 0, cv2.BORDER_CONSTANT, value=palette.bgr(palette.PANEL))
        for t in tiles
    ]
    return np.ascontiguousarray(np.concatenate(padded, axis=1))


def _draw_both(layer: SourceLayer, painter: BodyPainter, canvas: np.ndarray) -> None:
    """A body and whom it follows, the nearer one in front."""
    layer.draw_floor(canvas)
    if not layer.in_front:
        layer.draw_figure(canvas)
    if np.isfinite(layer.q).all():
        painter.solid(canvas, layer.view, layer.body.at(layer.q), 1.0)
    if layer.in_front:
        layer.draw_figure(canvas)
    layer.draw_names(canvas)


def _draw_others(scene: Scene, painter: BodyPainter, view: CameraProjection, t: int, canvas: np.ndarray) -> None:
    mask = np.zeros(canvas.shape[:2], dtype=np.uint8)
    for _, q, weight in scene.others(t):
        # a hypothesis of little weight still has to be seen at all
        painter.bones(mask, view, scene.body.at(q), min(1.0, 0.3 + 0.9 * weight))
    palette.tint(canvas, mask, palette.HYPOTHESIS)


def _draw_keypoints(scene: Scene, view: CameraProjection, camera: int, t: int, canvas: np.ndarray) -> None:
    radius = max(1.6, max(view.size) / 420.0)
    points = view.pixels(scene.pixels[t, camera])
    for name, point, confidence in zip(scene.body.landmark_names, points, scene.confidence[t, camera], strict=True):
        palette.dot(canvas, point, radius, palette.SIDES[side_of(name)], hollow=confidence < CONFIDENT)


def _draw_caption(scene: Scene, painter: BodyPainter, camera: int, t: int, canvas: np.ndarray) -> None:
    height, width = canvas.shape[:2]
    size = 10.0
    line = int(2.4 * size)
    palette.shade(canvas, height - line, height)
    baseline = height - line // 2 + int(size / 2)
    x = palette.text(canvas, scene.cameras[camera].name, (10, baseline), size, palette.MUTED)
    x = palette.text(canvas, f"{scene.label(camera, t)}   {scene.time[t]:.2f} s", (x + 14, baseline), size)
    status = scene.status[t]
    palette.text(canvas, status, (x + 14, baseline), size, palette.STATUS.get(status, palette.TEXT))
    right = width - 10
    there = {*painter.sides, *(() if scene.source is None else scene.source.sides)}
    for side in reversed([side for side in palette.SIDES if side in there and side != "trunk"]):
        right -= palette.text_width(side, size)
        palette.text(canvas, side, (right, baseline), size, palette.SIDES[side])
        right -= 12
