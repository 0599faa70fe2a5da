"""Cameras in TOML as Pose2Sim and Anipose write them (FreeMoCap too): a section for each.

    [cam_0]
    name = "cam01"
    size = [1088, 1920]                      # width, height [px]
    matrix = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    distortions = [k1, k2, p1, p2, k3]       # or another number of OpenCV's; 4 of a fisheye
    rotation = [rx, ry, rz]                  # rotation vector (Rodrigues), world to camera
    translation = [tx, ty, tz]               # x_camera = R x_world + t
    fisheye = false
    [metadata]
    units = "mm"                             # our addition: no tool writes the unit

Caliscope calls its sections [cameras.0], has rotations as matrices too, and leaves out cameras with `ignore = true`.
Both tools project by `cv2.projectPoints` with rotation and translation as they stand (`aniposelib.cameras`;
`Pose2Sim.common.computeP`). Pose2Sim's translations are metres, Anipose's in the unit of its board, often millimetres.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat, check_apart, in_metres, rotation_matrix
from estimator.data.formats.cameras_json import camera_from_json
from estimator.data.formats.checked_config import parsed_toml
from estimator.data.formats.checked_json import check_members
from humanoid.support.errors import InputError

_CALLED = {
    "image_size": "size", "K": "matrix", "distortion": "distortions", "R": "rotation", "t": "translation",
}  # fmt: skip
_CALLED_BY = {theirs: ours for ours, theirs in _CALLED.items()}
_NEEDED = "a section for each camera with name, size, matrix, distortions, rotation and translation"


def cameras_from_toml(content: bytes, source: str | Path) -> list[Camera]:
    """The cameras of a Pose2Sim or Anipose file; raises InputError naming format, section and key."""
    root = parsed_toml(content, source, remedy=f"Pose2Sim and Anipose TOML have {_NEEDED}")
    sections = {k: v for k, v in root.items() if _is_camera(v)}
    by_number = all(name.partition("_")[0] == "cam" for name in sections)
    kind = "Anipose TOML" if by_number else "Pose2Sim TOML"
    numbered = root.get("cameras")
    if not sections and isinstance(numbered, dict):
        kind = "Caliscope TOML"
        sections = {f"cam_{k}": v for k, v in numbered.items() if _is_camera(v) and v.get("ignore") is not True}
    if not sections:
        raise InputError(source, "has no camera", place="Pose2Sim TOML", remedy=_NEEDED)
    cameras = [
        _camera(entry, name, source, f"{kind}, [{name}]", alone=len(sections) == 1) for name, entry in sections.items()
    ]
    check_apart(cameras, source, kind)
    metadata = root.get("metadata")
    unit = metadata.get("units") if isinstance(metadata, dict) else None
    return in_metres(cameras, unit, source, kind, 'write units = "mm" below [metadata]')


def _is_camera(section: Any) -> bool:
    return isinstance(section, dict) and len(section.keys() & _CALLED_BY.keys()) > 1


def _camera(section: Mapping[str, Any], name: str, source: str | Path, place: str, *, alone: bool) -> Camera:
    check_members(section, ("distortions", "fisheye"), source, place, near=True)
    entry = {ours: section[theirs] for theirs, ours in _CALLED_BY.items() if theirs in section}
    entry |= {key: section[key] for key in ("name", "fisheye") if key in section}
    if entry.get("R") is not None:
        entry["R"] = rotation_matrix(entry["R"], source, f"{place}.rotation")
    return camera_from_json({"name": name} | entry, source, place, alone=alone, called=_CALLED)


def _is_toml(file: CameraFile) -> bool:
    return file.ending == ".toml" or (file.start.startswith(b"[") and file.ending != ".json")


TOML = CameraFormat(
    "Pose2Sim, Anipose and Caliscope TOML", _is_toml, lambda file: cameras_from_toml(file.content, file.path)
)
