"""Cameras as Kalibr writes them (camchain.yaml): a chain in which each has the place of the one before it.

    cam0: {camera_model: pinhole, intrinsics: [fu, fv, pu, pv], distortion_model: radtan,
           distortion_coeffs: [k1, k2, p1, p2], resolution: [w, h], ...}
    cam1: {..., T_cn_cnm1: 4 x 4}            # x_cam1 = T x_cam0, in metres

The first camera is the world's origin. Supported are pinhole cameras with the lens radtan, equidistant (OpenCV's
fisheye) or none; other models are refused by name. (Kalibr's documentation, "YAML formats".)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat
from estimator.data.formats.cameras_json import camera_from_json
from estimator.data.formats.checked_json import member, shaped
from humanoid.support.errors import InputError, shown

_LENSES = {"radtan": False, "none": False, "equidistant": True}
"""Whether each is a fisheye."""
_CALLED = {
    "image_size": "resolution", "K": "intrinsics", "distortion": "distortion_coeffs", "R": "T_cn_cnm1",
    "t": "T_cn_cnm1",
}  # fmt: skip


def _groups(file: CameraFile) -> dict[str, Mapping[str, Any]]:
    """The members that are cameras, by name."""
    root = {} if file.yaml is None else file.yaml
    return {str(k): v for k, v in root.items() if isinstance(v, dict) and {"camera_model", "intrinsics"} <= v.keys()}


def _read(file: CameraFile) -> list[Camera]:
    groups, T_camera_world = _groups(file), np.eye(4)
    cameras: list[Camera] = []
    for name, group in groups.items():
        place = f"Kalibr YAML, {name}"
        if cameras:
            step = member(group, "T_cn_cnm1", file.path, place)
            T_camera_world = shaped(step, (4, 4), file.path, f"{place}.T_cn_cnm1") @ T_camera_world
        entry = _entry(group, file, place) | {"name": name}
        if len(groups) > 1:
            entry |= {"R": T_camera_world[:3, :3].tolist(), "t": T_camera_world[:3, 3].tolist()}
        cameras.append(camera_from_json(entry, file.path, place, alone=len(groups) == 1, called=_CALLED))
    return cameras


def _entry(group: Mapping[str, Any], file: CameraFile, place: str) -> dict[str, Any]:
    """A group's intrinsics, as in our own JSON."""
    lens = group.get("distortion_model", "none")
    models = ("camera_model", group["camera_model"], ("pinhole",)), ("distortion_model", lens, tuple(_LENSES))
    for key, value, valid in models:
        if value not in valid:
            problem, remedy = f"{shown(value)} is not read", f"read are {', '.join(valid)}: calibrate with one of these"
            raise InputError(file.path, problem, place=f"{place}.{key}", remedy=remedy)
    fu, fv, pu, pv = shaped(group["intrinsics"], (4,), file.path, f"{place}.intrinsics").tolist()
    entry: dict[str, Any] = {"K": [[fu, 0.0, pu], [0.0, fv, pv], [0.0, 0.0, 1.0]], "fisheye": _LENSES[lens]}
    if lens != "none":
        entry["distortion"] = member(group, "distortion_coeffs", file.path, place)
    return entry | {"image_size": member(group, "resolution", file.path, place)}


KALIBR = CameraFormat("Kalibr YAML", lambda file: bool(_groups(file)), _read)
