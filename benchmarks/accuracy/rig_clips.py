"""Captured people before rigs of cameras that are drawn at random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.support.pose_prior_clips import subject_of
from benchmarks.training.calibration_clips import LASTING, person
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.formats.keypoints import KeypointTrack
from estimator.synthesis import detector
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import DetectorSettings
from humanoid.kinematics.body import Body

FPS = 30.0
SECONDS = 20.0
_SIZES = ((1920, 1080), (1080, 1920))
_FOCAL = (0.67, 0.91)  # of the longer side, as phones' lenses have it
_ELEVATION, _ROLL, _APART = (-3.0, 20.0), 5.0, (20.0, 160.0)  # degrees
_MARGIN = 0.04  # of the picture's sides
_NEAREST, _FARTHEST, _SPREAD = 1.0, 30.0, 1.3  # m; up to how much farther than it has to be a camera stands
_NOISE = 0.008  # of the person's height in the picture, as on beam4cam
_SWAY, _SWAYING = 0.01, 0.5  # rad and m of who stands; s in which it forgets itself


@dataclass(frozen=True)
class RigClip:
    """cameras: the true ones. tracks: keypoints of each. q (T, nq), body: the person. late (C,) [s]: how much later
    each camera's clock began."""

    name: str
    cameras: tuple[Camera, ...]
    tracks: tuple[KeypointTrack, ...]
    body: Body
    q: np.ndarray
    late: np.ndarray

    @property
    def points(self) -> np.ndarray:
        """Landmarks of the person (T, N, 3) [m]."""
        return self.body.landmarks_of(self.body.placed(self.q))

    def begun_later(self, lags: np.ndarray) -> RigClip:
        """The clip with cameras that start so many frames (C,) int later, or earlier."""
        left_out = (lags - lags.min()).tolist()
        tracks = tuple(_without_first(track, n) for track, n in zip(self.tracks, left_out, strict=True))
        return replace(self, tracks=tracks, late=self.late + lags / FPS)


def drawn_rig(files: Sequence[Path], seed: int, *, seconds: float = SECONDS, late: float = 0.0) -> RigClip:
    """Two to four cameras around a captured person, by seed, with other lengths each: trials of one person of the
    files, one after the other, any first, until they last so many seconds. Neighbouring cameras are 20 to 160 degrees
    apart. late [s]: clocks are off by at most so much."""
    rng = np.random.default_rng((seed, 37))
    name, body, q = _person_of(files, seed, seconds, rng)
    return _filmed(name, body, q, 2 + seed % 3, late, rng)


def drawn_standing_rig(files: Sequence[Path], seed: int, *, seconds: float, late: float) -> RigClip:
    """Two or three such cameras, by seed, before somebody who first stands, for up to as long as they move then. Clocks
    are off by at most so much [s], and by so little that two clips have a tenth of the whole in common."""
    rng = np.random.default_rng((seed, 53))
    name, body, q = _person_of(files, seed, seconds, rng)
    count = int(rng.uniform(0.0, len(q)))
    sway = gaussian_filter1d(rng.normal(size=(count + 1, body.nv)), FPS * _SWAYING, axis=0)
    sway *= _SWAY * np.sqrt(np.linspace(1.0, 0.0, count + 1))[:, None] / max(float(sway.std()), 1e-12)
    q = np.concatenate([[body.integrate(q[0], step) for step in sway], q])
    return _filmed(f"{name}, stands {count / FPS:.1f} s", body, q, 2 + seed % 2, min(late, 0.45 * len(q) / FPS), rng)


def _person_of(
    files: Sequence[Path], seed: int, seconds: float, rng: np.random.Generator
) -> tuple[str, Body, np.ndarray]:
    """A name for a captured person, the body, and poses (T, nq)."""
    who = sorted({subject_of(file.stem) for file in files})
    own = [file for file in files if subject_of(file.stem) == who[seed % len(who)]]
    body = Body(person(rng))
    return f"person {who[seed % len(who)]}", body, _motion(body, [own[i] for i in rng.permutation(len(own))], seconds)


