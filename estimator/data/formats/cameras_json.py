"""Cameras in kinemode's own JSON, checked. Other formats are converted to it, and run files contain it.

    {"cameras": [{"name": "cam01", "image_size": [w, h], "K": 3 x 3, "distortion": [k1, k2, p1, p2, k3],
                  "R": 3 x 3, "t": [x, y, z]}, ...]}

x_camera = R x_world + t in metres; camera axes x right, y down, z forward; pixel centres at integer coordinates. The
coefficients are OpenCV's 4, 5, 8, 12 or 14, or with "fisheye": true the 4 of its fisheye model. With "parallel": true
the camera is parallel (orthographic), without distortion, and K's scale is in pixels per metre. "focal_std" is the
relative standard deviation of the focal length, where it is a guess. "deviations" are those of a camera that was found
from a person: 7 rows as in `Camera.deviations`, of the same length for every camera of the file. Accepted are images of
up to 16384 pixels a side, focal lengths of 1 to 1e6 pixels (a metre), coefficients up to 1e4. Lengths are in metres
unless `"units": "mm"` (or "cm") is next to "cameras", and `"up": "y"` there declares which axis of the world points
up, where that is known (else it is found from the person); `"floor": 0` the height of the floor along it, in the same
unit. An unknown member is refused, unless it is text, such as a note.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.cameras.lens import COUNTS
from estimator.data.formats.camera_format import UNITS, CameraFile, CameraFormat, in_metres
from estimator.data.formats.checked_json import (
    LARGEST,
    check_members,
    mapping,
    number_between,
    numbers,
    sequence,
    shaped,
)
from humanoid.support.errors import InputError

_TOLERANCE = 1e-3  # of R'R - 1: calibration tools print few digits
_MOST_PIXELS = 16384  # on a side of an image
_FOCAL = (1.0, 1e6)  # px
_COEFFICIENT = 1e4
_FOCAL_STD = (0.0, 1.0)
_MEMBERS = ("name", "image_size", "K", "distortion", "fisheye", "parallel", "focal_std", "deviations", "R", "t")
_DERIVED = ("centre_world",)  # follows from the others


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """One camera of the file."""
    entry = {
        "name": camera.name,
        "image_size": [int(n) for n in camera.image_size],
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
        "R": camera.R_camera_world.tolist(),
        "t": camera.t_camera_world.tolist(),
    }
    options = {"fisheye": camera.fisheye, "parallel": camera.parallel, "focal_std": camera.focal_std}
    entry |= {key: value for key, value in options.items() if value}
    return entry if camera.deviations is None else entry | {"deviations": camera.deviations.tolist()}


def cameras_from_json(root: Mapping[str, Any], source: str | Path) -> list[Camera]:
    """All cameras of a file of our own."""
    entries = sequence(root.get("cameras"), source, "cameras")
    check_members(root, ("cameras", "units", "up", "floor", "format"), source, "", near=True)
    cameras = [
        camera_from_json(entry, source, f"cameras[{i}]", alone=len(entries) == 1) for i, entry in enumerate(entries)
    ]
    counts = {camera.deviations.shape[1] for camera in cameras if camera.deviations is not None}
    if len(counts) > 1:
        raise InputError(source, "has deviations of cameras that were not found together", place="cameras")
    placed = any(isinstance(entry, dict) and entry.get("t") is not None for entry in entries)
    return (
        in_metres(cameras, root.get("units"), source, "", 'write "units": "mm" beside "cameras"') if placed else cameras
    )


def camera_from_json(
    value: Any, source: str | Path, place: str, *, alone: bool = False, called: Mapping[str, str] | None = None
) -> Camera:
    """One camera of a file, checked; `alone` allows R and t to be missing.

    called: what the members are called in a file of another format, for errors.
    """
    entry = mapping(value, source, place)
    check_members(entry, (*_MEMBERS, *_DERIVED), source, place)
    places = {key: f"{place}.{(called or {}).get(key, key)}" for key in _MEMBERS}

    def needed(key: str) -> Any:
        if key not in entry:
            raise InputError(source, "is missing", place=places[key])
        return entry[key]

    name = needed("name")
    if not isinstance(name, str) or not name:
        raise InputError(source, "a name is needed", place=places["name"])
    size = image_size(needed("image_size"), source, places["image_size"])
    fisheye, parallel = (_flag(entry, key, source, places[key]) for key in ("fisheye", "parallel"))
    K = _intrinsics(needed("K"), source, places["K"], parallel=parallel)
    none = [0.0] * (4 if fisheye else 5)
    distortion = _distortion(entry.get("distortion", none), source, places["distortion"], fisheye=fisheye)
    if parallel and (fisheye or np.any(distortion)):
        problem, remedy = "a parallel camera has no lens", "undistort its pictures first, and leave this out"
        raise InputError(source, problem, place=places["fisheye" if fisheye else "distortion"], remedy=remedy)
    focal_std = float(shaped(entry.get("focal_std", 0.0), (), source, places["focal_std"]))
    if not _FOCAL_STD[0] <= focal_std <= _FOCAL_STD[1]:
        problem = "must be {:g} to {:g}, got {:g}".format(*_FOCAL_STD, focal_std)
        raise InputError(source, problem, place=places["focal_std"])
    if alone and entry.get("R") is None and entry.get("t") is None:
        guess = guessed_camera(name, size)
        R, t = guess.R_camera_world, guess.t_camera_world
    else:
        R = _rotation(needed("R"), source, places["R"])
        t = shaped(needed("t"), (3,), source, places["t"])
    deviations = None
    if entry.get("deviations") is not None:
        deviations = _deviations(entry["deviations"], source, places["deviations"])
    for array in (K, distortion, R, t):
        array.flags.writeable = False
    return Camera(name, size, K, distortion, R, t, fisheye, parallel, focal_std, deviations)


def _deviations(value: Any, source: str | Path, place: str) -> np.ndarray:
    deviations = numbers(value, source, place)
    if deviations.ndim != 2 or len(deviations) != 7:
        shape = "x".join(map(str, deviations.shape)) or "a number"
        remedy = "3 of a turn, 3 of a shift, 1 of the focal length; leave it out where nothing is known"
        raise InputError(source, f"7 rows are needed, found {shape}", place=place, remedy=remedy)
    return deviations


def _flag(entry: Mapping[str, Any], key: str, source: str | Path, place: str) -> bool:
    value = entry.get(key, False)
    if not isinstance(value, bool):
        raise InputError(source, "true or false is needed", place=place)
    return value


def image_size(value: Any, source: str | Path, place: str) -> tuple[int, int]:
    """Width and height [px] of a JSON pair."""
    size = shaped(value, (2,), source, place)
    if not ((size >= 1) & (size <= _MOST_PIXELS) & (size == np.round(size))).all():
        problem = "width and height in whole pixels are needed"
        raise InputError(source, problem, place=place, remedy=f"1 to {_MOST_PIXELS}")
    return int(size[0]), int(size[1])


def _intrinsics(value: Any, source: str | Path, place: str, *, parallel: bool) -> np.ndarray:
    K = shaped(value, (3, 3), source, place)
    what, unit = ("scale", "pixels a metre") if parallel else ("focal length", "pixels")
    if K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
        raise InputError(source, f"a {what} is not positive", place=place)
    for focal in (K[0, 0], K[1, 1]):
        if not _FOCAL[0] <= focal <= _FOCAL[1]:
            low, high = _FOCAL
            problem = f"a {what} must be {low:g} to {high:g} {unit}, got {focal:g}"
            raise InputError(source, problem, place=place)
    if K[1, 0] != 0.0 or not np.array_equal(K[2], [0.0, 0.0, 1.0]):
        raise InputError(source, "is not of the form [[fx, s, cx], [0, fy, cy], [0, 0, 1]]", place=place)
    return K


def _distortion(value: Any, source: str | Path, place: str, *, fisheye: bool) -> np.ndarray:
    coefficients = numbers(value, source, place)
    if coefficients.ndim != 1 or coefficients.size not in ((4,) if fisheye else COUNTS):
        shape = "x".join(map(str, coefficients.shape)) or "a number"
        if fisheye:
            needed, remedy = (
                "4 coefficients of a fisheye are",
                "k1, k2, k3, k4 of cv2.fisheye",
            )
        else:
            needed, remedy = "4, 5, 8, 12 or 14 coefficients are", "k1, k2, p1, p2, k3, ... in the order of OpenCV"
        raise InputError(source, f"{needed} needed, found {shape}", place=place, remedy=remedy)
    if (np.abs(coefficients) > _COEFFICIENT).any():
        raise InputError(source, "has a coefficient too large", place=place, remedy=f"up to {_COEFFICIENT:g}")
    return coefficients if fisheye or coefficients.size > 4 else np.append(coefficients, 0.0)


def _rotation(value: Any, source: str | Path, place: str) -> np.ndarray:
    R = shaped(value, (3, 3), source, place)
    if np.abs(R.T @ R - np.eye(3)).max() > _TOLERANCE:
        raise InputError(source, "is not a rotation: its columns are not orthonormal", place=place)
    if np.linalg.det(R) < 0.0:
        raise InputError(source, "is a reflection, not a rotation: its determinant is -1", place=place)
    return R


def _read(file: CameraFile) -> list[Camera]:
    assert file.json is not None
    return cameras_from_json(file.json, file.path)


def _up(file: CameraFile) -> Any:
    return None if file.json is None else file.json.get("up")


def _floor(file: CameraFile) -> float | None:
    root = file.json or {}
    if root.get("floor") is None:
        return None
    return UNITS.get(str(root.get("units")), 1.0) * number_between(root["floor"], -LARGEST, LARGEST, file.path, "floor")


JSON = CameraFormat("kinemode JSON", lambda file: file.json is not None and "cameras" in file.json, _read, _up, _floor)
