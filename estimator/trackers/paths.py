"""The most likely way through the hypotheses of all frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.trackers.frame_result import FrameResult


def backtrack(parent: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Index (T,) of the hypothesis each frame has on the path that ends in the best one of the last frame.

    Parameters
    ----------
    parent (T, K): index of each hypothesis' parent in the frame before, -1 if none: the path then continues from the
        best hypothesis of the frame before.
    weight (T, K): weights, NaN where there is no hypothesis.

    -1 for a frame without hypotheses. Source: Sminchisescu and Triggs 2003 (CSS), footnote 2, keeping one path.
    """
    count = len(parent)
    path = np.full(count, -1, dtype=np.int64)
    filled = np.where(np.isnan(weight), -np.inf, weight)
    wanted = -1
    for t in range(count - 1, -1, -1):
        some = filled.shape[1] > 0 and np.isfinite(filled[t]).any()
        if some and (wanted < 0 or not np.isfinite(filled[t, wanted])):
            wanted = int(np.argmax(filled[t]))
        path[t] = wanted if some else -1
        wanted = int(parent[t, wanted]) if some else -1
    return path


def backtrack_results(results: Sequence[FrameResult]) -> np.ndarray:
    """`backtrack` over a list of frame results, (T,)."""
    most = max((len(r.weight) for r in results), default=0)
    parent = np.full((len(results), most), -1, dtype=np.int64)
    weight = np.full((len(results), most), np.nan)
    for t, result in enumerate(results):
        parent[t, : len(result.parent)] = result.parent
        weight[t, : len(result.weight)] = result.weight
    return backtrack(parent, weight)
