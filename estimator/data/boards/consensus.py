"""The placement of one camera to another that most pictures of a board support, each with both its solutions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.data.boards.adjustment import Pose, chained, inverse
from estimator.data.boards.lens import BoardPose, LensFit

_TURN = 10.0  # degrees between two placements at which one supports the other half as much
_SHIFT = 0.2  # of the board's distance, the same
_CLEAR = 100.0  # twice the difference of log-likelihoods from which one solution of a view alone is taken
_LEAST_NOISE = 0.1  # px
_LEAST_SUPPORT = 0.3  # of the best placement's, of others that are looked into
_MOST = 4  # placements of a pair


def candidates(fit: LensFit, corners: int) -> dict[int, list[BoardPose]]:
    """The poses of the board by frame without those that the view alone rules out; corners: of the board."""
    noise = max(_LEAST_NOISE, fit.rms) / np.sqrt(2.0)
    worse = _CLEAR * noise**2 / corners
    return {frame: [p for p in poses if p.error**2 - poses[0].error ** 2 < worse] for frame, poses in fit.poses.items()}


def placements(a: Mapping[int, list[BoardPose]], b: Mapping[int, list[BoardPose]]) -> list[tuple[Pose, float]]:
    """Camera a from camera b, and how many frames support it: the most supported first, then others that differ.

    a, b: candidate poses of the board by frame. Each combination of them in a frame makes a placement; a frame supports
    a placement by that of its own which is nearest, from 1 where it is equal down to 0. Empty without a common frame.
    """
    common = sorted(set(a) & set(b))
    made = [(i, chained(in_a[:2], inverse(in_b[:2]))) for i, f in enumerate(common) for in_a in a[f] for in_b in b[f]]
    if not made:
        return []
    frame, R = np.array([i for i, _ in made]), np.stack([pose[0] for _, pose in made])
    t = np.stack([pose[1] for _, pose in made])
    far = np.median([np.linalg.norm(pose.t) for side in (a, b) for f in common for pose in side[f]])
    cosine = 0.5 * (np.einsum("iab,jab->ij", R, R) - 1.0)
    turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    apart = (turn / _TURN) ** 2 + (np.linalg.norm(t[:, None] - t, axis=2) / (_SHIFT * far)) ** 2
    nearness = 1.0 / (1.0 + apart)
    first = np.flatnonzero(np.diff(frame, prepend=-1))
    support = np.maximum.reduceat(nearness, first, axis=1).sum(axis=1)
    results: list[tuple[Pose, float]] = []
    open_ = np.ones(len(made), bool)
    while open_.any() and len(results) < _MOST:
        best = int(np.argmax(np.where(open_, support, -1.0)))
        if results and support[best] < _LEAST_SUPPORT * results[0][1]:
            break
        near = np.where(apart[best] < 4.0, nearness[best], 0.0)
        mean = Rotation.from_matrix(R).mean(weights=near).as_matrix()
        results.append(((mean, near @ t / near.sum()), float(support[best])))
        open_ &= apart[best] > 1.0
    return results
