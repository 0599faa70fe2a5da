"""The rotation, rigid motion or similarity that brings points nearest to others, in least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Similarity(NamedTuple):
    """x -> scale R x + t: R (3, 3), t (3,) [m]."""

    R: np.ndarray
    t: np.ndarray
    scale: float = 1.0

    def of(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) moved."""
        return np.asarray(self.scale * points @ self.R.T + self.t)


def rotation_onto(vectors: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """The proper rotation (3, 3) that brings vectors (N, 3) nearest to others (N, 3) (Kabsch 1976).

    Where all lie in one direction it is one of many.
    """
    return _rotation(vectors, reference)[0]


def similarity_onto(points: np.ndarray, reference: np.ndarray, *, scaled: bool = False) -> Similarity:
    """The rigid motion that brings points (N, 3) nearest to others (N, 3) [m]; `scaled`: with the best scale, too.

    Reflections are excluded. Points that all coincide are moved, and neither turned nor scaled. Source: Umeyama, IEEE
    TPAMI 13(4), 1991, equations 39 to 43.
    """
    mean_points, mean_reference = points.mean(axis=0), reference.mean(axis=0)
    centred = points - mean_points
    R, strength = _rotation(centred, reference - mean_reference)
    spread = float((centred * centred).sum())
    if spread == 0.0:
        return Similarity(np.eye(3), mean_reference - mean_points)
    scale = strength / spread if scaled else 1.0
    return Similarity(R, mean_reference - scale * R @ mean_points, scale)


def motions_onto(points: np.ndarray, reference: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R (N, 3, 3), t (N, 3) of the rigid motions that bring points (M, 3) nearest to each of many others (N, M, 3), by
    weights (N, M), whose sum is above 0; what has no weight may be NaN. As `similarity_onto`, many at once."""
    share = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    reference = np.where(share > 0.0, reference, 0.0)
    from_centre = points - (share * points).sum(axis=1, keepdims=True)
    centre = (share * reference).sum(axis=1, keepdims=True)
    U, _, Vt = np.linalg.svd(np.swapaxes(share * (reference - centre), 1, 2) @ from_centre)
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    R = U @ Vt
    return R, centre[:, 0] - np.einsum("nij,nj->ni", R, (share * points).sum(axis=1))


def _rotation(vectors: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, float]:
    """The rotation R (3, 3), and the sum of reference . R vectors."""
    U, singular, Vt = np.linalg.svd(reference.T @ vectors)
    proper = np.array([1.0, 1.0, np.linalg.det(U @ Vt)])  # the best orthogonal matrix may be a reflection
    return np.asarray((U * proper) @ Vt), float(singular @ proper)
