"""Points followed from one picture to the next, forwards and backwards (Lucas and Kanade; pyramidal, Bouguet 2000)."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.data.media.threads import one_thread

WINDOW = (11, 11)  # px, about a forearm


def tracked_both_ways(
    before: np.ndarray, now: np.ndarray, points: np.ndarray, guess: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) float32 in one picture of points (N, 2) float32 of the one before, and by how much each misses its
    start when it is followed back, (N,) [px]; infinite where it was lost.

    before, now (H, W) uint8. guess (N, 2) float32: where the search starts. levels: of the pyramid, beside the picture
    itself; each doubles the reach.
    """
    places, there = tracked(before, now, points, guess, levels)
    back, again = tracked(now, before, places, points, levels)
    return places, np.where(there & again, np.linalg.norm(back - points, axis=1), np.inf)


def tracked(
    before: np.ndarray, now: np.ndarray, points: np.ndarray, guess: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) float32 of points, see `tracked_both_ways`, and whether each was found, (N,) bool."""
    if not len(points):
        return points, np.zeros(0, bool)
    with one_thread():
        places, status, _ = cv2.calcOpticalFlowPyrLK(
            before, now, points, guess.copy(), winSize=WINDOW, maxLevel=levels, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
    return np.asarray(places), np.asarray(status)[:, 0] > 0
