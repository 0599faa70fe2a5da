"""Motions that a body is to follow, from files of every kind and from runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from estimator.data.formats.markers import named_points
from estimator.data.formats.npz import read_npz
from estimator.data.formats.opensim import METRES, checked_unit
from estimator.data.formats.point_arrays import checked_rate
from estimator.data.markers.load import load_points
from estimator.retargeting.joint_arrays import ARRAYS, has_joints, load_joints
from estimator.retargeting.motion import SourceHypotheses
from estimator.retargeting.source import SourceMotion
from estimator.synthesis.mocap import load_mocap
from humanoid.subject.landmarks import landmark_name
from humanoid.support.errors import InputError, first_of, misplaced
from humanoid.support.plugins import Registry

if TYPE_CHECKING:
    from estimator.runs.run_reader import Run
    from kinemode.named import PathLike

_BVH_NAMES = {"left_toe": "left_big_toe", "right_toe": "right_big_toe", "head_base": "head"}
_POINTS, _RUN, _ARRAYS = (".trc", ".c3d", ".csv", ".npz"), ".run", ".npz"
_KINDS = "a run (.run), BVH (.bvh), points (.trc, .c3d, .csv, .npz) or joints in a known order (.npz)"
_FEWEST = 6  # landmarks, where a file has other points too
_OWN = "of a run is known"


class SourceOptions(NamedTuple):
    """Values that a file lacks. fps: frames per second, instead of the file's where both are there. up: the axis that
    points up, one of `UPS`. unit: of length, m, cm or mm. layout: the order of joints without names, one of
    `estimator.retargeting.joint_orders.ORDERS`."""

    fps: float | None = None
    up: str | None = None
    unit: str | None = None
    layout: str | None = None


NOTHING_GIVEN = SourceOptions()


@dataclass(frozen=True)
class MotionFormat:
    """A kind of file with a motion to follow; `register` adds one.

    recognises: whether a path is of this kind. read: the motion in it, in metres, z up.
    """

    name: str
    recognises: Callable[[Path], bool]
    read: Callable[[Path, SourceOptions], SourceMotion]


def load_source(source: PathLike | Run | SourceMotion, given: SourceOptions = NOTHING_GIVEN) -> SourceMotion:
    """The motion in a file, or in a run: its drawn trajectory, which is the smoothed one of a complete run.

    A motion that was read already is unchanged.

    Raises
    ------
    InputError: another kind of file, no such file, a damaged one; no landmark that is known, or markers, which are to
        be tracked first; frames per second, axis or unit that are not known, or that are given for a run; joints that
        fit no known order, or several; an order of joints that have names.
    """
    if isinstance(source, SourceMotion):
        _without_layout(given)
        return source
    if not isinstance(source, (str, Path)):
        if not hasattr(source, "landmarks"):
            raise misplaced("source", source, _KINDS)
        _without_layout(given)
        return _of_run(source, given)
    path = Path(source)
    kind = next((kind for kind in MOTION_FORMATS.values() if kind.recognises(path)), None)
    if kind is None:
        raise InputError(path, "is not a motion file", remedy=f"give {_KINDS}")
    if not path.is_file():
        raise InputError(path, "no such file")
    return kind.read(path, given)


def _without_layout(given: SourceOptions) -> None:
    """Raise InputError for an order of joints of a source that has names."""
    if given.layout is not None:
        remedy = f"leave it out; it is for an npz of {', '.join(ARRAYS)}"
        raise InputError("layout", "this source has names of its own", remedy=remedy)


def _of_arrays(path: Path, given: SourceOptions) -> SourceMotion:
    """Joints in a known order, or points with names, of an npz file."""
    arrays = read_npz(path)
    if has_joints(arrays):
        return load_joints(path, up=given.up, unit=given.unit, fps=given.fps, layout=given.layout)
    if not {"points", "landmarks"} & set(arrays):
        remedy = f"one of {', '.join(ARRAYS)} in a known order, or points and names; it has {', '.join(arrays)}"
        raise InputError(path, "has no joints and no points", remedy=remedy)
    return _of_points(path, given)


def _of_run_file(path: Path, given: SourceOptions) -> SourceMotion:
    from estimator.runs.run_reader import Run  # slow to import

    _without_layout(given)
    return _of_run(Run.open(path), given)


def _of_run(run: Run, given: SourceOptions) -> SourceMotion:
    """The landmarks of a run's trajectory."""
    for name, value in (("fps", given.fps), ("up", given.up), ("unit", given.unit)):
        if value is not None:
            raise InputError(name, _OWN, remedy="leave it out")
    if not len(run):
        raise InputError(run.file, "has no frame yet")
    points = run.landmarks
    notes = () if run.complete else (f"{run.file.name} is not complete: its trajectory is not smoothed",)
    return _checked(SourceMotion(run.body.landmark_names, points, run.time, run.file.name, notes))


