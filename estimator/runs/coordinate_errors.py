"""Errors of a run's joints against those of a reference, coordinate by coordinate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.data.formats.opensim import Coordinates
from estimator.runs.coordinates import joint_entries, opensim_names
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates, is_measured
from estimator.runs.joint_angle import ONE_NUMBER, joint_value
from estimator.runs.pairs import listed
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

_TURNED = 10.0  # difference of the pelvis' headings from which it is reported [deg]
_KNEES = ("knee_angle_r", "knee_angle_l")
_OF_LEGS = {
    "hips": ("left_hip_flexion", "right_hip_flexion", "hip_flexion_l", "hip_flexion_r"),
    "knees": ("left_knee_flexion", "right_knee_flexion", "knee_angle_l", "knee_angle_r"),
    "ankles": ("left_ankle_dorsiflexion", "right_ankle_dorsiflexion", "ankle_angle_l", "ankle_angle_r"),
}
GROUPS = _OF_LEGS | {"legs": tuple(name for names in _OF_LEGS.values() for name in names)}
"""Flexion of a person's leg joints, of both sides, as our body and OpenSim's gait models call it."""
_SAME = 1e-6  # [s] what files round times by
_GAP = 1.5  # steps from one sample to the next above which there is nothing between them
_FINER = 0.9  # of the run's step: a reference with a shorter one is finer, not only rounded


@dataclass(frozen=True)
class JointScore:
    """Error of a joint of a run against a reference's, over the times that both have [deg, or m where it slides].

    mean_absolute, rms: mean absolute difference, and root of the mean square. bias: mean difference, run less
    reference: what two definitions of the zero differ by shows there. mean_absolute_without_bias, rms_without_bias: of
    the differences less the bias. frames: how many were compared; without any the others are NaN.
    """

    unit: str
    mean_absolute: float
    rms: float
    bias: float
    frames: int
    mean_absolute_without_bias: float = np.nan
    rms_without_bias: float = np.nan

    @staticmethod
    def of(difference: np.ndarray, unit: str, wraps: bool = False) -> JointScore:
        """The score of differences (N,) in this unit, NaN where either side is unknown; wraps: they are degrees, taken
        from -180 to 180, about their circular mean where the bias is taken away."""
        known = difference[np.isfinite(difference)]
        if known.size == 0:
            return JointScore(unit, np.nan, np.nan, np.nan, 0)
        bias = known.mean()
        if wraps:
            known = wrapped_degrees(known)
            middle = np.rad2deg(np.angle(np.exp(1j * np.deg2rad(known)).mean()))
            bias = wrapped_degrees(middle + wrapped_degrees(known - middle).mean())
        rest = wrapped_degrees(known - bias) if wraps else known - bias
        sizes = [f(x) for x in (known, rest) for f in (_mean_absolute, _rms)]
        return JointScore(unit, sizes[0], sizes[1], float(bias), known.size, sizes[2], sizes[3])

    @staticmethod
    def mean(scores: list[JointScore]) -> JointScore:
        """The mean of the scores of several joints, which counts each alike; the bias is NaN, as it is undefined for
        several."""
        columns = ("mean_absolute", "rms", "mean_absolute_without_bias", "rms_without_bias")
        means = {name: float(np.mean([getattr(score, name) for score in scores])) for name in columns}
        return JointScore(scores[0].unit, bias=np.nan, frames=min(score.frames for score in scores), **means)


class ComparedCoordinates(NamedTuple):
    """scores: by the coordinate's name. names: all that the run has. compared, missing: moments at which there was
    something to compare, or nothing. notes: names that only one side has, and how names were understood."""

    scores: Mapping[str, JointScore]
    names: tuple[str, ...]
    compared: int
    missing: int
    notes: tuple[str, ...]


class _Coordinate(NamedTuple):
    """A coordinate of the run: values (T,) [rad or m]. wraps: whether a whole turn makes no difference."""

    values: np.ndarray
    slides: bool
    wraps: bool


def coordinate_errors(
    body: Body, q: np.ndarray, time: np.ndarray, coordinates: Coordinates, reference_time: np.ndarray | None
) -> ComparedCoordinates:
    """The score of every coordinate that both sides have by name: joints of ours, and those of OpenSim's gait models
    (see `estimator.runs.gait_coordinates`) that a whole person has a joint for.

    Differences of angles are taken the shorter way round, but for joints whose limits allow more than a turn: there
    turns count. Moments are those of `common_times`; without times, frames of the same number are compared.

    Parameters
    ----------
    q (T, nq), time (T,) [s]: of the run. reference_time (N,) [s]: of the coordinates.
    """
    if reference_time is None:
        time, reference_time = np.arange(len(time)), np.arange(len(coordinates.values))
    own, (gait, notes) = _own(body, q), _of_gait_model(body, q, coordinates)
    moments = common_times(time, reference_time)
    compared = np.zeros(len(moments), dtype=bool)
    scores: dict[str, JointScore] = {}
    used: set[str] = set()
    for name, ours in (gait | own).items():
        theirs, columns = _theirs(name, ours, coordinates)
        if theirs is None:
            continue
        used |= columns
        there = values_at(moments, reference_time, theirs, ours.wraps)
        difference = values_at(moments, time, ours.values, ours.wraps) - there
        compared |= np.isfinite(difference)
        scores[name] = JointScore.of(
            difference if ours.slides else np.rad2deg(difference), "m" if ours.slides else "deg", ours.wraps
        )
    used |= _several_numbers(body)
    ours_alone = [n for side in (own, gait) if scores.keys() & side.keys() for n in side if n not in scores]
    notes += _alone(ours_alone, [name for name in coordinates.names if name not in used]) if scores else ()
    heading = scores.get("pelvis_rotation")
    if heading is not None and abs(heading.bias) > _TURNED:
        notes += (
            f"the pelvis is turned by {heading.bias:.0f} deg from the reference's: its three turns count that, other"
            " joints do not",
        )
    return ComparedCoordinates(scores, (*own, *gait), int(compared.sum()), int((~compared).sum()), notes)


def _several_numbers(body: Body) -> set[str]:
    """Names of the entries of joints with several coordinates, such as a free root; they are not compared."""
    entries = [entry for entry in joint_entries(body) if entry.kind not in ONE_NUMBER]
    ours = {name for e in entries for name in body.q_names[e.start : e.start + e.count]}
    return ours | {name for e in entries for name in opensim_names(body, e)}


def _own(body: Body, q: np.ndarray) -> dict[str, _Coordinate]:
    """The joints of the body that one number places."""
    made = {}
    for entry in joint_entries(body):
        if entry.kind in ONE_NUMBER:
            span = abs(entry.multiplier) * (body.upper[entry.start] - body.lower[entry.start])
            counts = entry.kind == "turn" and entry.start in body.bounded_q and span > 2.0 * np.pi
            slides = entry.kind == "slide"
            made[entry.name] = _Coordinate(joint_value(entry, q), slides, not slides and not counts)
    return made


def _of_gait_model(
    body: Body, q: np.ndarray, coordinates: Coordinates
) -> tuple[dict[str, _Coordinate], tuple[str, ...]]:
    """The coordinates of the gait model that the reference is of, and how that was found; none of another body."""
    bent = [coordinates.values[:, k] for k, name in enumerate(coordinates.names) if name in _KNEES]
    negative = bool(bent) and float(np.nansum(bent)) < 0.0
    model = GAIT_MODELS["gait2392" if negative else "rajagopal"]
    try:
        names, values = gait_coordinates(body, q, model)
    except InputError:
        return {}, ()
    made = {}
    for name, column in zip(names, values.T, strict=True):
        slides = name.startswith("pelvis_t") and name != "pelvis_tilt"
        if is_measured(name):
            made[name] = _Coordinate(column if slides else np.deg2rad(column), slides, not slides)
    sign = "negative" if negative else "positive"
    return made, (f"bent knees are {sign} in the reference: read as angles of {model.title}",) if bent else ()


def _theirs(name: str, ours: _Coordinate, coordinates: Coordinates) -> tuple[np.ndarray | None, set[str]]:
    """A coordinate (N,) in a reference [rad or m] and the names of its columns; None where it has none."""
    place = {column: k for k, column in enumerate(coordinates.names)}
    circle = (f"{name}_cos", f"{name}_sin")
    if not ours.slides and ours.wraps and all(part in place for part in circle):
        cosine, sine = (coordinates.values[:, place[part]] for part in circle)
        return np.arctan2(sine, cosine), set(circle)
    if name not in place:
        return None, set()
    values = coordinates.values[:, place[name]]
    return np.deg2rad(values) if coordinates.in_degrees and not ours.slides else values, {name}


def _alone(ours: list[str], theirs: list[str]) -> tuple[str, ...]:
    said = (("run", ours), ("reference", theirs))
    return tuple(f"coordinates of the {side} alone: {listed(names)}" for side, names in said if names)


def wrapped_degrees(degrees: np.ndarray) -> np.ndarray:
    """The same turns, from -180 to 180."""
    return np.mod(degrees + 180.0, 360.0) - 180.0


def _mean_absolute(x: np.ndarray) -> float:
    return float(np.abs(x).mean())


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def common_times(time: np.ndarray, reference_time: np.ndarray) -> np.ndarray:
    """The moments (M,) [s] to compare at: the reference's, or the run's `time` where the reference is finer."""
    return time if _step(reference_time) < _FINER * _step(time) else reference_time


def values_at(moments: np.ndarray, time: np.ndarray, values: np.ndarray, wraps: bool) -> np.ndarray:
    """Values (T,) of `time` (T,) at `moments` (M,) [s], linear between samples that are neighbours in `time`.

    wraps: whether values are angles [rad] that count the same after a whole turn. NaN before the first sample, after
    the last, and where a neighbouring sample is NaN or missing.
    """
    known = np.isfinite(values)
    order = np.flatnonzero(known)[np.argsort(time[known])]
    if not order.size:
        return np.full(len(moments), np.nan)
    t, v = time[order], np.unwrap(values[order]) if wraps else values[order]
    right = np.clip(np.searchsorted(t, moments), 0, len(t) - 1)
    left = np.maximum(right - 1, 0)
    near = np.where(np.abs(t[left] - moments) < np.abs(t[right] - moments), left, right)
    inside = (t[left] <= moments) & (moments <= t[right]) & (t[right] - t[left] <= _GAP * _step(time))
    between = np.where(inside, np.interp(moments, t, v), np.nan)
    return np.asarray(np.where(np.abs(t[near] - moments) <= _SAME, v[near], between))


def _step(time: np.ndarray) -> float:
    """The usual time between samples [s]; of a single one, infinite."""
    return float(np.median(np.diff(np.sort(time)))) if len(time) > 1 else np.inf
