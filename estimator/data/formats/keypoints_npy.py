"""Keypoints as arrays of NumPy: (T, K, 2) x, y [px] or (T, K, 3) with confidence, of several people (T, N, K, 2 or 3).

.npy: the array alone; the names are in a file beside it (`estimator.data.formats.keypoints_names`), or follow from K:
17, 18, 25, 26, 33, 133 or 136 of a known layout. .npz: `keypoints`, and optionally `scores` (T, K) or (T, N, K),
`names` (K), `fps` and `image_size` (width, height). NaN, and a confidence of 0, are missing points; a person who is NaN
throughout is absent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.data.formats.cameras_json import image_size
from estimator.data.formats.checked_json import LARGEST, check_members, number_between
from estimator.data.formats.keypoints_names import named_landmarks, naming_beside, places_of_names
from estimator.data.formats.keypoints_reading import (
    MOST_FRAMES,
    KeypointFile,
    KeypointFormat,
    Person,
    Reading,
    checked_names,
    cleaned,
)
from estimator.data.formats.npz import read_npy, read_npz
from estimator.data.media.clip import FPS_RANGE
from humanoid.support.errors import InputError

_SHAPES = "(T, K, 2), (T, K, 3), or of N people (T, N, K, 2) or (T, N, K, 3)"
_ARRAYS = ("keypoints", "scores", "names", "fps", "image_size")
_MOST_PEOPLE = 1000


def read_arrays(reading: Reading) -> None:
    """Read a .npy or .npz; nothing in it is run. Raises InputError naming the array, its shape, and the shapes that are
    read."""
    path = reading.source
    with path.open("rb") as file:
        alone = file.read(6) == b"\x93NUMPY"
    arrays = {"keypoints": read_npy(path)} if alone else read_npz(path)
    if "keypoints" not in arrays:
        remedy = "keypoints, and scores, names, fps, image_size where they are known"
        raise InputError(path, f"has no array 'keypoints' but {', '.join(arrays) or 'none'}", remedy=remedy)
    check_members(arrays, _ARRAYS, path, "", near=True)
    points = _points(arrays, path)
    _set_names(arrays, points.shape[2], reading)
    if "fps" in arrays:
        reading.fps = number_between(arrays["fps"].tolist(), *FPS_RANGE, path, "fps")
    if "image_size" in arrays:
        reading.image_size = image_size(arrays["image_size"].tolist(), path, "image_size")
    there = np.isfinite(points[..., 0]).any(axis=2)
    for t, people in enumerate(points):
        reading.add(t, [_person(people[n], reading, f"frame {t}, person {n}") for n in np.flatnonzero(there[t])])
    reading.count = len(points)


def _person(points: np.ndarray, reading: Reading, place: str) -> Person:
    return Person(cleaned(points, reading.notes, reading.source, place))


def _points(arrays: dict[str, np.ndarray], path: Path) -> np.ndarray:
    """All people's points (T, N, K, 3)."""
    keypoints = _numeric(arrays["keypoints"], path, "keypoints")
    shape = keypoints.shape
    if keypoints.ndim not in (3, 4) or shape[-1] not in (2, 3) or 0 in shape:
        raise InputError(path, f"has the shape {shape}", place="keypoints", remedy=f"read are {_SHAPES}")
    scores = _numeric(arrays["scores"], path, "scores") if "scores" in arrays else None
    if scores is not None and (shape[-1] == 3 or scores.shape != shape[:-1]):
        problem = f"has the shape {scores.shape} beside keypoints {shape}"
        raise InputError(path, problem, place="scores", remedy="one for each x, y")
    if shape[0] > MOST_FRAMES or (keypoints.ndim == 4 and shape[1] > _MOST_PEOPLE):
        raise InputError(path, f"has the shape {shape}, which is not that of a clip", place="keypoints")
    if shape[-1] == 2:
        sure = np.ones(shape[:-1]) if scores is None else scores
        keypoints = np.concatenate([keypoints, sure[..., None]], axis=-1)
    return keypoints if keypoints.ndim == 4 else keypoints[:, None]


def _numeric(array: np.ndarray, path: Path, place: str) -> np.ndarray:
    if array.dtype.kind not in "iuf":
        raise InputError(path, f"is of type {array.dtype.name}, numbers are needed", place=place)
    with np.errstate(over="ignore"):  # too large numbers are refused later
        return np.clip(array.astype(np.float64), -10.0 * LARGEST, 10.0 * LARGEST)


def _set_names(arrays: dict[str, np.ndarray], count: int, reading: Reading) -> None:
    path = reading.source
    naming = naming_beside(path)
    own = checked_names(arrays["names"].tolist(), path, "names") if "names" in arrays else naming.names
    if own is not None and reading.layout == "auto":
        if len(own) != count:
            where = path if "names" in arrays else naming.source or path
            raise InputError(where, f"has {len(own)} names, the keypoints are {count}", place="names")
        reading.layout, reading.names = "named", named_landmarks(own, reading)
        return
    try:
        reading.name_by_size(3 * count, path, "keypoints")
    except InputError as error:
        remedy = f"name them in {places_of_names(path)}; {error.remedy}"
        raise InputError(path, f"{count} keypoints fit no layout", place="keypoints", remedy=remedy) from None
    if len(reading.names) != count:
        raise InputError(path, f"{reading.layout} has {len(reading.names)} keypoints, found {count}", place="keypoints")


def _is_numpy(file: KeypointFile) -> bool:
    return file.start.startswith((b"\x93NUMPY", b"PK\x03\x04", b"PK\x05\x06"))


ARRAYS = KeypointFormat("npy and npz", _is_numpy, lambda file, reading: read_arrays(reading), of_json=False)
