"""Keypoints as a detector would give them: noisy, now and then wrong, now and then missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import COCO17, landmark_spread

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
    """Keypoints along q (T, nq), one track for each camera: COCO's 17, or all landmarks of a body that lacks some.

    noise_px: standard deviation of each coordinate, averaged over the keypoints; it is greater at the hips than at
        the eyes, as COCO's annotators are, and correlated from frame to frame.
    outlier_fraction: share of the keypoints that are 25 to 80 px off, with little less confidence.
    missing_fraction: share that is missing, beside those outside the image.
    """
    whole = all(name in body.landmark_names for name in COCO17)
    names, layout = (COCO17, "coco17") if whole else (body.landmark_names, "landmarks")
    points = _landmarks(body, q, names)
    noise = noise_px, outlier_fraction, missing_fraction
    return [of_points(names, layout, points, camera, rng, noise, fps) for camera in cameras]


def of_points(
    names: tuple[str, ...],
    layout: str,
    points: np.ndarray,
    camera: Camera,
    rng: np.random.Generator,
    noise: tuple[float, float, float],
    fps: float,
) -> KeypointTrack:
    """Keypoints of points (T, J, 3) [m] of some names in one camera; noise: `noise_px`, `outlier_fraction` and
    `missing_fraction` of `keypoints`."""
    noise_px, outlier_fraction, missing_fraction = noise
    exact = camera.project(points)
    spread = landmark_spread(names)
    sigma = noise_px * spread / spread.mean()
    scatter = _correlated(rng, exact.shape) * sigma[:, None]
    outlier = rng.random(exact.shape[:2]) < outlier_fraction
    angle, length = rng.uniform(0.0, 2.0 * np.pi, exact.shape[:2]), rng.uniform(*_OUTLIER_PIXELS, exact.shape[:2])
    jump = (length * np.stack([np.cos(angle), np.sin(angle)])).transpose(1, 2, 0)
    pixels = exact + scatter + np.where(outlier[..., None], jump, 0.0)
    confidence = np.clip(rng.normal(0.88, 0.05, outlier.shape) - 0.25 * outlier, 0.3, 0.99)
    lost = ~_inside(pixels, camera) | (rng.random(outlier.shape) < missing_fraction)
    return KeypointTrack(
        layout=layout,
        names=names,
        pixels=np.where(lost[..., None], np.nan, pixels),
        confidence=np.where(lost, 0.0, confidence),
        image_size=camera.image_size,
        fps=fps,
        source=camera.name,
    )


def first_frame(body: Body, q: np.ndarray, cameras: Sequence[Camera], fps: float = 30.0) -> list[KeypointTrack]:
    """Exact places of all landmarks in the first frame of q (T, nq), and in no other, one track for each camera.

    That is what a person clicks who starts a tracker by hand (CSS section 5). Landmarks outside the image are missing.
    """
    points = _landmarks(body, q[:1], body.landmark_names)
    tracks = []
    for camera in cameras:
        pixels = np.full((len(q), points.shape[1], 2), np.nan)
        pixels[0] = camera.project(points[0])
        pixels[~_inside(pixels, camera)] = np.nan
        confidence = np.isfinite(pixels).all(axis=-1).astype(float)
        tracks.append(
            KeypointTrack(
                "landmarks", body.landmark_names, pixels, confidence, camera.image_size, fps, source=camera.name
            )
        )
    return tracks


def without(track: KeypointTrack, hidden: np.ndarray) -> KeypointTrack:
    """A track without the keypoints of the frames in which the person is hidden, (T,) bool."""
    pixels, confidence = track.pixels.copy(), track.confidence.copy()
    pixels[hidden], confidence[hidden] = np.nan, 0.0
    return replace(track, pixels=pixels, confidence=confidence)


def _landmarks(body: Body, q: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """World places (T, J, 3) [m] of some landmarks."""
    order = [body.landmark_names.index(name) for name in names]
    return np.array([body.landmarks(body.at(pose))[order] for pose in q])


def _inside(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """Which pixels (..., 2) are in the picture; none that is NaN."""
    inside = (pixels > -0.5).all(axis=-1) & (pixels < np.array(camera.image_size) - 0.5).all(axis=-1)
    return np.asarray(inside)


def _correlated(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Unit normal noise (T, ...) with an exponential correlation along time (a first-order autoregression)."""
    noise = rng.normal(size=shape)
    for t in range(1, shape[0]):
        noise[t] = _CORRELATION * noise[t - 1] + np.sqrt(1.0 - _CORRELATION**2) * noise[t]
    return noise
