"""Pictures as files: reading and writing one, without OpenCV's own words on the terminal."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from humanoid.support.quiet import captured_output

WRITTEN = (".png", ".jpg", ".jpeg", ".bmp")
_DAMAGED = "Corrupt JPEG data"  # libjpeg continues, with grey or garbage in damaged parts


def read_picture(path: Path) -> tuple[np.ndarray, bool]:
    """The picture (H, W, 3) uint8 BGR, and whether it is whole as far as can be checked.

    Raises
    ------
    InputError: not a picture, or one that cannot be decoded.
    """
    image, said = _decoded(path, cv2.IMREAD_COLOR)
    return np.asarray(image, dtype=np.uint8), not any(_DAMAGED in text for text in said)


def read_numbers(path: Path) -> np.ndarray:
    """The picture as it is stored, (H, W) or (H, W, channels), of any depth.

    Raises
    ------
    InputError: not a picture, or one that cannot be decoded.
    """
    return _decoded(path, cv2.IMREAD_UNCHANGED)[0]


def _decoded(path: Path, flags: int) -> tuple[np.ndarray, list[str]]:
    """A picture and its decoder's messages."""
    try:
        data = np.fromfile(path, dtype=np.uint8)
        with captured_output() as said:
            image = cv2.imdecode(data, flags) if data.size else None
    except (OSError, cv2.error):
        image = None
    if image is None:
        raise InputError(path, "is not an image that can be decoded")
    return np.asarray(image), said


def write_picture(path: str | Path, image: np.ndarray) -> Path:
    """Write (H, W, 3) uint8 BGR, or (H, W), in the format of the path's ending; the file is written whole or not at
    all.

    Raises
    ------
    InputError: another ending than `WRITTEN`, or a file that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITTEN:
        raise InputError(path, f"no picture can end in {path.suffix!r}", remedy=f"one of {', '.join(WRITTEN)}")
    done, data = cv2.imencode(path.suffix.lower(), image)  # by imwrite a full disk would go unnoticed
    if not done:
        raise InputError(path, "cannot be encoded")
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())
    return path
