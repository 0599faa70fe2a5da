"""Points in space that a body is tracked from: markers, or keypoints that were triangulated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.formats.opensim import upright_world
from estimator.data.markers.load import load_points
from estimator.data.markers.swaps import mirrored_swaps
from estimator.data.markers.track import MarkerTrack
from estimator.data.observation import Observation
from humanoid.kinematics.body import Body
from humanoid.subject.marker_set import MarkerSet, marker_set
from humanoid.subject.marker_start import chosen_set, matching_set
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError, first_of
from kinemode.inputs.declared import known_floor, part, rates
from kinemode.inputs.load import Inputs
from kinemode.named import PathLike, named_paths
from kinemode.request import AUTO, POINTS, InputOptions

_SIDES = ("left_", "right_")  # links of limbs begin so
_FEWEST = 4  # markers that a subject and a file have to share
_LISTED = 12  # names in a message
_FEWEST_TRUNK = 4  # points of a frame; three lie in a plane, which a mirror maps to itself
_FRAMES = 200  # that are checked, spread over the file
_BETTER = 0.7  # residual of the mirrored fit over that of the other, from which on it counts


def load_point_inputs(subject: Subject, files: InputOptions) -> tuple[Subject, Inputs]:
    """The subject with its markers, and what there is to track.

    Raises InputError: files that cannot be read, names unknown to all sets, nothing between start and end.
    """
    paths = tuple(named_paths(files.points, POINTS).values())
    if not paths:
        raise InputError("points", "none given", remedy="a .trc, .c3d, .npz, .npy or .csv")
    track = load_points(paths, up=files.up, unit=files.unit, fps=_rate(files))
    marked = _marked(subject, files.markers, track)
    body = Body(marked.subject)
    rows = _rows(track, files)
    static, notes = _static(body, files, marked.pairs)
    inputs = Inputs(
        _observations(body, track, marked.pairs, rows), track.time[rows], (), (*track.notes, *marked.notes, *notes),
        R_upright_points=upright_world(track.up), floor=known_floor(files.floor), points=paths, static=static,
    )  # fmt: skip
    return marked.subject, inputs


def _observations(
    body: Body, track: MarkerTrack, pairs: Sequence[tuple[str, str]], rows: np.ndarray
) -> list[Observation]:
    """Frames of a file, those of `rows`, with a body's markers; a marker that the file has not is missing.

    Raises InputError: mirrored markers.
    """
    track, _ = mirrored_swaps(track, pairs)
    points = np.full((len(track.time), len(body.marker_names), 3), np.nan)
    for i, name in enumerate(body.marker_names):
        if name in track.names:
            points[:, i] = track.points[:, track.names.index(name)]
    _check_hand(body, points, track.source)
    L = len(body.landmark_names)
    nowhere = np.zeros((0, L, 2)), np.zeros((0, L))
    return [Observation(i, float(track.time[t]), (), *nowhere, markers=points[t]) for i, t in enumerate(rows)]


def _static(
    body: Body, files: InputOptions, pairs: Sequence[tuple[str, str]]
) -> tuple[tuple[Observation, ...], tuple[str, ...]]:
    """All frames of the static trial, and notes; nothing where there is none.

    Raises InputError: files that cannot be read, or that have none of the body's markers in any frame.
    """
    if not files.static:
        return (), ()
    paths = list(named_paths(files.static, POINTS).values())
    track = load_points(paths, up=files.up, unit=files.unit, fps=_rate(files))
    observations = _observations(body, track, pairs, np.arange(len(track.time)))
    if max(len(o.known_markers) for o in observations) < _FEWEST:
        problem = f"no frame has {_FEWEST} of the markers that are tracked"
        raise InputError(track.source, problem, remedy="give the static trial of the same markers")
    others = [name for name in track.names if name not in body.marker_names]
    notes = (f"markers of the static trial alone are left out: {first_of(others, _LISTED)}",) if others else ()
    return tuple(observations), (*track.notes, *notes)


def _rate(files: InputOptions) -> float | None:
    """Frames per second, where the user gives them."""
    return rates(files.fps, ["points"]).get("points")


def _rows(track: MarkerTrack, files: InputOptions) -> np.ndarray:
    start, end = part(files)
    low, high = (-np.inf if start is None else start), (np.inf if end is None else end)
    rows = np.flatnonzero((track.time >= low) & (track.time <= high))
    if not len(rows):
        first, last = track.time[[0, -1]]
        raise InputError(
            track.source, "has no frame between --start and --end", remedy=f"it has {first:g} to {last:g} s"
        )
    return rows


class _Marked(NamedTuple):
    """A subject with the markers that a file has, which of them mirror each other, and notes."""

    subject: Subject
    pairs: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def _marked(subject: Subject, chosen: PathLike, track: MarkerTrack) -> _Marked:
    """The subject with its own markers, or those of a set."""
    own = [marker for marker in subject.markers if marker.name in track.names]
    if chosen == AUTO and len(own) >= _FEWEST:
        missing = [m.name for m in subject.markers if m.name not in track.names]
        note = f"markers of the subject that are not in {track.source}: {first_of(missing, _LISTED)}"
        return _Marked(
            subject.with_markers(own, subject.zeros), _pairs_of(track.names, subject), (note,) if missing else ()
        )
    taken = _set_of(subject, chosen, track.names)
    said = (f"the points are read as the marker set {taken.name}",) if chosen == AUTO else ()
    return _Marked(subject.with_markers(taken.markers), taken.pairs, (*said, *taken.notes))


def _pairs_of(names: Sequence[str], subject: Subject) -> tuple[tuple[str, str], ...]:
    """The pairs of the set that contains the names; none without one."""
    try:
        return matching_set(names, subject).pairs
    except InputError:
        return ()


def _check_hand(body: Body, points: np.ndarray, source: str) -> None:
    """Raise InputError where the markers of the trunk are mirrored in points (T, M, 3) of a body's markers: the file is
    left-handed, or its labels are."""
    trunk = [i for i, marker in enumerate(body.subject.markers) if not marker.link.startswith(_SIDES)]
    at_rest = body.markers_of(body.placed(body.neutral[None]))[0]
    if mirrored(at_rest[trunk], points[:, trunk]):
        problem = "the markers of the trunk are mirrored: its axes are left-handed, or left and right are exchanged"
        remedy = "change the sign of one axis in the file, or the labels of left and right"
        raise InputError(source, problem, remedy=remedy)


def _set_of(subject: Subject, chosen: PathLike, names: Sequence[str]) -> MarkerSet:
    taken = matching_set(names, subject) if chosen == AUTO else chosen_set(names, marker_set(str(chosen), subject))
    links = {frame.name for frame in subject.model.frames}
    unknown = sorted({m.link for m in taken.markers} - links)
    if unknown:
        problem = f"the marker set {taken.name} has links that {subject.source} has not: {first_of(unknown, _LISTED)}"
        raise InputError("markers", problem, remedy="give your own set (kinemode subjects --markers FILE)")
    return taken


def mirrored(model_points: np.ndarray, points: np.ndarray) -> bool:
    """Whether points (T, M, 3) fit a model (M, 3) [m] clearly better mirrored than turned, in most frames.

    Of points of one rigid link, or of pelvis and trunk, which differ from front to back: for a flat arrangement both
    fit alike, and the answer is no. Missing points are NaN (S. Umeyama, IEEE PAMI 13(4), 1991, with scale).
    """
    answers = []
    for frame in points[:: max(1, len(points) // _FRAMES)]:
        seen = np.isfinite(frame).all(axis=1)
        if seen.sum() < _FEWEST_TRUNK:
            continue
        a, b = model_points[seen], frame[seen]
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        turn, values, turn_back = np.linalg.svd(b.T @ a)
        sign = np.sign(np.linalg.det(turn @ turn_back))
        size = max(float((a**2).sum() * (b**2).sum()), 1e-30)
        proper, improper = (
            1.0 - (values[0] + values[1] + which * values[2]) ** 2 / size for which in (sign, -sign)
        )  # of the squared distances, as a share
        answers.append(improper < _BETTER**2 * proper)
    return bool(len(answers) and np.mean(answers) > 0.5)
