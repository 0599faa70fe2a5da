"""The formats that 2D keypoints come in, and a file read by the one that recognises it."""

from __future__ import annotations

from pathlib import Path

from estimator.data.formats.hdf5 import is_hdf5
from estimator.data.formats.keypoint_format import KeypointFile, KeypointFormat
from estimator.data.formats.keypoints_coco import COCO
from estimator.data.formats.keypoints_deeplabcut import DEEPLABCUT
from estimator.data.formats.keypoints_deeplabcut_h5 import DEEPLABCUT_H5
from estimator.data.formats.keypoints_mmpose import MMPOSE
from estimator.data.formats.keypoints_npy import ARRAYS
from estimator.data.formats.keypoints_openpose import ALPHAPOSE, OPENPOSE
from estimator.data.formats.keypoints_own import OWN
from estimator.data.formats.keypoints_reading import Reading
from estimator.data.formats.keypoints_rtmlib import RTMLIB
from estimator.data.formats.keypoints_sleap import SLEAP, refuse_hdf5
from estimator.data.formats.keypoints_ultralytics import ULTRALYTICS
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError
from humanoid.support.plugins import Registry

KEYPOINT_FORMATS: Registry[KeypointFormat] = Registry(
    "keypoint format",
    (ALPHAPOSE, OPENPOSE, MMPOSE, OWN, RTMLIB, COCO, ULTRALYTICS, DEEPLABCUT, DEEPLABCUT_H5, SLEAP, ARRAYS),
)
"""Formats that are read, by name; those registered last are tried first."""
register = KEYPOINT_FORMATS.register

_BEGINNINGS = {
    ".csv": "DeepLabCut's csv does, with 'scorer,'",
    **dict.fromkeys((".npy", ".npz"), "NumPy's files do"),
    **dict.fromkeys((".h5", ".hdf5", ".slp"), "HDF5 files do"),
}


def read_layout(path: Path, layout: str) -> Reading:
    """Read a keypoint file or folder of any registered format.

    Raises InputError where it is missing, no format recognises it, or `layout` is neither "auto" nor a key of
    `humanoid.subject.landmarks.FORMATS`.
    """
    if layout != "auto" and layout not in FORMATS:
        raise InputError(path, f"no layout {layout!r}", remedy=f"one of auto, {', '.join(FORMATS)}")
    if not path.exists():
        raise InputError(path, "no such file or folder")
    file, reading = KeypointFile(path), Reading(path, layout)
    _format_of(file).read(file, reading)
    return reading


def formats_read() -> str:
    """The error for a file of no known format."""
    return "read are " + ", ".join(KEYPOINT_FORMATS)


def _format_of(file: KeypointFile) -> KeypointFormat:
    """The format that recognises a file; raises InputError where none does."""
    known = [*reversed(list(KEYPOINT_FORMATS.values()))]
    by_start = next((f for f in known if not f.of_json and f.recognises(file)), None)
    if by_start is not None:
        return by_start
    _refuse_others(file)
    by_content = next((f for f in known if f.of_json and f.recognises(file)), None)
    if by_content is None:
        raise InputError(file.path, "is not a keypoint file of a known layout", remedy=formats_read())
    return by_content


def _refuse_others(file: KeypointFile) -> None:
    """Raise InputError for a file that is not JSON, by its ending and first bytes."""
    if is_hdf5(file.start):
        refuse_hdf5(file.path)
    begins = _BEGINNINGS.get(file.ending)
    if begins is not None and not file.is_folder:
        raise InputError(file.path, f"does not begin as {begins}", remedy=formats_read())
