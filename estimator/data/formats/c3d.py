"""C3D files (c3d.org), the exchange format of motion capture laboratories, written by ezc3d.

B. Michaud and M. Begon, ezc3d: An easy C3D file I/O cross-platform solution, Journal of Open Source Software 6(58),
2021.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.c3d_content import Parameters, read_content
from estimator.data.formats.marker_names import of_one_person
from estimator.data.formats.opensim import MarkerFile, frame_rate, metres_in, unit_of, upright_world
from humanoid.support.errors import InputError
from humanoid.support.extras import optional

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
