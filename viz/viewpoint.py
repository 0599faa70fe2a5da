"""Viewpoint for drawing a body that no camera saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.runs.run_reader import Run
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from viz.scene import Scene, as_scene
from viz.source_figure import heading

NAME = "view"
_SIZE, _WIDE = (640, 480), (960, 540)  # of one, and of two beside each other
_BESIDE = 40.0  # of the direction that the body faces, to its left [deg]
_FRAMES = 200  # that the camera is to hold


def pictured_scene(source: Scene | Run) -> Scene:
    """`as_scene`; where no camera saw the body, as seen by one from the front and a little from the side, without a
    picture.

    Raises InputError for a run without a single tracked frame.
    """
    scene = as_scene(source)
    if scene.cameras:
        return scene
    known = np.flatnonzero(np.isfinite(scene.q).all(axis=1))
    some = known[np.unique(np.linspace(0, len(known) - 1, _FRAMES).round().astype(int))]
    points = _seen(scene, some)
    size = _SIZE if scene.source is None else _WIDE
    settings = ViewSettings(azimuth=heading(scene.body, scene.q) + _BESIDE, image_size=size)
    (camera,) = framing_cameras(points, settings)
    shape = (len(scene), 1, len(scene.body.landmark_names))
    return replace(
        scene, cameras=(replace(camera, name=NAME, distortion=np.zeros(5)),), frames=(None,), clip_frames=(None,),
        pixels=np.full((*shape, 2), np.nan), confidence=np.zeros(shape),
    )  # fmt: skip


def _seen(scene: Scene, rows: np.ndarray) -> np.ndarray:
    """Points (T, N, 3) [m] that are to be in the picture at instants `rows` (T,): the body's landmarks; where it stands
    beside its source, the source's too, and the body's joints, as not all robots have a landmark on their heads."""
    placed = scene.body.placed(scene.q[rows])
    landmarks = scene.body.landmarks_of(placed)
    if scene.source is None:
        return landmarks
    beside = scene.source.points[rows]
    joints = placed.placements[:, 1:, 9:]
    beside = np.where(np.isfinite(beside), beside, joints[:, :1])  # what is missing widens nothing
    return np.concatenate([landmarks, joints, beside], axis=1)
