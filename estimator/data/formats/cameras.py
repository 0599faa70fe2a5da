"""Camera files of every registered format, recognised by their content; kinemode's own JSON is written.

Formats: `cameras_json` (our own), `cameras_toml` (Pose2Sim, Anipose, Caliscope), `cameras_opencv` (YAML, JSON, XML),
`cameras_kalibr`, `cameras_easymocap`, `cameras_panoptic`, `cameras_qualisys` (QTM's calibration).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from estimator.data.cameras.camera import UPS, Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat
from estimator.data.formats.cameras_easymocap import EASYMOCAP
from estimator.data.formats.cameras_json import JSON, camera_to_json
from estimator.data.formats.cameras_kalibr import KALIBR
from estimator.data.formats.cameras_opencv import OPENCV_JSON, OPENCV_XML, OPENCV_YAML
from estimator.data.formats.cameras_panoptic import PANOPTIC
from estimator.data.formats.cameras_qualisys import QUALISYS
from estimator.data.formats.cameras_toml import TOML
from humanoid.support.errors import InputError, shown
from humanoid.support.files import read_bytes, replacing
from humanoid.support.plugins import Registry

CAMERA_FORMATS: Registry[CameraFormat] = Registry(
    "camera format", (OPENCV_JSON, JSON, PANOPTIC, TOML, OPENCV_YAML, EASYMOCAP, KALIBR, QUALISYS, OPENCV_XML)
)
"""Formats that are read, by name; those registered last are tried first."""
register = CAMERA_FORMATS.register
_PICKLES = (".pickle", ".pkl")
_PICKLED = b"\x80"  # the first byte of a pickle since protocol 2


def load_cameras(path: str | Path) -> dict[str, Camera]:
    """Cameras of a file by name, in its order: kinemode's own JSON, Pose2Sim, Anipose or Caliscope TOML, OpenCV YAML,
    JSON or XML, Kalibr's or EasyMocap's YAML, CMU Panoptic JSON, Qualisys .qca.txt or .xml, or a format that a plugin
    registers.

    R and t may be left out where the file has a single camera, which is then placed like a guessed one. No pickle is
    ever loaded.

    Raises
    ------
    InputError: naming the format and the place, like `Pose2Sim TOML, [cam01].matrix`; of our own JSON the place alone,
        like `cameras[2].K`. Where translations cannot be metres, the error explains how to declare the unit.
    """
    path = Path(path)
    content = read_bytes(path)
    if path.suffix.lower() in _PICKLES or content.startswith(_PICKLED):
        remedy = "convert it with Pose2Sim (calibration_type 'convert', convert_from 'opencap') and give the .toml"
        problem = "is a pickle, as OpenCap writes; pickles can run any program, so they are not loaded"
        raise InputError(path, problem, remedy=remedy)
    loaded = _cameras(CameraFile(path, content))
    if not loaded:
        raise InputError(path, "has no camera", place="cameras")
    cameras: dict[str, Camera] = {}
    for i, camera in enumerate(loaded):
        if camera.name in cameras:
            raise InputError(path, f"the name {camera.name!r} is used twice", place=f"cameras[{i}].name")
        cameras[camera.name] = camera
    return cameras


def declared_up(path: str | Path) -> str | None:
    """The axis of the cameras' world that points up, where a file that `load_cameras` reads, or its format, declares
    it. Raises InputError: it is not one of `UPS`."""
    file = CameraFile(Path(path), read_bytes(Path(path)))
    up = _format(file).up(file)
    if up is not None and up not in UPS:
        raise InputError(file.path, f"{shown(up)} is not an axis", place="up", remedy=f"one of {', '.join(UPS)}")
    return up


def declared_floor(path: str | Path) -> float | None:
    """Height of the floor [m] along the axis that points up, where a file that `load_cameras` reads has it. Raises
    InputError: it is not a number."""
    file = CameraFile(Path(path), read_bytes(Path(path)))
    return _format(file).floor(file)


def _cameras(file: CameraFile) -> list[Camera]:
    """The cameras of a file by the first format that recognises it."""
    return _format(file).read(file)


def _format(file: CameraFile) -> CameraFormat:
    read = "read are " + ", ".join(CAMERA_FORMATS)
    if not file.start:
        raise InputError(file.path, "is empty", remedy=read)
    for known in reversed(list(CAMERA_FORMATS.values())):
        if known.recognises(file):
            return known
    if file.root:
        hint = "a Vicon .xcp; convert it with Pose2Sim to .toml" if file.root.lower() == "cameras" else read
        raise InputError(file.path, f"<{file.root[:60]}> has no cameras in a supported format", remedy=hint)
    raise InputError(file.path, "has no cameras in a supported format", remedy=read)


def write_cameras(path: str | Path, cameras: Iterable[Camera]) -> None:
    """Write cameras as kinemode's JSON, so that `load_cameras` gives the same numbers back to the last bit."""
    given = list(cameras)
    axes = max((camera.lens.ndim for camera in given), default=1)
    kind = ("pinhole_brown5", "opencv", "opencv_or_parallel")[axes - 1]
    with replacing(path) as temporary:
        text = json.dumps({"format": kind, "cameras": [camera_to_json(c) for c in given]}, indent=1)
        temporary.write_text(text + "\n", encoding="utf-8")
