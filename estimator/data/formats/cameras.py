"""Camera files of every format that is read, told apart by what they hold; kinemode's own JSON is written.

Formats: `cameras_json` (our own), `cameras_toml` (Pose2Sim, Anipose), `cameras_opencv` (YAML, JSON, XML),
`cameras_qualisys` (QTM's calibration).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras_json import camera_to_json, cameras_from_json
from estimator.data.formats.cameras_opencv import cameras_from_opencv, is_opencv, opencv_xml, opencv_yaml
from estimator.data.formats.cameras_qualisys import cameras_from_qualisys
from estimator.data.formats.cameras_toml import cameras_from_toml
from estimator.data.formats.checked_json import mapping, read_json
from humanoid.subject.urdf_document import read_document
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError
from humanoid.support.files import read_bytes

FORMATS = "kinemode JSON, Pose2Sim and Anipose TOML, OpenCV YAML, JSON and XML, Qualisys .qca.txt and .xml"
_PICKLES = (".pickle", ".pkl")
_PICKLED = b"\x80"  # the first byte of a pickle since protocol 2


def load_cameras(path: str | Path) -> dict[str, Camera]:
    """Cameras of a file by name, in its order: kinemode's own JSON, Pose2Sim or Anipose TOML, OpenCV YAML, JSON or XML,
    Qualisys .qca.txt or .xml.

    R and t may be left out where the file has a single camera, which then stands as a guessed one does. No pickle is
    ever loaded.

    Raises
    ------
    InputError: naming the format and the place, like `Pose2Sim TOML, [cam01].matrix`; of our own JSON the place alone,
        like `cameras[2].K`. Where translations cannot be metres it says so, and how to tell the unit.
    """
    path = Path(path)
    content = read_bytes(path)
    if path.suffix.lower() in _PICKLES or content.startswith(_PICKLED):
        remedy = "convert it with Pose2Sim (calibration_type 'convert', convert_from 'opencap') and give the .toml"
        problem = "is a pickle, as OpenCap writes; pickles can run any program, so none is loaded"
        raise InputError(path, problem, remedy=remedy)
    loaded = _cameras(content, path)
    if not loaded:
        raise InputError(path, "has no camera", place="cameras")
    cameras: dict[str, Camera] = {}
    for i, camera in enumerate(loaded):
        if camera.name in cameras:
            raise InputError(path, f"the name {camera.name!r} is used twice", place=f"cameras[{i}].name")
        cameras[camera.name] = camera
    return cameras


def _cameras(content: bytes, path: Path) -> list[Camera]:
    """The cameras of a file of any format."""
    start = content.removeprefix(b"\xef\xbb\xbf").lstrip()[:200]
    if not start:
        raise InputError(path, "is empty", remedy=f"read are {FORMATS}")
    ending = path.suffix.lower()
    if start.startswith(b"<"):
        return _from_xml(content, path)
    if start.startswith(b"%YAML") or ending in (".yml", ".yaml"):
        return cameras_from_opencv(opencv_yaml(content, path), path, "OpenCV YAML")
    if ending == ".toml" or (start.startswith(b"[") and ending != ".json"):
        return cameras_from_toml(content, path)
    if start.startswith(b"{") or ending == ".json":
        root = mapping(read_json(path), path)
        if "cameras" in root:
            return cameras_from_json(root, path)
        if is_opencv(root):
            return cameras_from_opencv(root, path, "OpenCV JSON")
    raise InputError(path, "has no cameras in a format that is read", remedy=f"read are {FORMATS}")


def _from_xml(content: bytes, path: Path) -> list[Camera]:
    try:
        document = read_document(content, str(path))
    except InputError as error:  # its remedies are about subjects
        raise InputError(path, error.problem, place=error.place, remedy=f"read are {FORMATS}") from None
    tag = document.root.tag
    if tag == "opencv_storage":
        return cameras_from_opencv(opencv_xml(document), path, "OpenCV XML")
    if tag == "calibration":
        return cameras_from_qualisys(document)
    hint = "a Vicon .xcp; convert it with Pose2Sim to .toml" if tag.lower() == "cameras" else f"read are {FORMATS}"
    raise InputError(path, f"<{tag[:60]}> holds no cameras in a format that is read", remedy=hint)


def write_cameras(path: str | Path, cameras: Iterable[Camera]) -> None:
    """Write cameras as kinemode's JSON, so that `load_cameras` gives the same numbers back to the last bit."""
    given = list(cameras)
    axes = max((camera.lens.ndim for camera in given), default=1)
    kind = ("pinhole_brown5", "opencv", "opencv_or_parallel")[axes - 1]
    with replacing(path) as temporary:
        text = json.dumps({"format": kind, "cameras": [camera_to_json(c) for c in given]}, indent=1)
        temporary.write_text(text + "\n", encoding="utf-8")
