"""Reference motions to compare a run with."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.formats.opensim import frame_rate, read_trc
from humanoid.errors import InputError
from humanoid.landmarks import landmark_name

_KEYS = (("landmarks", "landmark_names"), ("points", "names"))


def load_reference(path: str | Path) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Landmark names (L), points (T, L, 3) in the world [m], NaN where missing, and frames per second.

    Reads kinemode's own npz export, an npz with `points`, `names` and `fps`, and TRC. Names of other programs become
    landmark names where there is one, and stay as they are otherwise.

    Raises
    ------
    InputError: missing, of another kind, or with arrays of the wrong shape.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "no such file")
    if path.suffix.lower() == ".trc":
        names, points, time = read_trc(path)
        return _named(names), points, frame_rate(time)
    if path.suffix.lower() != ".npz":
        raise InputError(path, "is no reference", remedy="an .npz or .trc file is needed")
    return _npz(path)


def _npz(path: Path) -> tuple[tuple[str, ...], np.ndarray, float]:
    try:
        with np.load(path, allow_pickle=False) as file:
            keys = next((k for k in _KEYS if k[0] in file and k[1] in file), None)
            if keys is None:
                wanted = " or ".join(f"{a}, {b}" for a, b in _KEYS)
                raise InputError(path, "has no landmarks", remedy=f"arrays {wanted}; found {', '.join(file.files)}")
            points, names = np.asarray(file[keys[0]], dtype=np.float64), [str(n) for n in file[keys[1]]]
            fps = float(file["fps"]) if "fps" in file else frame_rate(file["time"] if "time" in file else np.zeros(0))
    except InputError:
        raise
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(path, f"cannot be read: {error}") from None
    if points.ndim != 3 or points.shape[1:] != (len(names), 3):
        problem = f"{len(names)} names do not fit an array of shape {points.shape}"
        raise InputError(path, problem, place=keys[0], remedy="(frames, names, 3) is needed")
    if not np.isfinite(fps) or fps <= 0.0:
        raise InputError(path, "a positive number is needed", place="fps")
    return _named(names), points, fps


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(landmark_name(name) or name for name in names)
