"""Cameras as `cv2.FileStorage` and OpenCV's samples write them: YAML, JSON and XML; ROS's camera_info YAML too.

One camera at the top level (camera_matrix, distortion_coefficients, image_width, image_height, and where there are any
R and T or rvec and tvec: x_camera = R x_world + t, as in `cv2.solvePnP` and `cv2.projectPoints`), or a group of these
for each camera, by name. Of a pair with M1, D1, M2, D2, R and T in one file, as `cv2.stereoCalibrate` gives them, the
first camera (`cam1`) is the world's origin and x_2 = R x_1 + T (`cam2`). Lengths are in the unit of the board's
squares; `units: "mm"` in the file, our addition, declares it.

The text is parsed by PyYAML, json and expat: `cv2.FileStorage` itself can end the process on a damaged file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat, check_apart, in_metres, rotation_matrix
from estimator.data.formats.cameras_json import camera_from_json
from estimator.data.formats.checked_json import numbers
from humanoid.subject.urdf_document import Document, elements
from humanoid.support.errors import InputError, shown

_CALLED = {
    "name": ("name", "cameraname"),
    "image_size": ("imagesize", "imgsize", "size", "resolution"),
    "K": ("cameramatrix", "k", "mtx", "m", "intrinsicmatrix", "intrinsics"),
    "distortion": (
        "distortioncoefficients", "distcoeffs", "distcoeff", "distcoefs", "dist", "d", "distortion", "distortions",
    ),
    "R": ("r", "rotation", "rotationmatrix", "rvec", "rotationvector"),
    "t": ("t", "translation", "tvec", "translationvector"),
}  # fmt: skip
"""Names of the members without their underscores, in small letters."""
_NAMED = {
    "image_size": "image_width and image_height", "K": "camera_matrix", "distortion": "distortion_coefficients",
    "R": "R", "t": "T",
}  # fmt: skip
_FISHEYES = ("equidistant", "fisheye", "kannalabrandt")
_UNIT = 'write units: "mm" into the file'


def is_opencv(root: Mapping[str, Any]) -> bool:
    """Whether a mapping has a camera matrix, or groups that have one."""
    if _of(root, "K") is not None or _of(root, "K", "1") is not None:
        return True
    return bool(_groups(root))


def _groups(root: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The members that are cameras themselves."""
    return {str(k): value for k, value in root.items() if isinstance(value, dict) and _of(value, "K") is not None}


def cameras_from_opencv(root: Mapping[str, Any], source: str | Path, kind: str) -> list[Camera]:
    """The cameras of a parsed file; kind: the format's name, for errors."""
    if _of(root, "K", "1") is not None:
        entries, alone = _pair(root, source, kind), False
    elif _of(root, "K") is not None:
        entries, alone = {Path(source).stem: _entry(root, source, kind)}, True
    else:
        groups = _groups(root)
        if not groups:
            keys = ", ".join(map(str, root))[:200] or "nothing"
            raise InputError(source, f"has no camera_matrix, but {keys}", place=kind, remedy=_remedy())
        entries = {name: _entry(value, source, f"{kind}, {name}") for name, value in groups.items()}
        alone = len(entries) == 1
    cameras = []
    for name, entry in entries.items():
        place = kind if alone else f"{kind}, {name}"
        if "image_size" not in entry:
            remedy = "add image_width and image_height, the size of the pictures [px]"
            raise InputError(source, "does not give the size of the pictures", place=place, remedy=remedy)
        if not alone and "R" not in entry and "t" not in entry:
            remedy = "add R and T, or give the file of one camera"
            raise InputError(source, "does not give the place of this camera", place=place, remedy=remedy)
        cameras.append(camera_from_json({"name": name} | entry, source, place, alone=alone, called=_NAMED))
    check_apart(cameras, source, kind)
    placed = "R" in next(iter(entries.values()))
    return in_metres(cameras, root.get("units"), source, kind, _UNIT) if placed else cameras


def _remedy() -> str:
    return "camera_matrix, distortion_coefficients, image_width, image_height, and R and T of several cameras"