def _filmed(name: str, body: Body, q: np.ndarray, count: int, late: float, rng: np.random.Generator) -> RigClip:
    """The motion q (T, nq) before so many cameras."""
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    azimuths = _azimuths(count, rng)
    cameras = tuple(_camera(f"cam{i + 1}", points, a, rng) for i, a in enumerate(azimuths))
    errors = detector_errors(cameras, points)
    lags = np.concatenate([[0], np.round(FPS * rng.uniform(-late, late, count - 1)).astype(int)])
    tracks = tuple(detector.keypoints(body, q, cameras, rng, errors, fps=FPS))
    whole = f"{name}, {len(q) / FPS:.1f} s, {count} cameras"
    return RigClip(whole, cameras, tracks, body, q, np.zeros(count)).begun_later(lags)


def detector_errors(cameras: Sequence[Camera], points: np.ndarray) -> DetectorSettings:
    """Errors of a detector as exact as on beam4cam, relative to the size at which points (T, N, 3) [m] are seen."""
    tall = np.mean([np.median(np.ptp(camera.project(points)[..., 1], axis=1)) for camera in cameras])
    return DetectorSettings(_NOISE * float(tall), 0.01, 0.02, **LASTING)


def _motion(body: Body, files: Sequence[Path], seconds: float) -> np.ndarray:
    """(T, nq) of captured trials one after the other, at most so many seconds of them."""
    parts: list[np.ndarray] = []
    for file in files:
        left = round(FPS * seconds) - sum(map(len, parts))
        if left > 0:
            mocap = load_mocap(file)
            parts.append(retarget(body, mocap, np.arange(min(left, round(FPS * mocap.seconds))) / FPS).q)
    return np.concatenate(parts)


def _without_first(track: KeypointTrack, frames: int) -> KeypointTrack:
    """The track of a camera that starts so many frames later."""
    return replace(track, pixels=track.pixels[frames:], confidence=track.confidence[frames:])


def _azimuths(count: int, rng: np.random.Generator) -> np.ndarray:
    """Neighbours on the circle are 20 to 160 degrees apart, but for the last and the first."""
    return np.asarray(rng.uniform(0.0, 360.0) + np.cumsum([0.0, *rng.uniform(*_APART, count - 1)]))


def _camera(name: str, points: np.ndarray, azimuth: float, rng: np.random.Generator) -> Camera:
    """A camera that sees all points (T, N, 3) [m] from an azimuth [deg]."""
    lens = phone(name, rng)
    a, e = np.radians(azimuth), np.radians(rng.uniform(*_ELEVATION))
    away = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    base = turned(lens, away, rng)
    flat = points.reshape(-1, 3)
    aim = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    near, far = _NEAREST, _FARTHEST
    while far - near > 1e-2:
        middle = 0.5 * (near + far)
        near, far = (near, middle) if _inside(moved_to(base, aim + middle * away), points) else (middle, far)
    return moved_to(base, aim + far * rng.uniform(1.0, _SPREAD) * away)


def phone(name: str, rng: np.random.Generator) -> Camera:
    """A camera with a phone's lens, upright or on its side, that stands nowhere yet."""
    size = _SIZES[int(rng.integers(2))]
    return guessed_camera(name, size, focal=float(rng.uniform(*_FOCAL)))


def turned(camera: Camera, away: np.ndarray, rng: np.random.Generator) -> Camera:
    """The camera looking against a direction (3,) of length 1, nearly level."""
    right = np.cross(-away, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(-away, right), -away])
    roll = Rotation.from_euler("z", rng.normal(0.0, _ROLL), degrees=True).as_matrix()
    return replace(camera, R_camera_world=roll @ level)


def moved_to(camera: Camera, centre: np.ndarray) -> Camera:
    """The camera with its centre (3,) [m] there."""
    return replace(camera, t_camera_world=-camera.R_camera_world @ centre)


def _inside(camera: Camera, points: np.ndarray) -> bool:
    pixels, size = camera.project(points), np.array(camera.image_size, dtype=float)
    low, high = _MARGIN * size, (1.0 - _MARGIN) * size
    return bool(np.all(camera.depths(points) > 0.3) and np.all((pixels > low) & (pixels < high)))
