"""Cameras of the CMU Panoptic Studio (calibration_SEQUENCE.json), whose lengths are in centimetres.

    {"cameras": [{"name": "00_00", "type": "hd", "resolution": [w, h], "K": 3 x 3, "distCoef": [k1, k2, p1, p2, k3],
                  "R": 3 x 3, "t": 3 x 1}, ...]}

x_camera = R x_world + t; the world's y axis points down. (H. Joo et al., "Panoptic Studio", ICCV 2015.)
"""

from __future__ import annotations

from estimator.data.cameras.camera import Camera
from estimator.data.formats.camera_format import CameraFile, CameraFormat, in_metres
from estimator.data.formats.cameras_json import camera_from_json
from estimator.data.formats.checked_json import mapping, numbers, sequence

_CALLED = {"image_size": "resolution", "distortion": "distCoef"}
_OTHER = ("type", "panel", "node")


def _is_panoptic(file: CameraFile) -> bool:
    cameras = None if file.json is None else file.json.get("cameras")
    first = cameras[0] if isinstance(cameras, list) and cameras else None
    return isinstance(first, dict) and {"resolution", "distCoef"} <= first.keys()


def _read(file: CameraFile) -> list[Camera]:
    assert file.json is not None
    cameras, kind = [], "CMU Panoptic JSON"
    for i, value in enumerate(sequence(file.json["cameras"], file.path, "cameras")):
        place = f"{kind}, cameras[{i}]"
        given = mapping(value, file.path, place)
        entry = {key: value for key, value in given.items() if key not in _OTHER}
        entry |= {ours: entry.pop(theirs) for ours, theirs in _CALLED.items() if theirs in entry}
        if "t" in entry:
            entry["t"] = numbers(entry["t"], file.path, f"{place}.t").ravel().tolist()
        cameras.append(camera_from_json(entry, file.path, place, called=_CALLED))
    return in_metres(cameras, file.json.get("units", "cm"), file.path, kind, 'write "units": "mm" beside "cameras"')


PANOPTIC = CameraFormat("CMU Panoptic JSON", _is_panoptic, _read, lambda _: "-y")
