"""Content of a C3D file: parameters, and points over time; of any processor, as whole numbers or floating point.

The format is that of the C3D User Guide (Motion Lab Systems, c3d.org). Read by a strict reader of our own: ezc3d, by
which such files are written, ends the process or never returns on some that are damaged.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from humanoid.support.errors import InputError
from humanoid.support.files import read_bytes

_BLOCK = 512
_KEY = 80
_MOST_BYTES = 2_000_000_000
_INTEL, _DEC, _MIPS = 84, 85, 86
_TYPES = {-1: 1, 1: 1, 2: 2, 4: 4}  # bytes of a value; -1 is a character

Parameters = dict[str, list[str] | list[float]]


class C3dContent(NamedTuple):
    """points (T, N, 3): in the file's unit and world, NaN where the residual is below 0. point: the parameters of the
    group POINT. first: number of the first frame, from 0 on. rate: frames per second."""

    points: np.ndarray
    point: Parameters
    first: int
    rate: float


class _Bytes:
    """The file's bytes, read in the order and the floating point of the processor that wrote them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path, most=_MOST_BYTES)
        self.processor = _INTEL

    def piece(self, start: int, size: int, what: str) -> bytes:
        """Bytes of something; raises InputError where the file ends before."""
        if start + size > len(self.data):
            raise InputError(self.path, f"ends within its {what}", remedy="write or copy it again")
        return self.data[start : start + size]

    def numbers(self, start: int, count: int, kind: str, what: str) -> np.ndarray:
        """float64 of numbers of one kind: i1, i2, u2 or f4."""
        content = self.piece(start, count * int(kind[1]), what)
        with np.errstate(invalid="ignore"):  # any bytes may be a signalling NaN
            if kind == "f4" and self.processor == _DEC:  # words the other way round, exponents larger by 2
                swapped = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1].tobytes()
                return np.frombuffer(swapped, "<f4").astype(np.float64) / 4.0
            order = ">" if self.processor == _MIPS else "<"
            return np.frombuffer(content, order + kind).astype(np.float64)

    def whole(self, start: int, kind: str = "u2") -> int:
        """One whole number of the header or of the parameters."""
        return int(self.numbers(start, 1, kind, "parameters")[0])


def read_content(path: Path) -> C3dContent:
    """Read a C3D file.

    Raises
    ------
    InputError: it is not one, is truncated, or contradicts itself.
    """
    file = _Bytes(path)
    if file.data[1:2] != bytes([_KEY]) or file.data[0] == 0:
        raise InputError(path, "does not start with a C3D header")
    section = _BLOCK * (file.data[0] - 1)
    file.processor = file.piece(section, 4, "parameters")[3]
    if file.processor not in (_INTEL, _DEC, _MIPS):
        raise InputError(
            path, f"has the unknown processor type {file.processor}", remedy=f"{_INTEL} to {_MIPS} are known"
        )
    groups = _groups(file, section + 4)
    point = groups.get("POINT", {})
    count, analog, first, last = (file.whole(2 * word) for word in (1, 2, 3, 4))
    first, frames = _frames(groups.get("TRIAL", {}), first, last)
    used = point.get("USED", [count])
    if used != [count]:
        raise InputError(path, f"has {count} points by its header, {used} by POINT:USED")
    scale, rate = (float(file.numbers(at, 1, "f4", "header")[0]) for at in (12, 20))
    if not (math.isfinite(scale) and math.isfinite(rate) and scale != 0.0 and frames > 0):
        raise InputError(path, f"has a scale of {scale:g}, a rate of {rate:g} and {frames} frames", place="header")
    start, width = _BLOCK * (file.whole(16) - 1), 4 * count + analog
    kind = "f4" if scale < 0.0 else "i2"
    if start < _BLOCK:
        raise InputError(path, "does not declare where its points begin", place="header")
    values = file.numbers(start, frames * width, kind, f"{frames} frames").reshape(frames, width)
    rows = values[:, : 4 * count].reshape(frames, count, 4)
    points = rows[..., :3] * (1.0 if kind == "f4" else scale)
    return C3dContent(np.where(rows[..., 3:] < 0.0, np.nan, points), point, max(first - 1, 0), rate)


def _frames(trial: Parameters, first: int, last: int) -> tuple[int, int]:
    """Number of the first frame, and the number of frames; past 65535 they are in two words of the group TRIAL."""
    ends = [trial.get(f"ACTUAL_{end}_FIELD", []) for end in ("START", "END")]
    if all(len(words) == 2 and not isinstance(words[0], str) for words in ends):
        first, last = (int(float(low) % 65536 + 65536 * (float(high) % 65536)) for low, high in ends)
    return first, last - first + 1


def _groups(file: _Bytes, at: int) -> dict[str, Parameters]:
    """The parameters of every group, all in capitals."""
    names: dict[int, str] = {}
    parameters: list[tuple[int, str, list[str] | list[float]]] = []
    while length := abs(file.whole(at, "i1")):
        group = file.whole(at + 1, "i1")
        name = _text(file.piece(at + 2, length, "parameters")).upper()
        step = file.whole(at + 2 + length)
        if group < 0:
            names[-group] = name
        elif group > 0:
            parameters.append((group, name, _value(file, at + length + 4)))
        if step == 0:
            break
        at += 2 + length + step
    groups: dict[str, Parameters] = {}
    for group, name, value in parameters:
        groups.setdefault(names.get(group, ""), {})[name] = value
    return groups


def _value(file: _Bytes, at: int) -> list[str] | list[float]:
    """The numbers or texts of a parameter."""
    kind, axes = file.whole(at, "i1"), file.piece(at + 1, 1, "parameters")[0]
    sizes = list(file.piece(at + 2, axes, "parameters"))
    if kind not in _TYPES:
        raise InputError(file.path, f"has a parameter of the unknown type {kind}", remedy="write it again")
    start, count = at + 2 + axes, math.prod(sizes)
    if kind != -1:
        return file.numbers(start, count, {1: "i1", 2: "i2", 4: "f4"}[kind], "parameters").tolist()
    content = file.piece(start, count, "parameters")
    width = sizes[0] if sizes else 1
    return [_text(content[i : i + width]) for i in range(0, count, width)] if width else []


def _text(content: bytes) -> str:
    """Text in ASCII or UTF-8, else in the older code page."""
    try:
        return content.decode("utf-8").strip(" \0")
    except UnicodeDecodeError:
        return content.decode("latin-1").strip(" \0")
