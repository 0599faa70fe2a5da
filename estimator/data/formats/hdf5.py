"""HDF5 files from untrusted sources: data is read, and nothing in them is run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from humanoid.support.errors import InputError, first_of, shown

if TYPE_CHECKING:
    import h5py

_MOST_BYTES = 400_000_000  # of one array, unpacked: hours of keypoints
_STARTS = (b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file")
_MARKS = {  # pickle's instructions that only build lists, tuples, dictionaries, texts and numbers
    *("PROTO", "FRAME", "STOP", "MARK", "PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE", "GET", "BINGET", "LONG_BINGET"),
    *("NONE", "NEWTRUE", "NEWFALSE", "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "FLOAT", "BINFLOAT"),
    *("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "LIST", "EMPTY_LIST"),
    *("APPEND", "APPENDS", "TUPLE", "EMPTY_TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "DICT", "EMPTY_DICT", "SETITEM"),
    "SETITEMS",
}


def is_hdf5(start: bytes) -> bool:
    """Whether a file that starts so is HDF5, MATLAB's of version 7.3 too."""
    return start.startswith(_STARTS)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to read from. The library's errors on damaged content become InputErrors that name the file."""
    import h5py

    try:
        with h5py.File(path, "r", locking="best-effort") as file:
            yield file
    except InputError:
        raise
    except Exception as error:  # h5py lets errors of any kind through
        what = shown(str(error).strip() or type(error).__name__, 200)
        raise InputError(path, f"is a damaged HDF5 file: {what}", remedy="write or copy it again") from None


def array(group: h5py.Group, name: str, path: Path) -> np.ndarray:
    """A data set unchanged; raises InputError where it is missing, or unpacks to more than 400 MB."""
    import h5py

    data = group.get(name)
    if not isinstance(data, h5py.Dataset) or data.shape is None:
        raise InputError(path, f"has no data set {name!r} but {members(group)}")
    if data.size * data.dtype.itemsize > _MOST_BYTES:
        raise InputError(path, f"unpacks to more than {_MOST_BYTES // 1_000_000} MB", place=name)
    return np.asarray(data[()])


def numeric(values: np.ndarray, path: Path, place: str) -> np.ndarray:
    """Numbers as float64; raises InputError where they are not numbers."""
    if values.dtype.kind not in "iuf":
        raise InputError(path, f"is of type {shown(str(values.dtype))}, numbers are needed", place=place)
    return values.astype(np.float64)


def texts(values: np.ndarray, path: Path, place: str) -> tuple[str, ...]:
    """Texts of an array of one axis, of fixed length or not; raises InputError where they are not texts."""
    read = tuple(text(value) for value in values.tolist()) if values.ndim == 1 else (None,)
    if None in read:
        raise InputError(path, "a list of texts is needed", place=place)
    return tuple(str(value) for value in read)


def text(value: Any) -> str | None:
    """A text that is stored as bytes or text, None where it is neither."""
    if isinstance(value, bytes):
        try:
            return value.decode("utf-8")
        except UnicodeDecodeError:
            return None
    return value if isinstance(value, str) else None


def members(group: h5py.Group) -> str:
    """The members of a group, for messages."""
    return first_of([shown(name, 30) for name in group], 8) or "nothing"


def plain_pickle(value: Any, path: Path, place: str) -> Any:
    """The value of pickled bytes that contain only lists, tuples, dictionaries, texts and numbers.

    Nothing is executed or resolved by name: any other instruction is refused before it is read, as is a place in the
    memo beyond the bytes' own length, which would take memory. Raises InputError.
    """
    import io
    import pickle
    import pickletools

    class Plain(pickle.Unpickler):
        def find_class(self, module: str, name: str) -> Any:
            raise pickle.UnpicklingError(f"{module}.{name} is not read")

    try:
        data = bytes(value)
        for mark, argument, _ in pickletools.genops(data):
            if mark.name not in _MARKS or (mark.name.endswith("PUT") and int(argument or 0) > len(data)):
                raise pickle.UnpicklingError(f"{mark.name} is not read")
        return Plain(io.BytesIO(data), encoding="utf-8").load()
    except Exception as error:  # pickle lets errors of any kind through
        what = f"is not a plain list of names: {shown(str(error), 80)}"
        raise InputError(path, what, place=place) from None
