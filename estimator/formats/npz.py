"""The arrays of an .npz file that anybody may have written."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from estimator.formats.packing import valid_text
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
        what = str(error) or type(error).__name__
        raise InputError(path, f"cannot be read: {what}", remedy="an .npz of plain arrays is needed") from None
    for name, array in arrays.items():
        if not valid_text(array):
            raise InputError(path, "has characters that are none", place=name)
    return arrays
