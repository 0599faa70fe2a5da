"""Camera files: intrinsics, Brown distortion and placement of each camera, as JSON.

    {"cameras": [{"name": "cam01", "image_size": [w, h], "K": 3 x 3, "distortion": [k1, k2, p1, p2, k3],
                  "R": 3 x 3, "t": [x, y, z]}, ...]}

x_camera = R x_world + t in metres; camera axes x right, y down, z forward; pixel centres at integer coordinates.
Taken are images of up to 16384 pixels a side, focal lengths of 1 to 1e6 pixels, coefficients up to 1e4.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from estimator.cameras.camera import Camera, guessed_camera
from estimator.formats.checked_json import mapping, member, numbers, read_json, sequence, shaped
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError

_TOLERANCE = 1e-3  # of R'R - 1: calibration tools print few digits
_MOST_PIXELS = 16384  # on a side of an image
_FOCAL = (1.0, 1e6)  # px
_COEFFICIENT = 1e4


def load_cameras(path: str | Path) -> dict[str, Camera]:
    """Cameras of a file by name, in its order.

    R and t may be left out where the file has a single camera, which then stands as a guessed one does.

    Raises
    ------
    InputError: naming the place, like `cameras[2].K`.
    """
    root = mapping(read_json(path), path)
    entries = sequence(member(root, "cameras", path, ""), path, "cameras")
    if not entries:
        raise InputError(path, "has no camera", place="cameras")
    cameras: dict[str, Camera] = {}
    for i, entry in enumerate(entries):
        place = f"cameras[{i}]"
        camera = camera_from_json(entry, path, place, alone=len(entries) == 1)
        if camera.name in cameras:
            raise InputError(path, f"the name {camera.name!r} is used twice", place=f"{place}.name")
        cameras[camera.name] = camera
    return cameras


def write_cameras(path: str | Path, cameras: Iterable[Camera]) -> None:
    """Write cameras so that `load_cameras` gives the same numbers back to the last bit."""
    with replacing(path) as temporary:
        text = json.dumps({"format": "pinhole_brown5", "cameras": [camera_to_json(c) for c in cameras]}, indent=1)
        temporary.write_text(text + "\n", encoding="utf-8")


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """One camera as the file has it."""
    return {
        "name": camera.name,
        "image_size": [int(n) for n in camera.image_size],
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
        "R": camera.R_camera_world.tolist(),
        "t": camera.t_camera_world.tolist(),
    }


def camera_from_json(value: Any, source: str | Path, place: str, *, alone: bool = False) -> Camera:
    """One camera of a file, checked; `alone` allows R and t to be missing."""
    entry = mapping(value, source, place)
    name = member(entry, "name", source, place)
    if not isinstance(name, str) or not name:
        raise InputError(source, "a name is needed", place=f"{place}.name")
    size = image_size(member(entry, "image_size", source, place), source, f"{place}.image_size")
    K = _intrinsics(member(entry, "K", source, place), source, f"{place}.K")
    distortion = _distortion(entry.get("distortion", [0.0] * 5), source, f"{place}.distortion")
    if alone and entry.get("R") is None and entry.get("t") is None:
        guess = guessed_camera(name, size)
        R, t = guess.R_camera_world, guess.t_camera_world
    else:
        R = _rotation(member(entry, "R", source, place), source, f"{place}.R")
        t = shaped(member(entry, "t", source, place), (3,), source, f"{place}.t")
    for array in (K, distortion, R, t):
        array.flags.writeable = False
    return Camera(name, size, K, distortion, R, t)


def image_size(value: Any, source: str | Path, place: str) -> tuple[int, int]:
    """Width and height [px] of a JSON pair."""
    size = shaped(value, (2,), source, place)
    if not ((size >= 1) & (size <= _MOST_PIXELS) & (size == np.round(size))).all():
        problem = "width and height in whole pixels are needed"
        raise InputError(source, problem, place=place, remedy=f"1 to {_MOST_PIXELS}")
    return int(size[0]), int(size[1])


def _intrinsics(value: Any, source: str | Path, place: str) -> np.ndarray:
    K = shaped(value, (3, 3), source, place)
    if K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
        raise InputError(source, "a focal length is not positive", place=place)
    for focal in (K[0, 0], K[1, 1]):
        if not _FOCAL[0] <= focal <= _FOCAL[1]:
            low, high = _FOCAL
            problem = f"a focal length of {focal:g} pixels cannot be"
            raise InputError(source, problem, place=place, remedy=f"{low:g} to {high:g} are taken")
    if K[1, 0] != 0.0 or not np.array_equal(K[2], [0.0, 0.0, 1.0]):
        raise InputError(source, "is not of the form [[fx, s, cx], [0, fy, cy], [0, 0, 1]]", place=place)
    return K


def _distortion(value: Any, source: str | Path, place: str, *, fisheye: bool) -> np.ndarray:
    coefficients = numbers(value, source, place)
    if coefficients.ndim != 1 or coefficients.size not in ((4,) if fisheye else COUNTS):
        shape = "x".join(map(str, coefficients.shape)) or "a number"
        if fisheye:
            needed, remedy = "4 coefficients of a fisheye are", "k1, k2, k3, k4 of cv2.fisheye; other lenses are no fisheye"
        else:
            needed, remedy = "4, 5, 8, 12 or 14 coefficients are", "k1, k2, p1, p2, k3, ... in the order of OpenCV"
        raise InputError(source, f"{needed} needed, found {shape}", place=place, remedy=remedy)
    if (np.abs(coefficients) > _COEFFICIENT).any():
        raise InputError(source, "has a coefficient beyond all measure", place=place, remedy=f"up to {_COEFFICIENT:g}")
    return coefficients if fisheye or coefficients.size > 4 else np.append(coefficients, 0.0)


def _rotation(value: Any, source: str | Path, place: str) -> np.ndarray:
    R = shaped(value, (3, 3), source, place)
    if np.abs(R.T @ R - np.eye(3)).max() > _TOLERANCE:
        raise InputError(source, "is not a rotation: its columns are not orthonormal", place=place)
    if np.linalg.det(R) < 0.0:
        raise InputError(source, "is a reflection, not a rotation: its determinant is -1", place=place)
    return R
