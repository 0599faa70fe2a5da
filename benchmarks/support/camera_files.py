"""Camera files as other tools write them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import tomli_w

from estimator.data.cameras.camera import Camera


def write_pose2sim(path: Path, cameras: Sequence[Camera]) -> Path:
    """TOML with a section for each camera, as Pose2Sim's calibration writes it; returns the path."""
    content = toml_sections(cameras) | {"metadata": {"adjusted": False, "error": 0.0}}
    path.write_text(tomli_w.dumps(content), encoding="utf-8")
    return path


def toml_sections(cameras: Sequence[Camera]) -> dict[str, dict[str, Any]]:
    """The entries of Pose2Sim and Anipose for each camera, by name; translations [m]."""
    return {
        c.name: {
            "name": c.name,
            "size": [float(n) for n in c.image_size],
            "matrix": c.K.tolist(),
            "distortions": c.distortion.tolist(),
            "rotation": cv2.Rodrigues(c.R_camera_world)[0].ravel().tolist(),
            "translation": c.t_camera_world.tolist(),
            "fisheye": c.fisheye,
        }
        for c in cameras
    }
