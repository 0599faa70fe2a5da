"""Samples of a posterior of poses, from the front over the picture and from the side (Taycher et al. 2004, Figures 2
and 3)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.picture import write_picture
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from viz import palette
from viz.pictures.overlay import chosen_cameras, reduced, side_by_side
from viz.pictures.painter import BodyPainter, ImageProjection, OrthographicView, camera_view
from viz.scene import evenly, pictured_scene

_METRES = 1.6  # shown from the side, across the narrower dimension
_FAINT = 0.35  # of a single sample; those that agree add up
_DARKER = 0.55  # is the picture, so that samples stand out
_CAPTION = 22  # px
FRAMES, COUNT = 6, 40


def write_samples(
    run: Run, path: str | Path, *, frames: int = FRAMES, count: int = COUNT, seed: int = 0, camera: str | None = None
) -> Path:
    """Write a PNG of evenly spaced instants of a run, each with `count` poses drawn from its calibrated posterior.

    Raises
    ------
    InputError: a run without a pose, or that was made from another motion; no such camera, a file that cannot be
        written.
    """
    if run.header.retargeted:
        problem = "was made from another motion, not tracked: it has no posterior to draw poses from"
        raise InputError(run.file, problem, remedy="kinemode overlay draws it")
    rows = [t for t in range(len(run)) if len(run.result(t).weight)]
    if not rows:
        raise InputError(run.file, "contains no poses", remedy="track with --resume first")
    rows = [rows[k] for k in evenly(len(rows), frames)]
    scene, painter, rng = pictured_scene(run), BodyPainter(run.body), np.random.default_rng(seed)
    chosen = chosen_cameras(scene, camera)[0]
    tiles = []
    for t, picture in zip(rows, scene.images(chosen, rows), strict=True):
        q = run.posterior(t).sample(rng, count)
        label = f"{scene.label(chosen, t)}, {scene.status[t]}"
        tiles.append(captioned(samples_tile(picture, scene.cameras[chosen], painter, q), label))
    return write_picture(path, side_by_side(tiles))


def captioned(tile: np.ndarray, label: str) -> np.ndarray:
    """A tile below a line of text."""
    strip = palette.plain(tile.shape[1], _CAPTION, palette.PANEL)
    palette.text(strip, label, (4, 16), 9.0)
    return np.ascontiguousarray(np.concatenate([strip, tile]))


def draw_samples(image: np.ndarray, view: ImageProjection, painter: BodyPainter, q: np.ndarray) -> None:
    """Draw skeletons of poses q (N, nq) into an image (H, W, 3) uint8 BGR in place; where many agree it is brighter."""
    covered = np.zeros(image.shape[:2], dtype=np.float32)
    for pose in q:
        mask = np.zeros(image.shape[:2], dtype=np.uint8)
        painter.bones(mask, view, painter.body.at(pose), 1.0)
        covered = covered + (1.0 - covered) * (_FAINT / 255.0) * mask
    palette.tint(image, np.round(255.0 * covered).astype(np.uint8), palette.HYPOTHESIS)


def samples_tile(
    picture: np.ndarray | None, camera: Camera, painter: BodyPainter, q: np.ndarray, longest: int = 320
) -> np.ndarray:
    """Poses q (N, nq) over a picture (H, W, 3) BGR, None for none, its longer side at most `longest` px, and below it
    from the side, where what is nearer to the camera is on the left."""
    front = camera_view(camera, longest)
    above = cv2.convertScaleAbs(reduced(picture, front), alpha=_DARKER)
    draw_samples(above, front, painter, q)
    side = _from_the_side(camera, painter, q, front.size)
    below = palette.plain(*front.size)
    draw_samples(below, side, painter, q)
    return np.ascontiguousarray(np.concatenate([above, below]))


def _from_the_side(camera: Camera, painter: BodyPainter, q: np.ndarray, size: tuple[int, int]) -> OrthographicView:
    """Across the way that the camera looks, the landmarks in the middle."""
    _, down, forward = camera.R_camera_world
    places = painter.body.landmarks_of(painter.body.placed(q)).reshape(-1, 3)
    centre = 0.5 * (places.min(axis=0) + places.max(axis=0)) if len(places) else np.zeros(3)
    R_view_world = np.stack([forward, down, np.cross(forward, down)])
    return OrthographicView(R_view_world, centre, min(size) / _METRES, size)
