"""OpenSim's file formats: markers (.trc) and coordinates (.mot, .sto).

OpenSim's ground is y up: x forward, y up, z to the right. A point of kinemode's world (z up: x forward, y left) goes to
(x, z, -y).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import axis_of, world_with_up
from estimator.data.formats.checked_json import read_text
from humanoid.support.errors import InputError, shown

R_OPENSIM_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Metres in each unit of length that is read."""
_UNIT_WORD = re.compile(r"(?P<part>milli|centi|)met(?:er|re)s?")
_PARTS = {"milli": "mm", "centi": "cm", "": "m"}
_HEADER_LINES = 5
_MOST = 1e10  # millimetres, or seconds


def write_trc(path: Path, names: Sequence[str], points: np.ndarray, time: np.ndarray, *, title: str = "") -> None:
    """Write points (T, L, 3) of the world [m] as markers in millimetres, y up; missing ones are left empty."""
    rate, count = f"{frame_rate(time):.6g}", str(len(points))
    head = [
        ["PathFileType", "4", "(X/Y/Z)", title or path.name],
        [
            "DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
            "OrigNumFrames",
        ],
        [rate, rate, count, str(len(names)), "mm", rate, "1", count],
        ["Frame#", "Time", *(cell for name in names for cell in (name, "", ""))],
        ["", "", *(f"{axis}{i + 1}" for i in range(len(names)) for axis in "XYZ")],
        [],
    ]  # fmt: skip
    values = (1e3 * points @ R_OPENSIM_WORLD.T).reshape(len(points), 3 * len(names))
    rows = [
        [str(i + 1), f"{t:.6f}", *("" if np.isnan(v) else f"{v:.4f}" for v in row)]
        for i, (t, row) in enumerate(zip(time, values, strict=True))
    ]
    for row in rows:  # OpenSim does not count an empty cell that no tab follows, and refuses the file
        row += [""] if row[-1] == "" else []
    path.write_text("\n".join("\t".join(row) for row in head + rows) + "\n", encoding="utf-8")


class MarkerFile(NamedTuple):
    """A file of markers. names (L). points (T, L, 3): in the z-up world [m], NaN where missing. time (T,) [s].
    unit: by which it was read. notes: remarks. said_unit, said_up, rate: the file's declared unit, upward axis and
    frames per second; empty, None and NaN where missing. frames: their declared number, -1 where missing. unnamed:
    number of its points without a name."""

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray
    unit: str
    notes: tuple[str, ...] = ()
    said_unit: str = ""
    said_up: str | None = None
    rate: float = np.nan
    frames: int = -1
    unnamed: int = 0


def unit_of(word: str) -> str:
    """The key of `METRES` that a file's or a user's word for a unit means, as "Meters", " MM" or "[millimetres]"; any
    other word in lower case."""
    plain = word.strip(" \t\r\n\0[]()\"'.").lower()
    spelled = _UNIT_WORD.fullmatch(plain)
    return _PARTS[spelled["part"]] if spelled else plain


def checked_unit(unit: str) -> str:
    """A unit of length as a key of `METRES`; raises InputError for another word."""
    known = unit_of(unit)
    if known not in METRES:
        raise InputError("unit", f"{shown(unit)} is not a unit of length", remedy=f"one of {', '.join(METRES)}")
    return known


def metres_in(unit: str, path: str | Path, place: str, option: str = "") -> float:
    """Metres in a unit of length, a key of `METRES`; raises InputError for one that is not read. option: what else may
    give the unit."""
    if unit not in METRES:
        problem = f"unknown unit {shown(unit)}" if unit else "has no unit of length"
        raise InputError(
            path, problem, place=place, remedy=f"one of {', '.join(METRES)}{option and f'; or {option} gives it'}"
        )
    return METRES[unit]


def upright_world(up: str) -> np.ndarray:
    """R_upright_world (3, 3): from a world in which one of `UPS` points up to one in which z does; y as OpenSim's."""
    return world_with_up(axis_of(up))


def read_trc(path: Path, up: str = "y", unit: str | None = None, option: str = "") -> MarkerFile:
    """The markers of a TRC file, in whose world `up` points up; unit: instead of the file's; option: by which a user
    gives it. Cells are separated by tabs, or by commas in lines without tabs.

    Raises
    ------
    InputError: with the line; not a TRC file, no markers, an unknown unit, or a cell that is not a number.
    """
    lines = read_text(path).splitlines()
    if len(lines) <= _HEADER_LINES or not lines[0].startswith("PathFileType"):
        raise InputError(path, "is not a TRC file", place="line 1")
    header = dict(zip(_header_cells(lines[1].lower()), _header_cells(lines[2]), strict=False))
    said = unit_of(header.get("units", ""))
    metres = metres_in(said if unit is None else unit, path, "line 3, Units", option)
    names = tuple(cell.strip() for cell in _cells(lines[3])[2:] if cell.strip())
    if not names:
        raise InputError(path, "has no markers", place="line 4")
    rows = [
        _trc_row(line, 3 * len(names) + 2, path, number)
        for number, line in enumerate(lines[_HEADER_LINES:], _HEADER_LINES + 1)
        if line.strip(" \t,")
    ]
    values = np.array(rows).reshape(-1, 3 * len(names) + 2)
    points = values[:, 2:].reshape(-1, len(names), 3) * metres
    rate, frames = _said_number(header, "datarate"), _said_number(header, "numframes")
    return MarkerFile(
        names, points @ upright_world(up).T, values[:, 1], said if unit is None else unit, said_unit=said, rate=rate,
        frames=-1 if np.isnan(frames) else int(frames),
    )  # fmt: skip