def hypotheses_of(source: PathLike | Run | SourceMotion, count: int) -> SourceHypotheses:
    """The heaviest `count` hypotheses of every frame of a run, beside the one that its trajectory goes through.

    Raises InputError for another source, which has none.
    """
    from estimator.runs.run_reader import Run  # slow to import

    if isinstance(source, (str, Path)) and Path(source).suffix.lower() == _RUN:
        source = Run.open(source)
    if not isinstance(source, Run):
        raise InputError("modes", "only runs have several hypotheses", remedy="leave it out, or give a run")
    weights, landmarks, path = source.mode_weight, source.mode_landmarks, source.path
    points = np.full((len(weights), count, *landmarks.shape[2:]), np.nan)
    weight = np.zeros((len(weights), 1 + count))
    for t, own in enumerate(weights):
        known = [int(k) for k in np.argsort(-np.nan_to_num(own), kind="stable") if np.isfinite(own[k])]
        others = [k for k in known if k != path[t]][:count]
        weight[t, 0] = own[path[t]] if path[t] >= 0 else 1.0
        points[t, : len(others)], weight[t, 1 : 1 + len(others)] = landmarks[t, others], own[others]
    return SourceHypotheses(points, weight)


def _of_bvh(path: Path, given: SourceOptions) -> SourceMotion:
    """The joints of a BVH file by MotionBuilder's names."""
    _without_layout(given)
    fps, up, unit = given.fps, given.up, given.unit
    mocap = load_mocap(path, unit=None if unit is None else METRES[checked_unit(unit)], up=up)
    rate, notes = mocap.fps, list[str]()
    if fps is not None:
        rate = checked_rate("fps", fps)
        if abs(mocap.fps / rate - 1.0) > 0.02:
            notes.append(f"{path.name} has {mocap.fps:.4g} frames per second: --fps {rate:g} is taken")
    if unit is None:
        notes.append(f"{path.name}: its unit is taken to be {mocap.unit:.4g} m, by its kind or its legs' length")
    names = tuple(_BVH_NAMES.get(name, name) for name in mocap.names)
    return SourceMotion(names, mocap.points, np.arange(len(mocap.points)) / rate, path.name, tuple(notes))


def _of_points(path: Path, given: SourceOptions) -> SourceMotion:
    """Those points of a file that are landmarks by their names."""
    _without_layout(given)
    track = load_points(path, up=given.up, unit=given.unit, fps=given.fps)
    named = named_points(track.names, track.points)
    kept = [i for i, name in enumerate(named.names) if name == landmark_name(name)]
    others = [name for i, name in enumerate(named.names) if i not in kept]
    if not kept or (others and len(kept) < _FEWEST):
        problem = f"has no landmarks to follow but markers: {first_of(others, 6)}"
        if kept:
            problem = f"has too few landmarks ({first_of([named.names[i] for i in kept], 6)}) among markers"
        remedy = f"markers are tracked first: kinemode track --points {path.name}, then the run is retargeted"
        raise InputError(path, problem, remedy=remedy)
    notes = (*track.notes, f"{path.name}: no landmarks, left out: {first_of(others, 6)}") if others else track.notes
    names = tuple(named.names[i] for i in kept)
    return _checked(SourceMotion(names, named.points[:, kept], track.time, path.name, notes))


def _checked(motion: SourceMotion) -> SourceMotion:
    """The motion; raises InputError where it has no landmark that is known in any frame."""
    if not np.isfinite(motion.points).all(axis=2).any():
        raise InputError(motion.source, "has no landmark that is known: all are NaN")
    return motion


def _ends_with(*endings: str) -> Callable[[Path], bool]:
    return lambda path: path.suffix.lower() in endings


MOTION_FORMATS: Registry[MotionFormat] = Registry(
    "motion format",
    (
        MotionFormat("run", _ends_with(_RUN), _of_run_file),
        MotionFormat("BVH", _ends_with(".bvh"), _of_bvh),
        MotionFormat("npz of joints or points", _ends_with(_ARRAYS), _of_arrays),
        MotionFormat("points", _ends_with(*_POINTS), _of_points),
    ),
)
"""All kinds by name; the first that recognises a file reads it."""
register = MOTION_FORMATS.register
