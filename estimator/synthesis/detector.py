"""Keypoints as a detector would give them, of one person or several: noisy, now and then wrong, now and then
missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.formats.keypoints_reading import Person
from estimator.synthesis.settings import DetectorSettings
from humanoid.kinematics.body import ROOT_Q, Body
from humanoid.subject.landmarks import COCO17, relative_spread, without_side

_OUTLIER_PIXELS = (25.0, 80.0)


def keypoints(
    body: Body,
    q: np.ndarray,
    cameras: Sequence[Camera],
    rng: np.random.Generator,
    errors: DetectorSettings | None = None,
    *,
    fps: float = 30.0,
) -> list[KeypointTrack]:
    """Keypoints along q (T, nq), one track for each camera: COCO's 17, or all landmarks of a body that lacks some.

    errors: of the detector. A point's bias [m] is drawn once, in the frame of the link that carries it, half of it
    mirrored on the other side's point; it is the same in all frames and cameras.
    """
    errors = errors or DetectorSettings()
    whole = all(name in body.landmark_names for name in COCO17)
    names, layout = (COCO17, "coco17") if whole else (body.landmark_names, "landmarks")
    points = _landmarks(body, q, names)
    if errors.bias:
        points = points + _turned(body, q, names, errors.bias * _biases(rng, names))
    return [of_points(names, layout, points, camera, rng, errors, fps) for camera in cameras]


def of_points(
    names: tuple[str, ...],
    layout: str,
    points: np.ndarray,
    camera: Camera,
    rng: np.random.Generator,
    errors: DetectorSettings,
    fps: float,
) -> KeypointTrack:
    """Keypoints of points (T, J, 3) [m] of some names in one camera, with errors about them; they have no bias."""
    exact = camera.project(points)
    scatter = correlated_noise(rng, exact.shape, errors.persistence(fps))
    if errors.reach:
        scatter = np.einsum("ij,tjx->tix", _alike(points, errors.reach), scatter)
    scatter *= errors.noise_px * relative_spread(names)[:, None]
    outlier = rng.random(exact.shape[:2]) < errors.outlier_fraction
    angle, length = rng.uniform(0.0, 2.0 * np.pi, exact.shape[:2]), rng.uniform(*_OUTLIER_PIXELS, exact.shape[:2])
    jump = (length * np.stack([np.cos(angle), np.sin(angle)])).transpose(1, 2, 0)
    pixels = exact + scatter + np.where(outlier[..., None], jump, 0.0)
    confidence = np.clip(rng.normal(0.88, 0.05, outlier.shape) - 0.25 * outlier, 0.3, 0.99)
    lost = ~_inside(pixels, camera) | (rng.random(outlier.shape) < errors.missing_fraction)
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

    These are what a person clicks to start a tracker by hand (CSS section 5). Landmarks outside the image are missing.
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


def correlated_noise(rng: np.random.Generator, shape: tuple[int, ...], persistence: float) -> np.ndarray:
    """Unit normal noise (T, ...) with such a correlation from frame to frame (a first-order autoregression)."""
    noise = rng.normal(size=shape)
    for t in range(1, shape[0]):
        noise[t] = persistence * noise[t - 1] + np.sqrt(1.0 - persistence**2) * noise[t]
    return noise


def _alike(points: np.ndarray, reach: float) -> np.ndarray:
    """Factor (J, J) that correlates unit noise between points (T, J, 3) [m] by how near they are in the first frame."""
    apart = np.linalg.norm(points[0, :, None] - points[0, None], axis=-1)
    values, vectors = np.linalg.eigh(np.exp(-apart / reach))  # points may coincide
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


def _biases(rng: np.random.Generator, names: Sequence[str]) -> np.ndarray:
    """Biases (J, 3) of points in their links' frames, where y points to the left; with a mean deviation of 1."""
    base = [without_side(name) for name in names]
    shared = {part: rng.normal(size=3) for part in dict.fromkeys(base)}
    own = rng.normal(size=(len(names), 3))
    mirrored = [
        shared[part] * (1.0, -1.0 if name.startswith("right_") else 1.0, 1.0)
        for part, name in zip(base, names, strict=True)
    ]
    return np.asarray(np.sqrt(0.5) * (own + mirrored) * relative_spread(names)[:, None])


def _turned(body: Body, q: np.ndarray, names: Sequence[str], offsets: np.ndarray) -> np.ndarray:
    """Offsets (J, 3) in the frames of the links that carry the landmarks, turned into the world: (T, J, 3)."""
    joints = body.landmark_joint[[body.landmark_names.index(name) for name in names]]
    return np.array([np.einsum("jab,jb->ja", body.at(pose).rotations[joints], offsets) for pose in q])


def placed(q: np.ndarray, place: np.ndarray, turn: float) -> np.ndarray:
    """A free body's motion q (T, nq) turned by `turn` [rad] about the vertical z axis and moved to `place`, x and y
    [m], one (2,) for all frames or one (T, 2) for each."""
    moved = q.copy()
    path = np.broadcast_to(place, (len(q), 2))
    R = pin.rpy.rpyToMatrix(0.0, 0.0, turn)
    for t, pose in enumerate(q):
        T_world_motion = pin.SE3(R, np.append(path[t], 0.0))
        moved[t, ROOT_Q] = pin.SE3ToXYZQUAT(T_world_motion * pin.XYZQUATToSE3(pose[ROOT_Q]))
    return moved


def crowd(
    body: Body,
    people: Sequence[np.ndarray],
    cameras: Sequence[Camera],
    rng: np.random.Generator,
    *,
    noise_px: float = 2.5,
    hidden: Mapping[str, Sequence[int]] | None = None,
) -> dict[str, list[list[tuple[int, Person]]]]:
    """People detected in each frame of each camera, in random order: by camera name T lists of (number, detection).

    people (N): configurations (T, nq) of each. hidden: numbers of the people a camera does not see at all. Noise,
    outliers and missing points are those of `detector.keypoints`; a person without a point in the image is not
    detected.
    """
    detections: dict[str, list[list[tuple[int, Person]]]] = {c.name: [[] for _ in people[0]] for c in cameras}
    for number, q in enumerate(people):
        for track in keypoints(body, q, cameras, rng, DetectorSettings(noise_px)):
            if number in (hidden or {}).get(track.source, ()):
                continue
            points = np.concatenate([track.pixels, track.confidence[..., None]], axis=-1)
            for t in np.flatnonzero((track.confidence > 0.0).sum(axis=1) > 1).tolist():
                detections[track.source][t].append((number, Person(points[t])))
    for frames in detections.values():
        for t, frame in enumerate(frames):
            frames[t] = [frame[k] for k in rng.permutation(len(frame))]
    return detections
