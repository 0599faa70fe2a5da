"""Two pictures of one texture that moves, for tests of what follows points."""

from __future__ import annotations

import cv2
import numpy as np


def shifted_textures(shift: tuple[float, float], fine: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Two pictures (120, 160) uint8 of one texture, the second moved by `shift` [px]."""
    noise = np.random.default_rng(3).standard_normal((160, 200)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), fine)
    wide = 120.0 + 35.0 * smooth / smooth.std()
    by = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    moved = cv2.warpAffine(wide, by, (200, 160), flags=cv2.INTER_CUBIC)
    before, now = (np.clip(np.round(p[20:140, 20:180]), 0, 255).astype(np.uint8) for p in (wide, moved))
    return before, now
