"""C3D files (c3d.org), the exchange format of motion capture laboratories: parameters, and points over time.

The format is that of the C3D User Guide (Motion Lab Systems, c3d.org). Files of any processor are read by a strict
reader of our own: ezc3d (B. Michaud and M. Begon, Journal of Open Source Software 6(58), 2021), by which files are
written, ends the process or never returns on some that are damaged.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.markers import of_one_person
from estimator.data.formats.opensim import MarkerFile, frame_rate, metres_in, unit_of, upright_world
from humanoid.support.errors import InputError
from humanoid.support.extras import optional
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


_MILLIMETRES = 1e3
_CHANNELS = ("ANGLES", "SCALARS", "FORCES", "MOMENTS", "POWERS", "REACTIONS")  # lists of labels that are not points
_MOST_LABELS = 255  # of one parameter; what follows goes to LABELS2, LABELS3, ...


class Channels(NamedTuple):
    """Values over time beside the points. names (N), values (T, N): in `unit`, NaN where missing."""

    names: Sequence[str]
    values: np.ndarray
    unit: str


def write_c3d(
    path: Path, names: Sequence[str], points: np.ndarray, time: np.ndarray, angles: Channels, scalars: Channels
) -> None:
    """Write points (T, L, 3) of the z-up world [m] in millimetres, and channels as their own kinds of points.

    As in capture software, a channel is a point whose x is the value, listed under POINT:ANGLES or POINT:SCALARS with
    its unit in POINT:ANGLE_UNITS or POINT:SCALAR_UNITS. What is missing (NaN) has the residual -1, else it is 0.
    Numbers are in single precision. time (T,) [s]: frames count as evenly spaced.

    Raises
    ------
    InputError: ezc3d is not installed.
    """
    ezc3d = optional("ezc3d", "c3d", "c3d files")
    labels = [*names, *angles.names, *scalars.names]
    values = np.concatenate([_MILLIMETRES * points, _as_points(angles), _as_points(scalars)], axis=1)
    missing = np.isnan(values).any(axis=2)
    file = ezc3d.c3d()
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = np.array([frame_rate(time)])
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    for i in range(0, len(labels), _MOST_LABELS):
        key = f"LABELS{i // _MOST_LABELS + 1 if i else ''}"
        if key in parameters["POINT"]:
            parameters["POINT"][key]["value"] = labels[i : i + _MOST_LABELS]
        else:
            file.add_parameter("POINT", key, labels[i : i + _MOST_LABELS])
    for key, channels, unit in (("ANGLES", angles, "ANGLE_UNITS"), ("SCALARS", scalars, "SCALAR_UNITS")):
        if channels.names:
            file.add_parameter("POINT", key, list(channels.names))
            file.add_parameter("POINT", unit, [channels.unit])
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])  # z points up
    data: Any = file["data"]
    homogeneous = np.concatenate([np.where(missing[..., None], 0.0, values), np.ones((*missing.shape, 1))], axis=2)
    data["points"] = homogeneous.transpose(2, 1, 0)
    data["meta_points"]["residuals"] = np.where(missing, -1.0, 0.0).T[None]
    beside = path.with_name(path.name + ".c3d")  # ezc3d puts the ending to a name without it
    try:
        file.write(str(beside))
        os.replace(beside, path)
    finally:
        with suppress(OSError):
            beside.unlink()


def _as_points(channels: Channels) -> np.ndarray:
    """(T, N, 3): x is the value."""
    values = channels.values[..., None]
    return np.concatenate([values, np.zeros_like(values), np.zeros_like(values)], axis=2)


def read_c3d(path: Path, up: str | None = None, unit: str | None = None, option: str = "") -> MarkerFile:
    """The points of a C3D file; those with a residual below 0 are missing, channels and unlabelled points are left out.

    up: the axis of its world that points up; by default that of POINT:Y_SCREEN, else z. unit: instead of the file's;
    option: by which a user gives it.

    Raises
    ------
    InputError: as `read_content`; no points, an unknown unit, or people of several names.
    """
    content = read_content(path)
    point, points = content.point, content.points
    labels = [str(label).strip() for key in _label_keys(point) for label in point[key]][: points.shape[1]]
    channels = {str(name).strip() for key in _CHANNELS for name in point.get(key, ())}
    kept = [i for i, label in enumerate(labels) if label and not label.startswith("*") and label not in channels]
    if not kept:
        raise InputError(path, "has no points with a name")
    said = unit_of(_word(point, "UNITS"))
    unit = said if unit is None else unit
    world = metres_in(unit, path, "POINT:UNITS", option) * points[:, kept]
    axis, notes = _up(point, up)
    count = np.arange(content.first, content.first + len(world))
    time = count / content.rate if content.rate > 0.0 else np.full(len(world), np.nan)
    names = of_one_person(path, [labels[i] for i in kept])
    return MarkerFile(
        names, world @ upright_world(axis).T, time, unit, notes, said_unit=said, said_up=_said_up(point),
        rate=content.rate if content.rate > 0.0 else np.nan,
        unnamed=points.shape[1] - len(kept) - len(channels.intersection(labels)),
    )  # fmt: skip


def _label_keys(point: Parameters) -> list[str]:
    """LABELS, LABELS2, LABELS3, ... as far as they go."""
    keys = [key for key in point if key.startswith("LABELS") and key[6:].isascii() and (key[6:] or "1").isdigit()]
    return sorted(keys, key=lambda key: int(key[6:] or "1"))


def _word(point: Parameters, key: str) -> str:
    return str(next(iter(point.get(key, ())), "")).strip()


def _said_up(point: Parameters) -> str | None:
    """The upward axis that the file declares."""
    said = _word(point, "Y_SCREEN").lower().lstrip("+")
    return said if said in UPS else None


def _up(point: Parameters, up: str | None) -> tuple[str, tuple[str, ...]]:
    """The axis that points up, and a note where it is not declared."""
    axis = up or _said_up(point)
    if axis is not None:
        return axis, ()
    return "z", (
        "the c3d does not declare which axis points up (POINT:Y_SCREEN): z is assumed; give another with --up",
    )
