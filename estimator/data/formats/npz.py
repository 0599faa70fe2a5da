"""Files of arrays: from untrusted sources, and our own with a header of JSON."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import mapping
from estimator.data.formats.packing import valid_text
from humanoid.support.errors import InputError
from humanoid.support.files import replacing

_MOST_BYTES = 400_000_000  # of all arrays together, unpacked: hours of landmarks


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays by name; nothing in the file is run.

    Raises
    ------
    InputError: it is not an .npz, is damaged, has objects in it, or unpacks to more than 400 MB.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _MOST_BYTES:
            raise InputError(path, f"unpacks to more than {_MOST_BYTES // 1_000_000} MB", remedy="give a smaller file")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except InputError:
        raise
    except Exception as error:  # zipfile, zlib and numpy's header parser let errors of any kind through
        raise _unreadable(path, error) from None
    for name, array in arrays.items():
        if not valid_text(array):
            raise InputError(path, "has invalid characters", place=name)
    return arrays


def write_headed(path: Path, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """A file for `read_headed`; raises InputError where it cannot be written.

    header: of numbers, texts, lists and objects, with the number of its `format`.
    """
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, header=np.array(json.dumps(header)), **arrays)  # type: ignore[arg-type]


def read_headed(
    path: Path, kind: str, number: int, needed: Collection[str], remedy: str
) -> tuple[dict[str, np.ndarray], Mapping[str, Any]]:
    """Arrays and header of a file by `write_headed`.

    kind: the required kind of file, for messages. number: of the format that is read. needed: arrays by which it is
    recognised.

    Raises
    ------
    InputError: as `read_npz`; it is not such a file, or one of another format.
    """
    arrays = read_npz(path)
    if not {"header", *needed} <= arrays.keys():
        raise InputError(path, f"is not {kind}", remedy=remedy)
    try:
        header = mapping(json.loads(str(arrays["header"])), path, "header")
    except json.JSONDecodeError:
        raise InputError(path, "is damaged: its header is not JSON", remedy=remedy) from None
    if header.get("format") != number:
        problem = f"is of format {str(header.get('format'))[:20]}, this kinemode reads {number}"
        raise InputError(path, problem, remedy=remedy)
    return arrays, header


def read_npy(path: Path) -> np.ndarray:
    """The array of an .npy file; nothing in the file is run.

    Raises
    ------
    InputError: it is not an .npy, is truncated, has objects in it, or has more than 400 MB.
    """
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise InputError(path, f"is larger than {_MOST_BYTES // 1_000_000} MB", remedy="give a smaller file")
        return np.array(np.load(path, mmap_mode="r", allow_pickle=False))  # mapped: a size that lies takes no memory
    except InputError:
        raise
    except Exception as error:  # as above
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> InputError:
    what = str(error) or type(error).__name__
    return InputError(path, f"cannot be read: {what}", remedy="plain NumPy arrays are needed")
