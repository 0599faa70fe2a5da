"""Cameras of Qualisys Track Manager's calibration: .qca.txt, or the .xml of its export and its real-time protocol.

    <calibration><cameras>
      <camera active="1" serial="26578" model="Miqus Video" viewrotation="0">
        <fov_video left="0" top="0" right="1919" bottom="1087"/>                       pixels, ends included
        <transform x="" y="" z="" r11="" r12="" ... r33=""/>                            millimetres
        <intrinsic focalLengthU="" focalLengthV="" centerPointU="" centerPointV="" skew=""   1/64 pixel
                   sensorMinU="" sensorMaxU="" ... radialDistortion1="" ... tangentalDistortion1=""/>

The table r11 to r33, read row by row, turns the world into axes x right, y up, z backward; OpenCV's are diag(1, -1,
-1) times it. x, y, z are the camera's centre. The distortion's coefficients have no unit: they are as OpenCV's, not 64
times them, which free calibrations of the same pictures confirm (Pose2Sim's converter divides them too).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat
from estimator.data.formats.cameras_json import camera_from_json
from humanoid.subject.urdf_document import Document, elements
from humanoid.support.errors import InputError

KIND = "Qualisys calibration"
_SUBPIXELS = 64.0
_TURN = np.diag([1.0, -1.0, -1.0])
_SEEING = ("video", "none")  # in the models of cameras that take videos; "none" is what converters write


def cameras_from_qualisys(document: Document) -> list[Camera]:
    """The video cameras of a calibration, or all where no model is a video camera; inactive ones are left out."""
    listed = [camera for group in elements(document.root, "cameras") for camera in elements(group, "camera")]
    active = [c for c in listed if c.get("active", "1") != "0" and c.get("calibrated", "true").lower() != "false"]
    if not active:
        remedy = "<calibration><cameras><camera ...> with <fov_video>, <transform> and <intrinsic>"
        raise InputError(document.source, "has no calibrated camera", place=KIND, remedy=remedy)
    seeing = [c for c in active if any(word in c.get("model", "").lower() for word in _SEEING)]
    return [_camera(document, element) for element in seeing or active]


def _camera(document: Document, element: ET.Element) -> Camera:
    name = document.attribute(element, "serial")
    place = f"{KIND}, camera {name}"
    if element.get("viewrotation", "0").strip() not in ("0", ""):
        remedy = 'export the videos as the sensor saw them and write viewrotation="0" into the file'
        problem = f"its view is turned by {element.get('viewrotation', '')[:20]} degrees"
        raise InputError(document.source, problem, place=place, remedy=remedy)
    fov, transform, intrinsic = (_part(document, element, tag) for tag in ("fov_video", "transform", "intrinsic"))
    left, top, right, bottom = (document.number(fov, side) for side in ("left", "top", "right", "bottom"))
    _check_sensor(document, intrinsic, (right, bottom), place)
    focal, centre = (
        [document.number(intrinsic, f"{what}{axis}") / _SUBPIXELS for axis in "UV"]
        for what in ("focalLength", "centerPoint")
    )
    skew = document.number(intrinsic, "skew", "0") / _SUBPIXELS
    k1, k2, k3 = (document.number(intrinsic, f"radialDistortion{i}", "0") for i in (1, 2, 3))
    p1, p2 = (document.number(intrinsic, f"tangentalDistortion{i}", "0") for i in (1, 2))
    table = np.array([[document.number(transform, f"r{i}{k}") for k in (1, 2, 3)] for i in (1, 2, 3)])
    R = _TURN @ table
    at = 1e-3 * np.array([document.number(transform, axis) for axis in "xyz"])
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are refused as what they become
        t = -R @ at
    entry = {
        "name": name,
        "image_size": [right - left + 1.0, bottom - top + 1.0],
        "K": [[focal[0], skew, centre[0] - left], [0.0, focal[1], centre[1] - top], [0.0, 0.0, 1.0]],
        "distortion": [k1, k2, p1, p2, k3],
        "R": R.tolist(),
        "t": t.tolist(),
    }
    called = {"image_size": "fov_video", "K": "intrinsic", "R": "transform", "t": "transform"}
    return camera_from_json(entry, document.source, place, called=called)


def _part(document: Document, element: ET.Element, tag: str) -> ET.Element:
    part = next(elements(element, tag), None)
    if part is None:
        raise document.fault(element, f"<{tag}> is missing", f"{KIND}: every camera has one")
    return part


def _check_sensor(document: Document, intrinsic: ET.Element, last: tuple[float, float], place: str) -> None:
    """Raise InputError where the last pixels of the picture are outside the sensor, so that its unit is another."""
    for axis, end in zip("UV", last, strict=True):
        sensor = document.number(intrinsic, f"sensorMax{axis}", str(_SUBPIXELS * end))
        if sensor + _SUBPIXELS < _SUBPIXELS * end:
            problem = f"sensorMax{axis} = {sensor:g} is not a sensor in 1/64 pixels for pictures up to pixel {end:g}"
            raise InputError(document.source, problem, place=place, remedy="give the file as QTM wrote it")


def _read(file: CameraFile) -> list[Camera]:
    assert file.xml is not None
    return cameras_from_qualisys(file.xml)


QUALISYS = CameraFormat("Qualisys .qca.txt and .xml", lambda file: file.root == "calibration", _read)
