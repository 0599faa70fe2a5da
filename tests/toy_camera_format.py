"""A camera format of another package: one line a camera. Registered by being imported."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat
from estimator.data.formats.cameras import register


def read(file: CameraFile) -> list[Camera]:
    """Lines of name, width, height, focal length [px], nine numbers of R row by row, three of t [m]."""
    cameras = []
    for line in file.content.decode().splitlines()[1:]:
        name, *texts = line.split()
        width, height, focal, *pose = map(float, texts)
        K = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
        R, t = np.array(pose[:9]).reshape(3, 3), np.array(pose[9:])
        cameras.append(Camera(name, (int(width), int(height)), K, np.zeros(5), R, t))
    return cameras


register(CameraFormat("camera lines", lambda file: file.start.startswith(b"# camera lines"), read))
