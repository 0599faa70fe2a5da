"""The arrays of an .npz file that anybody may have written."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from estimator.data.formats.packing import valid_text
from humanoid.support.errors import InputError

_MOST_BYTES = 400_000_000  # of all arrays together, unpacked: hours of landmarks


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays by name; nothing in the file is run.

    Raises
    ------
    InputError: it is no .npz, is damaged, has objects in it, or unpacks to more than 400 MB.
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
            raise InputError(path, "has characters that are none", place=name)
    return arrays


def read_npy(path: Path) -> np.ndarray:
    """The array of an .npy file; nothing in the file is run.

    Raises
    ------
    InputError: it is no .npy, is cut short, has objects in it, or has more than 400 MB.
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
    return InputError(path, f"cannot be read: {what}", remedy="plain arrays of NumPy are needed")
