"""How far the joints of a run are from those of a reference, coordinate by coordinate."""

from __future__ import annotations

import numpy as np

from estimator.formats.opensim import Coordinates
from estimator.results.coordinates import JointEntry, joint_entries
from humanoid.kinematics.body import Body

_COMPARED = ("turn", "slide", "endless")


def joint_coordinates(body: Body) -> tuple[str, ...]:
    """Names of the joints whose coordinates can be compared: those of one degree of freedom."""
    return tuple(entry.name for entry in joint_entries(body) if entry.kind in _COMPARED)


def coordinate_errors(
    body: Body, q: np.ndarray, coordinates: Coordinates | None, frame: np.ndarray
) -> tuple[dict[str, float], dict[str, float], int]:
    """Mean absolute errors of turning joints [deg] and of sliding ones [m], by name, and in how many frames there was
    something to compare.

    Of joints without limits the difference is taken the shorter way round. NaN where a joint is known in no frame.

    Parameters
    ----------
    q (T, nq): of the run. frame (N,): its frame for each of the reference's, -1 for none.
    """
    turns: dict[str, float] = {}
    slides: dict[str, float] = {}
    compared = np.zeros(len(frame), dtype=bool)
    row = np.flatnonzero(frame >= 0)
    for entry in joint_entries(body) if coordinates is not None else ():
        assert coordinates is not None
        theirs = _theirs(entry, coordinates)
        if theirs is None:
            continue
        error = np.abs(_difference(body, entry, q[frame[row]], theirs[row]))
        known = np.isfinite(error)
        compared[row[known]] = True
        mean = float(error[known].mean()) if known.any() else float("nan")
        if entry.kind == "slide":
            slides[entry.name] = mean
        else:
            turns[entry.name] = float(np.rad2deg(mean))
    return turns, slides, int(compared.sum())


def _theirs(entry: JointEntry, coordinates: Coordinates) -> np.ndarray | None:
    """A joint's coordinate (N,) in a reference [rad or m]; None where it has none."""
    place = {name: k for k, name in enumerate(coordinates.names)}
    if entry.kind not in _COMPARED:
        return None
    cosine, sine = (place.get(f"{entry.name}_{part}") for part in ("cos", "sin"))
    if entry.kind == "endless" and cosine is not None and sine is not None:
        return np.arctan2(coordinates.values[:, sine], coordinates.values[:, cosine])
    if entry.name not in place:
        return None
    values = coordinates.values[:, place[entry.name]]
    return np.deg2rad(values) if coordinates.in_degrees and entry.kind != "slide" else values


def _difference(body: Body, entry: JointEntry, q: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Ours less theirs (N,), of a joint that turns without limits the shorter way round."""
    own = entry.of(q)
    ours = np.arctan2(own[:, 1], own[:, 0]) if entry.kind == "endless" else own[:, 0]
    difference = ours - theirs
    if entry.kind == "endless" or (entry.kind == "turn" and entry.start not in body.bounded_q):
        difference = np.mod(difference + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(difference)