def _entry(root: Mapping[str, Any], source: str | Path, place: str, suffix: str = "") -> dict[str, Any]:
    """One camera in our own JSON; suffix: of the members' names."""
    entry: dict[str, Any] = {}
    for key in ("K", "distortion", "R", "t"):
        value = _of(root, key, suffix)
        if value is not None:
            entry[key] = opencv_matrix(value, source, f"{place}.{_NAMED[key]}{suffix}")
    for key in ("distortion", "t"):
        if key in entry:
            entry[key] = entry[key].ravel()
    if "R" in entry:
        entry["R"] = rotation_matrix(entry["R"].tolist(), source, f"{place}.R")
    entry |= {key: entry[key].tolist() for key in ("K", "distortion", "t") if key in entry}
    if "distortion" not in entry and not suffix:
        for key, value in root.items():  # a lens by a word that is not known must not become none
            if "dist" in _plain(key) and isinstance(value, (list, dict)):
                remedy = "call it distortion_coefficients"
                raise InputError(source, f"the member {shown(key)} is unknown", place=place, remedy=remedy)
    size = _size(root)
    if size is not None:
        entry["image_size"] = size
    plain = {_plain(key): value for key, value in root.items()}
    model = plain.get("distortionmodel")
    if plain.get("fisheyemodel") or plain.get("fisheye") or (isinstance(model, str) and _plain(model) in _FISHEYES):
        entry["fisheye"] = True
    name = _of(root, "name")
    return entry | ({"name": name} if isinstance(name, str) else {})


def _pair(root: Mapping[str, Any], source: str | Path, kind: str) -> dict[str, dict[str, Any]]:
    """Both cameras of a stereo calibration."""
    first, second = (_entry(root, source, kind, suffix) for suffix in "12")
    relative = _entry(root, source, kind)
    if "K" not in second:
        raise InputError(source, "has the first camera of a pair alone", place=kind, remedy="add M2, D2, R and T")
    if "R" not in relative or "t" not in relative:
        remedy = "add R and T of extrinsics.yml to the file, and image_width and image_height"
        raise InputError(source, "has the intrinsics of a pair without R and T", place=kind, remedy=remedy)
    first |= {"R": np.eye(3).tolist(), "t": [0.0, 0.0, 0.0]}
    second |= {"R": relative["R"], "t": relative["t"]}
    return {"cam1": {**first, "name": "cam1"}, "cam2": {**second, "name": "cam2"}}


def _size(root: Mapping[str, Any]) -> Any:
    plain = {_plain(key): value for key, value in root.items()}
    if "imagewidth" in plain and "imageheight" in plain:
        return [plain["imagewidth"], plain["imageheight"]]
    return _of(root, "image_size")


def _of(root: Mapping[str, Any], member: str, suffix: str = "") -> Any:
    """A member by any of its names, None where it is missing."""
    plain = {_plain(key): value for key, value in root.items()}
    return next((plain[name + suffix] for name in _CALLED[member] if name + suffix in plain), None)


def _plain(key: object) -> str:
    return str(key).lower().replace("_", "").replace("-", "").replace(" ", "")


def opencv_matrix(value: Any, source: str | Path, place: str) -> np.ndarray:
    """A matrix of OpenCV (rows, cols, data), or nested lists."""
    if not isinstance(value, dict):
        return numbers(value, source, place)
    data = value.get("data")
    if isinstance(data, str):
        problem = "is not written as numbers"
        raise InputError(source, problem, place=place, remedy="write it without cv2.FILE_STORAGE_WRITE_BASE64")
    array = numbers(data, source, place)
    rows, columns = (numbers(value.get(key), source, f"{place}.{key}") for key in ("rows", "cols"))
    if array.ndim != 1 or rows.ndim or columns.ndim or rows * columns != array.size or rows < 1:
        raise InputError(source, "rows, cols and data do not fit each other", place=place)
    return array.reshape(int(rows), int(columns))


def opencv_xml(document: Document) -> Mapping[str, Any]:
    """The members of an OpenCV XML file."""
    return {child.tag: _xml_value(child) for child in elements(document.root)}


def _xml_value(element: Any) -> Any:
    if element.get("type_id") == "opencv-matrix":
        return {child.tag: _xml_numbers(child) for child in elements(element)}
    children = {child.tag: _xml_value(child) for child in elements(element)}
    return children or _xml_numbers(element)


def _xml_numbers(element: Any) -> Any:
    """A number, a list of them for <data>, or the text."""
    text = (element.text or "").strip()
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        return text.strip('"')
    return values if element.tag == "data" or len(values) != 1 else values[0]


def _read_yaml(file: CameraFile) -> list[Camera]:
    assert file.yaml is not None
    return cameras_from_opencv(file.yaml, file.path, "OpenCV YAML")


def _read_json(file: CameraFile) -> list[Camera]:
    assert file.json is not None
    return cameras_from_opencv(file.json, file.path, "OpenCV JSON")


def _read_xml(file: CameraFile) -> list[Camera]:
    assert file.xml is not None
    return cameras_from_opencv(opencv_xml(file.xml), file.path, "OpenCV XML")


OPENCV_YAML = CameraFormat("OpenCV YAML", lambda file: file.yaml is not None, _read_yaml)
OPENCV_JSON = CameraFormat("OpenCV JSON", lambda file: file.json is not None and is_opencv(file.json), _read_json)
OPENCV_XML = CameraFormat("OpenCV XML", lambda file: file.root == "opencv_storage", _read_xml)
