"""Keypoints as a detector would give them: noisy, now and then wrong, now and then missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.formats.keypoints import KeypointTrack
from estimator.imaging.camera import Camera
from humanoid.body import Body
from humanoid.errors import InputError
from humanoid.landmarks import COCO17, landmark_spread

_CORRELATION = 0.6  # of the noise from frame to frame
_OUTLIER_PIXELS = (25.0, 80.0)


def keypoints(
    body: Body,
    q: np.ndarray,
    cameras: Sequence[Camera],
    rng: np.random.Generator,
    *,
    noise_px: float = 2.5,
    outlier_fraction: float = 0.01,
    missing_fraction: float = 0.02,
    fps: float = 30.0,
) -> list[KeypointTrack]:
    """COCO keypoints of the body's landmarks along q (T, nq), one track for each camera.

    noise_px: standard deviation of each coordinate, averaged over the keypoints; it is greater at the hips than at
        the eyes, as COCO's annotators are, and correlated from frame to frame.
    outlier_fraction: share of the keypoints that are 25 to 80 px off, with little less confidence.
    missing_fraction: share that is missing, beside those outside the image.

    Raises
    ------
    InputError: the body lacks one of COCO's 17 landmarks.
    """
    missing = [name for name in COCO17 if name not in body.landmark_names]
    if missing:
        raise InputError(body.subject.source, f"has no landmark {', '.join(missing)}", remedy="COCO has 17")
    order = [body.landmark_names.index(name) for name in COCO17]
    points = np.array([body.landmarks(body.at(one))[order] for one in q])
    return [_track(points, camera, rng, noise_px, outlier_fraction, missing_fraction, fps) for camera in cameras]


def _track(
    points: np.ndarray,
    camera: Camera,
    rng: np.random.Generator,
    noise_px: float,
    outlier_fraction: float,
    missing_fraction: float,
    fps: float,
) -> KeypointTrack:
    exact = camera.project(points)
    spread = landmark_spread(COCO17)
    sigma = noise_px * spread / spread.mean()
    noise = _correlated(rng, exact.shape) * sigma[:, None]
    outlier = rng.random(exact.shape[:2]) < outlier_fraction
    angle, length = rng.uniform(0.0, 2.0 * np.pi, exact.shape[:2]), rng.uniform(*_OUTLIER_PIXELS, exact.shape[:2])
    jump = (length * np.stack([np.cos(angle), np.sin(angle)])).transpose(1, 2, 0)
    pixels = exact + noise + np.where(outlier[..., None], jump, 0.0)
    confidence = np.clip(rng.normal(0.88, 0.05, outlier.shape) - 0.25 * outlier, 0.3, 0.99)
    inside = (pixels > -0.5).all(axis=-1) & (pixels < np.array(camera.image_size) - 0.5).all(axis=-1)
    lost = ~inside | (rng.random(outlier.shape) < missing_fraction)
    return KeypointTrack(
        layout="coco17",
        names=COCO17,
        pixels=np.where(lost[..., None], np.nan, pixels),
        confidence=np.where(lost, 0.0, confidence),
        image_size=camera.image_size,
        fps=fps,
        source=camera.name,
    )


def _correlated(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Unit normal noise (T, ...) with an exponential correlation along time (a first-order autoregression)."""
    noise = rng.normal(size=shape)
    for t in range(1, shape[0]):
        noise[t] = _CORRELATION * noise[t - 1] + np.sqrt(1.0 - _CORRELATION**2) * noise[t]
    return noise
