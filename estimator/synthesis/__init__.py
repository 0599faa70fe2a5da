"""Clips with known truth: a motion, seen by known cameras, with a detector's keypoints."""

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
