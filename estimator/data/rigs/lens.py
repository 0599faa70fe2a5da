"""A lens with one radial term, beside the one that was told: flat = f x (1 + k |x|^2), x the place in the plane z = 1
(Brown, Decentering distortion of lenses, 1966; OpenCV's k1)."""

from __future__ import annotations

import numpy as np

_ROUNDS = 8  # of Newton's method
_FLAT = 1e-6  # of a radial term, that is none
_LEAST_SLOPE = 0.1  # of the bent radius by the straight one: where it falls pictures fold


def bent(x: np.ndarray, focal: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """Where places x (..., 2) are seen (..., 2); factors on the focal lengths, and radial terms, (...)."""
    return np.asarray((focal * (1.0 + radial * np.square(x).sum(axis=-1)))[..., None] * x)


def by_place(x: np.ndarray, focal: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, 2) of `bent` by x."""
    own = (1.0 + radial * np.square(x).sum(axis=-1))[..., None, None] * np.eye(2)
    across = (2.0 * radial)[..., None, None] * x[..., :, None] * x[..., None, :]
    return np.asarray(focal[..., None, None] * (own + across))


def by_radial(x: np.ndarray, focal: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2) of `bent` by the radial terms."""
    return np.asarray((focal * np.square(x).sum(axis=-1))[..., None] * x)


def straight(seen: np.ndarray, focal: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """What `bent` makes seen of, NaN of NaN; nearest to the middle where a picture folds."""
    y = seen / focal[..., None]
    if not np.any(radial):
        return np.asarray(y)
    far = np.linalg.norm(y, axis=-1)
    fold = 1.0 / np.sqrt(3.0 * np.maximum(-radial, _FLAT))
    r = np.minimum(far, fold)
    for _ in range(_ROUNDS):
        slope = np.maximum(1.0 + 3.0 * radial * r * r, _LEAST_SLOPE)
        r = np.clip(r - (r * (1.0 + radial * r * r) - far) / slope, 0.0, fold)
    return np.asarray(y * (r / np.maximum(far, 1e-12))[..., None])
