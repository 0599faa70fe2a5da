"""Clips with known truth: an authored motion, seen by known cameras, with a detector's keypoints."""

from estimator.synthesis.detector import keypoints
from estimator.synthesis.motion import MOTION_SECONDS, authored_motion
from estimator.synthesis.render import Renderer, write_video
from estimator.synthesis.scene import scene_cameras, write_truth

__all__ = ["MOTION_SECONDS", "Renderer", "authored_motion", "keypoints", "scene_cameras", "write_truth", "write_video"]
