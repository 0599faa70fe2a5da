"""Single points carried from one frame to the next, more exactly than the dense flow does."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.imaging.flow import FlowField
from estimator.imaging.threads import one_thread

WINDOW = (11, 11)  # px, about a forearm
STRAY = 8.0  # px; a refined point this far from where the field led it has found something else


def follow_points(
    flow: FlowField, pixels: np.ndarray, guess: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Where points of the previous frame, pixels (N, 2), are in this one, (N, 2), and how sure that is, (N,) 0 to 1.

    The dense field leads; Lucas and Kanade's iteration (pyramidal, Bouguet 2000) refines each point, there and back:
    the field is smooth over several pixels, and thin limbs need better. A `guess` (N, 2) leads a second try; whichever
    comes back nearer to where it started is taken.
    """
    height, width = flow.outlier.shape
    points = np.clip(pixels, 0.0, [width - 1.0, height - 1.0]).astype(np.float32)
    x, y = points[:, :1].copy(), points[:, 1:].copy()
    led = points + cv2.remap(flow.flow, x, y, cv2.INTER_LINEAR)[:, 0]
    found, sure = _refined(flow, points, led)
    doubt = cv2.remap(flow.outlier, x, y, cv2.INTER_LINEAR)[:, 0]
    lost = sure <= 0.0
    found[lost], sure[lost] = led[lost], 0.5 * (1.0 - doubt[lost])
    if guess is not None:
        start = np.where(np.isfinite(guess), guess, points).astype(np.float32)
        other, other_sure = _refined(flow, points, start)
        better = other_sure > sure
        found[better], sure[better] = other[better], other_sure[better]
    return found.astype(np.float64), sure.astype(np.float64)


def _refined(flow: FlowField, points: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Refined places (N, 2) of points led to `guess`, and how sure each is, (N,), zero where it was lost."""
    found, there = _tracked(flow.before, flow.now, points, guess)
    back, again = _tracked(flow.now, flow.before, found, points)
    missed = np.square(back - points).sum(axis=1)
    kept = there & again & (np.square(found - guess).sum(axis=1) < STRAY**2)
    return found, np.where(kept, 1.0 / (1.0 + missed), 0.0)


def _tracked(
    before: np.ndarray, now: np.ndarray, points: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) of points and whether each was found, (N,) bool."""
    with one_thread():
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            before, now, points, guess.copy(), winSize=WINDOW, maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
    return np.asarray(found), np.asarray(status)[:, 0] > 0
