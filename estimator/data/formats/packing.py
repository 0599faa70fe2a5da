"""Named arrays as bytes, without pickle and faster than a zip archive."""

from __future__ import annotations

import json
import math
import re
import struct
import sys
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

_START = struct.Struct("<II")  # length of the index, CRC-32 of everything after
_KIND = re.compile(r"[<>|=]?[biufcUS][0-9]{1,6}")
_MOST_AXES, _MOST_EMPTY = 8, 1_000_000


def pack(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Bytes of named arrays of plain types (numbers, booleans, text): a JSON index, then the data one by one."""
    index, data = [], []
    for name, array in arrays.items():
        a = np.ascontiguousarray(array).reshape(np.shape(array))
        if a.dtype.hasobject or a.dtype.kind == "V":
            raise TypeError(f"array {name!r} of type {a.dtype} cannot be stored")
        index.append([name, a.dtype.str, a.shape])
        data.append(a.tobytes())
    head = json.dumps(index).encode()
    body = b"".join([head, *data])
    return _START.pack(len(head), zlib.crc32(body)) + body


def unpack(blob: bytes) -> dict[str, np.ndarray]:
    """The arrays `pack` was given, bit by bit; they are read-only views of the bytes. ValueError for damaged bytes."""
    if not isinstance(blob, bytes) or len(blob) < _START.size:
        raise ValueError("too short")
    length, checksum = _START.unpack_from(blob)
    if zlib.crc32(memoryview(blob)[_START.size :]) != checksum:
        raise ValueError("its checksum does not fit")
    start = _START.size + length
    arrays: dict[str, np.ndarray] = {}
    for name, kind, shape in _index(blob[_START.size : start]):
        count = math.prod(shape)
        if start + kind.itemsize * count > len(blob):
            raise ValueError(f"array {name!r} is longer than its bytes")
        if kind.itemsize * count == 0:
            if max(shape, default=0) > _MOST_EMPTY or count > len(blob):  # text of no length counts, too
                raise ValueError(f"array {name!r} has an unlikely shape")
            arrays[name] = np.zeros(shape, kind)
        else:
            arrays[name] = np.frombuffer(blob, kind, count, start).reshape(shape)
        start += kind.itemsize * count
    return arrays


def _index(text: bytes) -> Iterator[tuple[str, np.dtype[Any], tuple[int, ...]]]:
    """Names, types and shapes of the arrays; ValueError where it is not an index."""
    try:
        entries = json.loads(text)
    except RecursionError:
        raise ValueError("its index is not a list") from None
    if not isinstance(entries, list):
        raise ValueError("its index is not a list")
    for entry in entries:
        if not (isinstance(entry, list) and len(entry) == 3 and isinstance(entry[0], str)):
            raise ValueError("its index has an invalid entry")
        name, kind, shape = entry
        if not (isinstance(kind, str) and _KIND.fullmatch(kind)):
            raise ValueError(f"array {name!r} has no plain type")
        try:
            dtype = np.dtype(kind)
        except TypeError:  # no number has three bytes
            raise ValueError(f"array {name!r} has no plain type") from None
        if not (isinstance(shape, list) and len(shape) <= _MOST_AXES and all(type(n) is int and n >= 0 for n in shape)):
            raise ValueError(f"array {name!r} has an unlikely shape")
        yield name, dtype, tuple(shape)


def valid_text(array: np.ndarray) -> bool:
    """Whether an array of text has nothing but characters: numpy takes any 32 bits for one, Python ends on them."""
    if array.size == 0 or array.dtype.kind != "U" or array.dtype.itemsize == 0:
        return True
    codes = np.frombuffer(np.ascontiguousarray(array).tobytes(), array.dtype.byteorder.replace("|", "=") + "u4")
    return bool((codes <= sys.maxunicode).all())
