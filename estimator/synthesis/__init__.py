"""Clips with known truth: a motion, seen by known cameras, with a detector's keypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from humanoid.support.lazy import lazy_names

if TYPE_CHECKING:
    from estimator.synthesis.detector import first_frame, keypoints
    from estimator.synthesis.motion import MOTION_SECONDS, authored_motion
    from estimator.synthesis.render import Renderer
    from estimator.synthesis.scene import write_truth
    from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
    from estimator.synthesis.views import framing_cameras, scene_cameras

__all__ = [
    "MOTION_SECONDS",
    "DetectorSettings",
    "Renderer",
    "SceneSettings",
    "ViewSettings",
    "authored_motion",
    "first_frame",
    "framing_cameras",
    "keypoints",
    "scene_cameras",
    "write_truth",
]

# the settings of a clip can be checked before all that renders it is loaded
__getattr__ = lazy_names(
    __name__,
    {
        "MOTION_SECONDS": "estimator.synthesis.motion",
        "DetectorSettings": "estimator.synthesis.settings",
        "Renderer": "estimator.synthesis.render",
        "SceneSettings": "estimator.synthesis.settings",
        "ViewSettings": "estimator.synthesis.settings",
        "authored_motion": "estimator.synthesis.motion",
        "first_frame": "estimator.synthesis.detector",
        "framing_cameras": "estimator.synthesis.views",
        "keypoints": "estimator.synthesis.detector",
        "scene_cameras": "estimator.synthesis.views",
        "write_truth": "estimator.synthesis.scene",
    },
)
