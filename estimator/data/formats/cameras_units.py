"""Conversions for camera files: rotation vectors, and lengths of an unknown unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.checked_json import numbers, shaped
from humanoid.support.errors import InputError, shown

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
FARTHEST = 50.0  # m that cameras of one subject are apart, or one is from its origin


def rotation_matrix(value: Any, source: str | Path, place: str) -> list[list[float]]:
    """A rotation (3, 3) from a matrix, or from a rotation vector (3,) [rad] (Rodrigues), as rows."""
    given = numbers(value, source, place)
    if given.size != 3:
        return np.asarray(shaped(value, (3, 3), source, place)).tolist()
    return np.asarray(cv2.Rodrigues(given.reshape(3))[0]).tolist()


def in_metres(cameras: Sequence[Camera], unit: Any, source: str | Path, place: str, remedy: str) -> list[Camera]:
    """Cameras whose translations are in a unit, None for undeclared metres.

    remedy: how the file can declare its unit.

    Raises
    ------
    InputError: an unknown unit; without one, cameras implausibly far apart in metres.
    """
    if unit is None:
        centres = np.array([camera.origin_world for camera in cameras])
        first = centres[0] if len(centres) > 1 else np.zeros(3)
        farthest = float(np.linalg.norm(centres - first, axis=1).max())
        if farthest > FARTHEST:
            where = "apart" if len(centres) > 1 else "from the origin"
            problem = f"the cameras are {farthest:.0f} m {where}, if translations are in metres"
            raise InputError(source, problem, place=place, remedy=f"{remedy}, if they are in millimetres")
        return list(cameras)
    if unit not in UNITS:
        raise InputError(source, f"the unit {shown(unit)} is unknown", place=place, remedy=f"one of {', '.join(UNITS)}")
    return [_scaled(camera, UNITS[unit]) for camera in cameras]


def _scaled(camera: Camera, factor: float) -> Camera:
    """The cameras with all lengths multiplied by a factor."""
    deviations = camera.deviations
    if deviations is not None:
        deviations = deviations * np.repeat([1.0, factor, 1.0], (3, 3, 1))[:, None]
    return replace(camera, t_camera_world=factor * camera.t_camera_world, deviations=deviations)


def check_apart(cameras: Sequence[Camera], source: str | Path, place: str) -> None:
    """Raise InputError where several cameras all have the very same placement, which a file without any may give."""
    places = [np.column_stack([c.R_camera_world, c.t_camera_world]) for c in cameras]
    if len(cameras) > 1 and all(np.array_equal(place, places[0]) for place in places):
        problem = f"all {len(cameras)} cameras are at one place: the file has only intrinsics"
        raise InputError(source, problem, place=place, remedy="calibrate the placements too (extrinsics)")
