"""Writing pictures as a video."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from humanoid.errors import InputError


def write_video(path: str | Path, frames: Iterable[np.ndarray], fps: float) -> Path:
    """Write BGR frames (H, W, 3) uint8 as an mp4.

    Raises
    ------
    InputError: the file cannot be written, or there is no frame.
    """
    writer: cv2.VideoWriter | None = None
    try:
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
                if not writer.isOpened():
                    raise InputError(path, "cannot be written", remedy="a path ending in .mp4 in an existing folder")
            writer.write(frame)
        if writer is None:
            raise InputError(path, "there is no frame to write")
    finally:
        if writer is not None:
            writer.release()
    return Path(path)
