"""Where the cameras of rendered clips stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.synthesis.settings import ViewSettings

_SIZE = (640, 480)
_DISTANCE, _HEIGHT, _AIM = 3.5, 1.35, 0.98  # of the demo's cameras from the middle of the room, where they look [m]
_AZIMUTHS = {"front_left": 42.0, "front_right": -38.0}  # [deg], seen from above, 0 in front of the person
_FOCAL = 660.0
_DISTORTION = (-0.09, 0.04, 0.0008, -0.0005, 0.0)
_MARGIN = 0.05  # share of the picture's sides that stays free of the person
_STEP = 80.0  # [deg] between neighbouring cameras, less where they are many
_THREE_QUARTER = 35.0  # [deg] default azimuth of the first camera
_NEAREST, _FARTHEST = 0.5, 60.0  # [m]
_SMALLEST = 0.01  # [m] that a parallel camera shows across its picture


def scene_cameras() -> tuple[Camera, ...]:
    """Two cameras 3.5 m from the origin and 80 degrees apart, 640 x 480, with a little lens distortion."""
    aim = np.array([0.0, 0.0, _AIM])
    elevation = np.arcsin((_HEIGHT - _AIM) / _DISTANCE)
    return tuple(
        _camera(name, _SIZE, aim, _DISTANCE, np.radians(azimuth), elevation) for name, azimuth in _AZIMUTHS.items()
    )


def framing_cameras(points: np.ndarray, settings: ViewSettings | None = None) -> tuple[Camera, ...]:
    """Cameras "cam01", ... that see all of the points (T, N, 3) [m] at all times, world z up.

    They face the middle of the points from a distance at which the tallest picture of one instant takes up
    `settings.fill` of the height, or farther where the points would else come too near to the picture's border.
    Neighbouring cameras are 80 degrees apart, less where more than four share the circle. Where `settings.baseline` is
    not zero each is followed by "cam01_right", ..., the other one of a stereo pair. With `settings.parallel` they are
    parallel cameras, whose planes are where the others would stand, at the scale that makes as large a picture.
    """
    settings = settings or ViewSettings()
    flat = points.reshape(-1, 3)
    aim = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    first = _THREE_QUARTER if settings.azimuth is None else settings.azimuth
    step = min(_STEP, 360.0 / settings.count)
    cameras = []
    for i in range(settings.count):
        azimuth, elevation = np.radians(first + i * step), np.radians(settings.elevation)
        near, far = _NEAREST, _FARTHEST
        while far - near > 1e-3:
            middle = 0.5 * (near + far)
            placed = _with_pair(_camera("", settings.image_size, aim, middle, azimuth, elevation), settings.baseline)
            near, far = (near, middle) if all(_fits(c, points, settings.fill) for c in placed) else (middle, far)
        camera = _camera(f"cam{i + 1:02d}", settings.image_size, aim, far, azimuth, elevation)
        camera = _parallel(camera, points, settings.fill) if settings.parallel else camera
        cameras += _with_pair(camera, settings.baseline)
    return tuple(cameras)


def _with_pair(camera: Camera, baseline: float) -> list[Camera]:
    """A camera and, unless the baseline [m] is zero, the one beside it that makes a stereo pair with it."""
    if baseline == 0.0:
        return [camera]
    beside = camera.t_camera_world - np.array([baseline, 0.0, 0.0])
    return [camera, replace(camera, name=f"{camera.name}_right", t_camera_world=beside)]


def _parallel(camera: Camera, points: np.ndarray, fill: float) -> Camera:
    """The parallel camera along the same axis that shows points (T, N, 3) [m] as large as `_fits` allows."""

    def scaled(scale: float) -> Camera:
        K = camera.K.copy()
        K[0, 0] = K[1, 1] = scale
        return replace(camera, K=K, distortion=np.zeros(5), parallel=True)

    low, high = 1.0, float(max(camera.image_size)) / _SMALLEST
    while high > (1.0 + 1e-6) * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if _fits(scaled(middle), points, fill) else (low, middle)
    return scaled(low)


def _fits(camera: Camera, points: np.ndarray, fill: float) -> bool:
    depth = camera.depths(points)
    if depth.min() < _NEAREST:
        return False
    pixels, size = camera.project(points), np.array(camera.image_size, dtype=float)
    inside = (pixels > _MARGIN * size).all() and (pixels < (1.0 - _MARGIN) * size).all()
    height = np.ptp(pixels[..., 1], axis=1).max()
    return bool(inside and height <= fill * size[1])


def _camera(
    name: str, size: tuple[int, int], aim: np.ndarray, distance: float, azimuth: float, elevation: float
) -> Camera:
    away = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    away[2] = np.sin(elevation)
    forward, centre = -away, aim + distance * away
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R_camera_world = np.stack([right, np.cross(forward, right), forward])
    focal = _FOCAL * max(size[0] / _SIZE[0], size[1] / _SIZE[1])
    K = np.array([[focal, 0.0, size[0] / 2 - 3.5], [0.0, focal, size[1] / 2 + 2.5], [0.0, 0.0, 1.0]])
    return Camera(name, size, K, np.array(_DISTORTION), R_camera_world, -R_camera_world @ centre)
