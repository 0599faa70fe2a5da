"""The part of a picture that contains a mask, so that the rest is not processed."""

from __future__ import annotations

import cv2
import numpy as np


def box_about(mask: np.ndarray, margin: int) -> tuple[slice, slice]:
    """Rows and columns of the true pixels of a mask (H, W) bool and so many around them; none where there are no such
    pixels."""
    x, y, width, height = cv2.boundingRect(np.ascontiguousarray(mask).view(np.uint8))
    if not width:
        return slice(0), slice(0)
    return slice(max(0, y - margin), y + height + margin), slice(max(0, x - margin), x + width + margin)