ROOT_NOTE = "A free root's x, z and y are along OpenSim's ground X, Y and -Z."


def write_mot(
    path: Path, names: Sequence[str], values: np.ndarray, time: np.ndarray, *, title: str, note: str = ROOT_NOTE
) -> None:
    """Write coordinates (T, N), angles in degrees and lengths in metres; note: a line about them."""
    units = "Units are S.I. units (second, meters, Newtons, ...)"
    lines = ("", units, "Angles are in degrees.", note, "")
    write_storage(path, names, values, time, title=title, in_degrees=True, lines=lines, style=".8f")


def write_storage(
    path: Path,
    names: Sequence[str],
    values: np.ndarray,
    time: np.ndarray,
    *,
    title: str,
    in_degrees: bool = False,
    lines: Sequence[str] = (),
    style: str = ".8g",
) -> None:
    """Write any columns (T, N) over time (T,) [s] as an OpenSim storage; lines: more of the header, style: of the
    numbers."""
    turns = "yes" if in_degrees else "no"
    head = [
        title, "version=1", f"nRows={len(values)}", f"nColumns={len(names) + 1}", f"inDegrees={turns}", *lines,
        "endheader", "\t".join(["time", *names]),
    ]  # fmt: skip
    rows = ["\t".join([f"{t:.6f}", *(f"{v:{style}}" for v in row)]) for t, row in zip(time, values, strict=True)]
    path.write_text("\n".join(head + rows) + "\n", encoding="utf-8")


class Coordinates(NamedTuple):
    """Joint coordinates over time: names (N), values (T, N), NaN where missing; turns are in radians or in degrees,
    None where the file does not declare it, lengths in metres."""

    names: tuple[str, ...]
    values: np.ndarray
    in_degrees: bool | None = False


_PATH = re.compile(r"/jointset/[^/]+/(?P<name>[^/]+)/value")


def coordinate_of_path(column: str) -> str | None:
    """The coordinate that a column is called by, whose path OpenSim 4 writes (`/jointset/hip_r/hip_flexion_r/value`);
    None of speeds and of everything else that has a path."""
    path = _PATH.fullmatch(column)
    return column if "/" not in column else path["name"] if path else None


def said_degrees(path: Path, lines: Sequence[str]) -> bool | None:
    """Whether angles are in degrees, by a header's line `inDegrees=yes` or `inDegrees=no`; None without one."""
    for number, line in enumerate(lines, 1):
        word, _, value = "".join(line.lower().split()).partition("=")
        if word == "indegrees":
            if value not in ("yes", "no"):
                raise InputError(path, f"inDegrees is {shown(value)}", place=f"line {number}", remedy="yes or no")
            return value == "yes"
    return None


def read_mot(path: Path) -> tuple[Coordinates, np.ndarray]:
    """The coordinates of a motion or storage file, and their times (T,) [s]; of OpenSim 4's states, the values of
    coordinates alone. Raises InputError where it is none."""
    lines = read_text(path).splitlines()
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None or end + 1 >= len(lines):
        raise InputError(path, "is not a motion file: it has no 'endheader' with column names after it")
    columns = lines[end + 1].split()
    if not columns or columns[0].lower() != "time":
        raise InputError(path, "its first column is not 'time'", place=f"line {end + 2}")
    rows = [
        _numbers(line.split(), len(columns), path, number)
        for number, line in enumerate(lines[end + 2 :], end + 3)
        if line.strip()
    ]
    values = np.array(rows).reshape(-1, len(columns))
    place: dict[str, int] = {}
    for k, column in enumerate(columns[1:], 1):
        name = coordinate_of_path(column)
        if name in place:
            raise InputError(path, f"the coordinate {shown(name)} appears twice", place=f"line {end + 2}")
        place |= {name: k} if name is not None else {}
    return Coordinates(tuple(place), values[:, list(place.values())], said_degrees(path, lines[:end])), values[:, 0]


def frame_rate(time: np.ndarray) -> float:
    """Frames per second of times (T,) [s]; 30 where there are fewer than two."""
    return float(1.0 / np.median(np.diff(time))) if len(time) > 1 else 30.0


def _said_number(header: Mapping[str, str], key: str) -> float:
    """A number of a header, NaN where it has no valid one."""
    try:
        value = float(header.get(key, ""))
    except ValueError:
        return np.nan
    return value if 0.0 < value < _MOST else np.nan


def _cells(line: str) -> list[str]:
    """The cells of a line of a TRC file."""
    return line.split("\t" if "\t" in line else ",")


def _header_cells(line: str) -> list[str]:
    """The words of a line of a TRC file's header, which some programs part by spaces."""
    return [word for cell in _cells(line) for word in cell.split()]


def _trc_row(line: str, count: int, path: Path, number: int) -> list[float]:
    cells = _cells(line)
    cells = [*cells, *[""] * (count - len(cells))]  # empty cells at the end are often cut off
    while len(cells) > count and not cells[-1].strip():
        cells.pop()
    return _numbers(cells, count, path, number)


def _numbers(cells: list[str], count: int, path: Path, number: int) -> list[float]:
    """The cells of a line, NaN where they are empty."""
    if len(cells) != count:
        raise InputError(path, f"has {len(cells)} columns, {count} are expected", place=f"line {number}")
    try:
        row = [float(cell) if cell.strip() else np.nan for cell in cells]
    except ValueError:
        raise InputError(path, "has a cell that is not a number", place=f"line {number}") from None
    if any(abs(value) > _MOST for value in row):
        raise InputError(path, "has a number too large", place=f"line {number}", remedy=f"up to {_MOST:g}")
    return row
