"""Points over time from a csv: three columns of every point, `NAME_x`, `NAME_y`, `NAME_z`, and one of time [s] or of
frames, or neither; units behind the names (`NAME_x_mm`) or in a line `# unit=mm` above them, as `# up=z`.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.number_table import TIMES, NumberTable, read_number_table
from estimator.data.formats.opensim import unit_of
from estimator.data.markers.track import PointFile
from humanoid.support.errors import InputError, first_of, shown

_FRAMES = ("frame", "frames", "frame#")
_COLUMN = re.compile(
    r"(?P<name>.*[^_.:\s])[_.:\s](?P<axis>[xyz])(?:[_\s]*[\[(]?(?P<unit>mm|cm|m|(?:milli|centi)?met(?:er|re)s?)[\])]?)?",
    re.IGNORECASE,
)
_COMMENT = re.compile(r"#\s*(?P<key>units?|up)\s*[=:]\s*(?P<value>\S+)\s*", re.IGNORECASE)


def read_point_table(path: Path) -> PointFile:
    """Read a csv with the columns NAME_x, NAME_y, NAME_z of every point (or NAME.x, NAME:X), and one of time [s]
    ("time_s", "time", "t", "seconds"), of frames ("frame") or of neither.

    Cells may be empty. Lines `# unit=mm` and `# up=z` above the names, and units behind them (NAME_x_mm), are used.
    Without times they are NaN, as is the rate, which is not given.

    Raises
    ------
    InputError: with the line; no table, points that lack an axis, or no points.
    """
    table = read_number_table(path)
    table.check()
    lower = [name.lower() for name in table.names]
    clock = next((i for names in (TIMES, _FRAMES) for i, name in enumerate(lower) if name in names), None)
    columns, unit, other = _columns(table)
    values = table.values
    points = np.stack([values[:, list(places)] for places in columns.values()], axis=1)
    said = _comments(table)
    if unit and said.get("unit", unit) != unit:
        raise InputError(path, f"columns are in {unit}, a comment declares {shown(said['unit'])}", place=table.place)
    counted = clock is None or lower[clock] in _FRAMES
    notes = (f"{path.name}: columns left out: {first_of(other, 8)}",) if other else ()
    time = np.full(len(points), np.nan) if counted else values[:, clock]
    if counted and clock is not None and not _even(values[:, clock]):
        problem = "the frames are not numbers one after the other"
        raise InputError(path, problem, place=f"column {table.names[clock]}", remedy="give a column of time instead")
    return PointFile(path, tuple(columns), points, time, unit or said.get("unit", ""), said.get("up"), notes=notes)


def _even(frames: np.ndarray) -> bool:
    return bool(np.isfinite(frames).all() and (np.diff(frames) == 1.0).all())


def _columns(table: NumberTable) -> tuple[dict[str, tuple[int, int, int]], str, list[str]]:
    """The columns x, y and z of every point, the unit in their names, and the columns that are of no point."""
    places: dict[str, dict[str, int]] = {}
    units: set[str] = set()
    other: list[str] = []
    for i, column in enumerate(table.names):
        part = _COLUMN.fullmatch(column)
        if part is None:
            other += [column] if column.lower() not in (*TIMES, *_FRAMES) else []
            continue
        of_point, axis = places.setdefault(part["name"].strip(), {}), part["axis"].lower()
        if axis in of_point:
            problem = f"has two columns {axis} of the point {shown(part['name'])}"
            raise InputError(table.path, problem, place=table.place, remedy="rename or drop one")
        of_point[axis] = i
        units |= {unit_of(part["unit"])} if part["unit"] else set()
    if not places:
        raise InputError(table.path, "has no points", place=table.place, remedy="columns NAME_x, NAME_y and NAME_z")
    for name, axes in places.items():
        missing = [axis for axis in "xyz" if axis not in axes]
        if missing:
            raise InputError(table.path, f"the point {shown(name)} has no column {missing[0]}", place=table.place)
    if len(units) > 1:
        problem = f"has columns in {' and '.join(sorted(units))}"
        raise InputError(table.path, problem, place=table.place, remedy="write them in one unit")
    return {name: (axes["x"], axes["y"], axes["z"]) for name, axes in places.items()}, next(iter(units), ""), other


def _comments(table: NumberTable) -> dict[str, str]:
    """unit and up, where the lines above the names have them."""
    parts = [part for comment in table.comments if (part := _COMMENT.fullmatch(comment))]
    said = {part["key"].lower().removesuffix("s"): part["value"].lower() for part in parts}
    said |= {"unit": unit_of(said["unit"])} if "unit" in said else {}
    if said.get("up", "z") not in UPS:
        problem = f"{shown(said['up'])} is not an axis"
        raise InputError(table.path, problem, place="comment up", remedy=f"one of {', '.join(UPS)}")
    return said
