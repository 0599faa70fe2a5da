"""Single points followed from one frame to the next, more exactly than the dense flow does."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from estimator.vision.cues.flow.flow_field import FlowField

WINDOW = (11, 11)  # px, about a forearm
STRAY = 8.0  # px; a refined point this far from where the field led it has found something else
ELSEWHERE = 1.0  # px
DOUBTFUL = 0.8  # sureness below which a second try is worth its time: it came back half a pixel off


def follow_points(
    flow: FlowField, pixels: np.ndarray, guess: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) in this frame of points of the previous one, pixels (N, 2), and their confidence (N,), 0 to 1.

    The dense field is the start. Lucas and Kanade's iteration (pyramidal, Bouguet 2000) refines each point, forwards
    and backwards: the field is smooth over several pixels, and thin limbs need better. A `guess` (N, 2) starts a second
    try for points that the first one leaves in doubt or has found elsewhere; the one that returns nearer to its start
    is used. Points of one pixel move alike, so each pixel is computed once, however many points there are. Where the
    two images do not differ nothing moves, with full confidence.
    """
    points = np.clip(pixels, 0.0, np.array(flow.size) - 1.0)
    height, width = flow.outlier.shape
    here = points - flow.corner
    cell = np.floor(here + 0.5).astype(np.int64)
    inside = np.flatnonzero(((cell >= 0) & (cell < [width, height])).all(axis=1))
    moved, sure = np.zeros(points.shape), np.ones(len(points))
    expected = None if guess is None else (guess - flow.corner)[inside]
    moved[inside], sure[inside] = _moved(flow, here[inside], cell[inside], expected)
    return points + moved, sure


def _moved(
    flow: FlowField, points: np.ndarray, cell: np.ndarray, guess: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (N, 2) of points (N, 2) of the maps, in pixels `cell` (N, 2), and their confidence (N,)."""
    if not len(points):
        return np.zeros((0, 2)), np.zeros(0)
    width = flow.outlier.shape[1]
    _, first, of = np.unique(cell[:, 1] * width + cell[:, 0], return_index=True, return_inverse=True)
    moved, sure, cells = _followed_pixels(flow, cell[first].astype(np.float32))
    moved, sure = moved[of], sure[of]
    if guess is not None:
        elsewhere = np.square(guess - points - moved).sum(axis=1) > ELSEWHERE**2  # never where the guess is NaN
        again = np.flatnonzero(elsewhere | ((sure < DOUBTFUL) & np.isfinite(guess).all(axis=1)))
        if len(again):
            here = cells[of[again]]
            other, other_sure = _refined(flow, here, (here + guess[again] - points[again]).astype(np.float32))
            better = other_sure > sure[again]
            moved[again[better]], sure[again[better]] = (other - here)[better], other_sure[better]
    return moved, sure


def _followed_pixels(flow: FlowField, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements (N, 2) of the pixels (N, 2), near those of the dense field; their confidence (N,); the pixels."""
    x, y = cells.astype(np.int64).T
    predicted = cells + flow.flow[y, x]
    places, sure = _refined(flow, cells, predicted)
    lost = sure <= 0.0
    places[lost], sure[lost] = predicted[lost], 0.5 * (1.0 - flow.outlier[y, x][lost])
    return places - cells, sure, cells


def _refined(flow: FlowField, points: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Refined places (N, 2) of points that flow moves to `guess`, and their confidence (N,), zero where lost."""
    places, there = _tracked(flow.before, flow.now, points, guess)
    back, again = _tracked(flow.now, flow.before, places, points)
    missed = np.square(back - points).sum(axis=1)
    kept = there & again & (np.square(places - guess).sum(axis=1) < STRAY**2)
    return places, np.where(kept, 1.0 / (1.0 + missed), 0.0)


def _tracked(
    before: np.ndarray, now: np.ndarray, points: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) of points and whether each was found, (N,) bool."""
    with one_thread():
        places, status, _ = cv2.calcOpticalFlowPyrLK(
            before, now, points, guess.copy(), winSize=WINDOW, maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
    return np.asarray(places), np.asarray(status)[:, 0] > 0
