"""Where a person stands of whom only the silhouette is known: at the distance given by their height."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread

LEAST_SHARE = 0.2  # of the picture's height; a smaller silhouette may be a part, such as an arm that alone has moved
_HEAD = 0.06  # of the height, to either side of the middle: where the head is, and no raised arm
_FEET = 0.04  # of the height: part that depth cues count as floor
_FRONT = 0.06  # of the height: by how much what is seen of a trunk is nearer than its middle
_MOST = 4000  # pixels that are placed


@one_thread()
def largest_part(mask: np.ndarray) -> np.ndarray:
    """The largest connected part of a mask (H, W) bool, itself a mask; all False where that is none."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return np.zeros_like(mask)
    return np.asarray(label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def standing_places(mask: np.ndarray, camera: Camera, up: np.ndarray, stature: float) -> np.ndarray | None:
    """Places (N, 3) in the world [m] of the surface of somebody who stands, without the feet, as depth would have them:
    on an upright plane that faces the camera, at the distance at which they are as tall as they are known to be.

    mask (H, W) bool: of one person, in the camera's picture. up (3,): of the world, which the camera's place has to be
    known in. stature [m]: from the soles to the top of the head. The top is looked for above the middle of the person,
    so that raised arms do not count; a person who bends or sits is taken for one who is farther away.

    None where their height is not seen: head or feet leave the picture, or too little of them is there.
    """
    rows, columns = np.nonzero(mask)
    if not len(rows) or np.ptp(rows) < LEAST_SHARE * len(mask):
        return None
    step = max(1, len(rows) // _MOST)
    pixels = np.stack([columns, rows], axis=1)
    rays = camera.directions(pixels.astype(float)) @ camera.R_camera_world
    forward = np.median(rays, axis=0)
    forward = forward - (forward @ up) * up
    length = float(np.linalg.norm(forward))
    if length < 0.2 * float(np.linalg.norm(np.median(rays, axis=0))):  # seen from above or below: no height to see
        return None
    forward = forward / length
    ahead = rays @ forward
    if ahead.min() <= 0.0:
        return None
    height, beside = (rays @ axis / ahead for axis in (up, np.cross(up, forward)))
    low = float(height.min())
    middle = np.abs(beside - np.median(beside)) < _HEAD * (float(height.max()) - low)
    top = float(height[middle].max())
    ends = (height == low) | (middle & (height == top))
    if np.any(_on_border(pixels[ends], mask.shape)):
        return None
    distance = stature / (top - low)
    seen = np.flatnonzero(height > low + _FEET * (top - low))[::step]
    at = distance - _FRONT * stature
    return np.asarray(camera.centre_world + rays[seen] * (at / ahead[seen])[:, None])


def _on_border(pixels: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Which of some pixels (N, 2) lie on the upper or lower border of a picture of some (height, width)."""
    return np.asarray((pixels[:, 1] <= 0) | (pixels[:, 1] >= shape[0] - 1))
