"""Cameras as EasyMocap writes them: intri.yml and extri.yml in one folder, either of which represents both.

    names: ["01", "02"]
    K_01, dist_01: 3 x 3, 5 coefficients;  H_01, W_01: size of the pictures        # intri.yml
    R_01 or Rot_01, T_01: rotation vector or matrix, x_camera = R x_world + T [m]  # extri.yml

Matrices are OpenCV's (`!!opencv-matrix`). (EasyMocap's documentation, "camera parameters".)
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat, in_metres, rotation_matrix
from estimator.data.formats.cameras_json import camera_from_json
from estimator.data.formats.cameras_opencv import opencv_matrix
from estimator.data.formats.checked_config import parsed_yaml
from humanoid.support.errors import InputError
from humanoid.support.files import read_bytes

_PARTS = {"intri": "K", "extri": "T"}


def _is_easymocap(file: CameraFile) -> bool:
    root = file.yaml or {}
    names = root.get("names")
    return isinstance(names, list) and any(f"{start}_{name}" in root for start in "KT" for name in names)


def _both(file: CameraFile) -> Mapping[str, Any]:
    """The members of both files."""
    root = dict(file.yaml or {})
    for part, start in _PARTS.items():
        if not any(str(key).startswith(f"{start}_") for key in root):
            beside = Path(file.path).with_name(f"{part}{file.path.suffix}")
            if not beside.is_file():
                raise InputError(file.path, f"has only half of the camera parameters: {beside.name} is not beside it")
            root = {**parsed_yaml(read_bytes(beside), beside), **root}
    return root


def _read(file: CameraFile) -> list[Camera]:
    root, kind = _both(file), "EasyMocap YAML"
    cameras = [_camera(root, str(name), file.path, f"{kind}, {name}") for name in root["names"]]
    return in_metres(cameras, root.get("units"), file.path, kind, 'write units: "mm" into the file')


def _camera(root: Mapping[str, Any], name: str, source: Path, place: str) -> Camera:
    turned = f"Rot_{name}" if f"Rot_{name}" in root else f"R_{name}"
    called = {"K": f"K_{name}", "distortion": f"dist_{name}", "R": turned, "t": f"T_{name}"}
    given = {ours: opencv_matrix(root[key], source, f"{place}.{key}") for ours, key in called.items() if key in root}
    entry: dict[str, Any] = {
        ours: (array.ravel() if ours in ("distortion", "t") else array).tolist() for ours, array in given.items()
    }
    if "R" in entry:
        entry["R"] = rotation_matrix(entry["R"], source, f"{place}.{turned}")
    if f"W_{name}" not in root or f"H_{name}" not in root:
        remedy = f"add W_{name} and H_{name}, width and height of the pictures [px], to intri.yml"
        raise InputError(source, "does not give the size of the pictures", place=place, remedy=remedy)
    entry |= {"name": name, "image_size": [root[f"W_{name}"], root[f"H_{name}"]]}
    return camera_from_json(entry, source, place, called=called)


EASYMOCAP = CameraFormat("EasyMocap YAML", _is_easymocap, _read)
