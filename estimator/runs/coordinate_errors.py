"""How far the joints of a run are from those of a reference, coordinate by coordinate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.data.formats.opensim import Coordinates
from estimator.runs.coordinates import JointEntry, joint_entries
from estimator.runs.joint_angle import ONE_NUMBER, joint_value
from humanoid.kinematics.body import Body


def joint_coordinates(body: Body) -> tuple[str, ...]:
    """Names of the joints whose coordinates can be compared: those of one degree of freedom."""
    return tuple(entry.name for entry in joint_entries(body) if entry.kind in ONE_NUMBER)


@dataclass(frozen=True)
class JointScore:
    """How far a joint of a run is from a reference's, over the frames that both have [deg, or m where it slides].

    mean_absolute, rms: mean absolute difference, and root of the mean square. bias: mean difference, run less
    reference: what two definitions of the zero differ by shows there. frames: how many were compared; without any the
    others are NaN.
    """

    unit: str
    mean_absolute: float
    rms: float
    bias: float
    frames: int

    @staticmethod
    def of(difference: np.ndarray, unit: str) -> JointScore:
        """The score of differences (N,) in this unit, NaN where either side is unknown."""
        known = difference[np.isfinite(difference)]
        if known.size == 0:
            return JointScore(unit, np.nan, np.nan, np.nan, 0)
        rms = float(np.sqrt(np.mean(np.square(known))))
        return JointScore(unit, float(np.abs(known).mean()), rms, float(known.mean()), known.size)


def coordinate_errors(
    body: Body, q: np.ndarray, coordinates: Coordinates | None, frame: np.ndarray
) -> tuple[dict[str, JointScore], int]:
    """The score of every joint that both sides have by name, and in how many frames there was something to compare.

    Differences of angles are taken the shorter way round, but for joints whose limits allow more than a turn: there
    turns count.

    Parameters
    ----------
    q (T, nq): of the run. frame (N,): its frame for each of the reference's, -1 for none.
    """
    scores: dict[str, JointScore] = {}
    compared = np.zeros(len(frame), dtype=bool)
    row = np.flatnonzero(frame >= 0)
    for entry in joint_entries(body) if coordinates is not None else ():
        assert coordinates is not None
        theirs = _theirs(entry, coordinates)
        if theirs is None:
            continue
        difference = _difference(body, entry, q[frame[row]], theirs[row])
        compared[row[np.isfinite(difference)]] = True
        turns = entry.kind != "slide"
        scores[entry.name] = JointScore.of(np.rad2deg(difference) if turns else difference, "deg" if turns else "m")
    return scores, int(compared.sum())


def _theirs(entry: JointEntry, coordinates: Coordinates) -> np.ndarray | None:
    """A joint's coordinate (N,) in a reference [rad or m]; None where it has none."""
    place = {name: k for k, name in enumerate(coordinates.names)}
    if entry.kind not in ONE_NUMBER:
        return None
    cosine, sine = (place.get(f"{entry.name}_{part}") for part in ("cos", "sin"))
    if entry.kind == "endless" and cosine is not None and sine is not None:
        return np.arctan2(coordinates.values[:, sine], coordinates.values[:, cosine])
    if entry.name not in place:
        return None
    values = coordinates.values[:, place[entry.name]]
    return np.deg2rad(values) if coordinates.in_degrees and entry.kind != "slide" else values


def _difference(body: Body, entry: JointEntry, q: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Ours less theirs (N,) [rad or m]."""
    difference = joint_value(entry, q) - theirs
    span = abs(entry.multiplier) * (body.upper[entry.start] - body.lower[entry.start])
    counts = entry.kind == "turn" and entry.start in body.bounded_q and span > 2.0 * np.pi
    if entry.kind != "slide" and not counts:
        difference = np.mod(difference + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(difference)
