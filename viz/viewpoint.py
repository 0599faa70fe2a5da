"""From where a body is drawn that no camera saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.runs.run_file import Run
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import ROOT_TURN_Q
from viz.scene import Scene, as_scene

NAME = "view"
_SIZE = (640, 480)
_BESIDE = 40.0  # of the direction that the body faces, to its left [deg]
_FRAMES = 200  # that the camera is to hold


def pictured_scene(source: Scene | Run) -> Scene:
    """`as_scene`; where no camera saw the body, as one would that looks at it from the front and a little from the
    side, without a picture.

    Raises InputError for a run without a single tracked frame.
    """
    scene = as_scene(source)
    if scene.cameras:
        return scene
    known = scene.q[np.isfinite(scene.q).all(axis=1)]
    some = known[np.unique(np.linspace(0, len(known) - 1, _FRAMES).round().astype(int))]
    points = scene.body.landmarks_of(scene.body.placed(some))
    settings = ViewSettings(azimuth=_heading(scene, known) + _BESIDE, image_size=_SIZE)
    (camera,) = framing_cameras(points, settings)
    shape = (len(scene), 1, len(scene.body.landmark_names))
    return replace(
        scene, cameras=(replace(camera, name=NAME, distortion=np.zeros(5)),), frames=(None,), clip_frames=(None,),
        pixels=np.full((*shape, 2), np.nan), confidence=np.zeros(shape),
    )  # fmt: skip


def _heading(scene: Scene, q: np.ndarray) -> float:
    """Where a free root's x axis points in the middle of poses q (T, nq) [deg, -180 to 180]; 0 of a fixed one."""
    if not scene.body.has_free_root:
        return 0.0
    x, y, z, w = q[len(q) // 2, ROOT_TURN_Q]
    return float(np.degrees(np.arctan2(2.0 * (x * y + z * w), 1.0 - 2.0 * (y * y + z * z))))
