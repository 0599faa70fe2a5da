"""Whether the axes of a file are mirrored: left-handed, or with a sign lost."""

from __future__ import annotations

import numpy as np

_FEWEST = 4  # points of a frame; three lie in a plane, which a mirror maps to itself
_FRAMES = 200  # that are checked, spread over the file
_BETTER = 0.7  # residual of the mirrored fit over that of the other, from which on it counts


def mirrored(model_points: np.ndarray, points: np.ndarray) -> bool:
    """Whether points (T, M, 3) fit a model (M, 3) [m] clearly better mirrored than turned, in most frames.

    Of points of one rigid link, or of pelvis and trunk, which differ from front to back: of a flat arrangement both fit
    alike, and the answer is no. Missing points are NaN (S. Umeyama, IEEE PAMI 13(4), 1991, with scale).
    """
    answers = []
    for frame in points[:: max(1, len(points) // _FRAMES)]:
        seen = np.isfinite(frame).all(axis=1)
        if seen.sum() < _FEWEST:
            continue
        a, b = model_points[seen], frame[seen]
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        turn, values, turn_back = np.linalg.svd(b.T @ a)
        sign = np.sign(np.linalg.det(turn @ turn_back))
        size = max(float((a**2).sum() * (b**2).sum()), 1e-30)
        proper, improper = (
            1.0 - (values[0] + values[1] + which * values[2]) ** 2 / size for which in (sign, -sign)
        )  # of the squared distances, as a share
        answers.append(improper < _BETTER**2 * proper)
    return bool(len(answers) and np.mean(answers) > 0.5)
