"""A body's motion from a table of its joints over time."""

from __future__ import annotations

import numpy as np

from estimator.data.formats.angle_files import OF_EXPORTS, MotionTable
from estimator.runs.coordinates import JointEntry, joint_entries
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, nearest, shown

_UNITS = {"_rad": 1.0, "_deg": np.pi / 180.0, "_m": 1.0, "_cm": 0.01, "_mm": 1e-3}
_BEYOND = 1e-3  # rad or m by which a limit may be passed: what rounding in a file can do
_NO_ANGLE = 4.0 * np.pi
_NORM = 1e-2  # tolerance of a quaternion's norm


def motion_of(body: Body, table: MotionTable, times: np.ndarray) -> np.ndarray:
    """Configurations (K, nq) at times (K,) [s] from the table's first row on, straight from row to row.

    Columns are named after the entries of q (`Body.q_names`), with or without a unit behind them: _rad (which counts
    where there is none), _deg, _m, _cm, _mm; joints that turn without limits also by their angle. Joints without a
    column stay at rest, a free root too. Columns that exports have beside q are ignored. Rows without any number are
    left out.

    Raises
    ------
    InputError: a column of no joint (with the nearest names), a missing cell, a value outside its limits, a root that
        is given in part.
    """
    columns = _columns(body, table)
    kept = np.isfinite(table.values[:, list(columns.values())]).any(axis=1)
    if not kept.any():
        raise InputError(table.source, "has no row with a pose")
    rows = np.flatnonzero(kept)
    q = np.tile(body.neutral, (len(rows), 1))
    endless = {joint.start for joint in joint_entries(body) if joint.kind == "endless"}
    for entry, column in columns.items():
        values = _scaled(table, column)[rows]
        if entry in endless and _bare(table.names[column]) not in body.q_names:  # an angle
            q[:, entry], q[:, entry + 1] = np.cos(values), np.sin(values)
        else:
            q[:, entry] = values
    if not np.isfinite(q).all():
        row, entry = np.argwhere(~np.isfinite(q))[0]
        raise InputError(table.source, f"{body.q_names[entry]} has no number", place=_place(table, rows[row]))
    _check(body, table, q, rows)
    return _at(body, q, table.time[rows] - table.time[rows[0]], times)


def _columns(body: Body, table: MotionTable) -> dict[int, int]:
    """The table's column of each entry of q that it has."""
    angles = {joint.name: joint.start for joint in joint_entries(body) if joint.kind == "endless"}
    entry_of = {**{name: i for i, name in enumerate(body.q_names)}, **angles}
    following = {joint.name for joint in joint_entries(body) if joint.follows}
    columns: dict[int, int] = {}
    landmarks = {f"{name}_{axis}_m" for name in body.landmark_names for axis in "xyz"}
    for column, name in enumerate(table.names):
        bare = _bare(name)
        entry = entry_of.get(name, entry_of.get(bare))
        if entry is not None and entry in columns:
            raise InputError(table.source, f"{shown(bare)} appears twice", place=f"column {shown(name)}")
        if entry is not None:
            columns[entry] = column
        elif name not in landmarks and bare not in following and not OF_EXPORTS.fullmatch(name):
            raise InputError(
                table.source, f"the subject has no joint {shown(bare)}", remedy=nearest(bare, body.q_names, "joints")
            )
    if not columns:
        raise InputError(table.source, "has no joint of the subject", remedy=f"joints: {', '.join(body.q_names)}")
    for joint in joint_entries(body):
        there = [k in columns for k in range(joint.start, joint.start + joint.count)]
        if joint.name in angles and there[0] and _bare(table.names[columns[joint.start]]) == joint.name:
            if there[1]:
                raise InputError(table.source, f"{shown(joint.name)} appears twice", remedy="its angle, or cos and sin")
            continue
        if any(there) and not all(there):
            missing = body.q_names[joint.start + there.index(False)]
            raise InputError(table.source, f"has no column {missing}", remedy=f"all of {joint.name}, or none")
    return columns


def _bare(name: str) -> str:
    return next((name.removesuffix(unit) for unit in _UNITS if name.endswith(unit)), name)


def _scaled(table: MotionTable, column: int) -> np.ndarray:
    name = table.names[column]
    return table.values[:, column] * next((factor for unit, factor in _UNITS.items() if name.endswith(unit)), 1.0)


def _place(table: MotionTable, row: int) -> str:
    return f"at {table.time[row]:g} s"


def _check(body: Body, table: MotionTable, q: np.ndarray, rows: np.ndarray) -> None:
    """Raise InputError for configurations outside the limits; correct rounding errors of limits and unit length."""
    for joint in joint_entries(body):
        part = slice(joint.start, joint.start + joint.count)
        if joint.kind in ("turn", "slide"):
            _check_limits(body, table, q[:, joint.start], joint, rows)
            continue
        turn = slice(joint.start + 3, joint.start + 7) if joint.kind == "free" else part
        length = np.linalg.norm(q[:, turn], axis=1)
        if (np.abs(length - 1.0) > _NORM).any() and joint.kind in ("free", "endless"):
            row = rows[int(np.abs(length - 1.0).argmax())]
            problem = f"{', '.join(body.q_names[turn])} have the length {length[np.abs(length - 1.0).argmax()]:g}"
            raise InputError(table.source, problem, place=_place(table, row), remedy="1 is needed")
        if joint.kind in ("free", "endless"):
            q[:, turn] /= length[:, None]
    q[:] = [body.clamp(pose) for pose in q]


def _check_limits(body: Body, table: MotionTable, values: np.ndarray, joint: JointEntry, rows: np.ndarray) -> None:
    low, high = body.lower[joint.start], body.upper[joint.start]
    beyond = np.maximum(low - values, values - high)
    worst = int(beyond.argmax())
    if beyond[worst] > _BEYOND:
        unit = "m" if joint.kind == "slide" else "rad"
        degrees = unit == "rad" and f"{joint.name}_deg" not in table.names and abs(values[worst]) > _NO_ANGLE
        remedy = f"degrees? call the column {joint.name}_deg" if degrees else f"{low:.4g} to {high:.4g} {unit}"
        problem = f"{joint.name} is {values[worst]:.4g} {unit}, outside its limits"
        raise InputError(table.source, problem, place=_place(table, rows[worst]), remedy=remedy)


def _at(body: Body, q: np.ndarray, own: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Poses at times (K,), between those at `own` (T,)."""
    if len(own) == 1:
        return np.repeat(q, len(times), axis=0)
    before = np.clip(np.searchsorted(own, times, side="right") - 1, 0, len(own) - 2)
    share = np.clip((times - own[before]) / (own[before + 1] - own[before]), 0.0, 1.0)
    return body.interpolated(q[before], q[before + 1], share)
