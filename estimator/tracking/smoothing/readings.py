"""Which reading of the trunk a trajectory has, stretch by stretch: both are seen whole before one is chosen.

Where one camera has both readings of a trunk they are two trajectories that meet where it is upright. A path through
single modes cannot go from one to the other without a leap, which costs more than a stretch on the wrong one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.kernels.priors import trunk_record, trunk_values
from estimator.energy.kernels.records import TRUNK, Record
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.stretches import stretches
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.jumps.readings import AWAY, TOWARDS, has_both, trunk_depths
from humanoid.kinematics.body import Body, PlacedBodies

_GAP = 0.15  # s: frames in which one reading is missing for so long do not end a stretch
_BRIDGE = 0.4  # s: in which a path goes from one reading to the other
_HELD = 0.5  # of the depth that a mode's trunk has
_TINY = 1e-300
_BARRED = 1e6  # energy of modes that a path is not to take


def reading_bars(
    readings: Sequence[np.ndarray], energies: Sequence[np.ndarray], times: np.ndarray
) -> list[np.ndarray] | None:
    """Energies to add to those of the modes of each frame, (T) of (K,), so that a path has in each stretch the reading
    whose best modes have the lower energy over all of it; None where no frame has both.

    readings (T) of (K,): see `trunk_readings`. energies (T) of (K,). times (T,) [s], rising.
    """
    gaps = np.array([_gap(*frame) for frame in zip(readings, energies, strict=True)])
    both = np.isfinite(gaps)
    if not both.any():
        return None
    for first, after in stretches(~both):
        inside = first > 0 and after < len(both)
        both[first:after] = inside and times[after] - times[first - 1] <= _GAP
    bars = [np.zeros(len(energy)) for energy in energies]
    for first, after in stretches(both):
        better, worse = (TOWARDS, AWAY) if np.nansum(gaps[first:after]) > 0.0 else (AWAY, TOWARDS)
        for t in range(first, after):
            if np.any(readings[t] == better):
                bars[t][readings[t] == worse] = _BARRED
    return bars


def _gap(readings: np.ndarray, energy: np.ndarray) -> float:
    """Least energy of the modes that lead away less that of those that lead towards; NaN where one is missing."""
    sides = [energy[readings == side] for side in (AWAY, TOWARDS)]
    return float(sides[0].min() - sides[1].min()) if all(len(side) for side in sides) else np.nan


def bridged(body: Body, q: np.ndarray, readings: np.ndarray, times: np.ndarray, camera: Camera) -> np.ndarray:
    """A path q (T, nq) that leaps between readings (T,), with straight movements in place of its leaps: a smoother that
    begins with a leap pulls one stretch over to the reading of the other.

    The frames that move are those on the side of a leap where the trunk is more upright, for `_BRIDGE` at most and up
    to the next leap. times (T,) [s], rising.
    """
    q, last = q.copy(), len(q) - 1
    leaps = [i for i in range(1, len(q)) if {readings[i - 1], readings[i]} == {TOWARDS, AWAY}]
    for before, i, following in zip([0, *leaps], leaps, [*leaps[1:], last], strict=False):
        depth = np.abs(trunk_depths(body, q[[i - 1, i]], camera))
        if depth[0] <= depth[1]:
            start = max(before, int(np.searchsorted(times, times[i] - _BRIDGE)))
            end = i
        else:
            start, end = i - 1, min(following, int(np.searchsorted(times, times[i - 1] + _BRIDGE)))
        if end - start < 2:
            continue
        first, way = q[start].copy(), body.difference(q[start], q[end])
        for t in range(start + 1, end):
            q[t] = body.integrate(first, (times[t] - times[start]) / (times[end] - times[start]) * way)
    return q


def reading_hold(body: Body, q: np.ndarray, camera: Camera, std: float) -> TrunkSide:
    """Term that keeps a trajectory on the reading of a mode (nq,) in a frame that has both: the trunk leads at least
    half as far along the rays as the mode's does, with a standard deviation [m].

    Without it the reading whose rest positions cost less takes over a stretch from its ends, frame by frame, whatever
    was chosen. Farther on the side of the mode it is zero, so it lowers no uncertainty.
    """
    anatomy = anatomy_of(body)
    assert anatomy.trunk is not None
    trunk = anatomy.parts[anatomy.trunk]
    points = body.landmarks(body.at(q))
    hips = points[list(trunk.about)].mean(axis=0)
    ray = camera.sight_lines(hips[None])[1][0]
    depth = float((points[trunk.beyond].mean(axis=0) - hips) @ ray)
    return TrunkSide(body, trunk.beyond, trunk.about, np.sign(depth) * ray, _HELD * abs(depth), std)


def reading_weights(readings: np.ndarray, energy: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weights (K,) of a frame's modes, summing to one. Their sums over a reading follow from the frame's own energies
    (K,) of its best modes. Within a reading, and where one reading is missing, they are in proportion to `weight` (K,).

    Trajectories hardly ever change their reading, so that over many frames the sums of single ones are 0 or 1. Between
    readings the frame's own difference of energy, divided by the posterior's temperature, is calibrated (`python -m
    benchmarks trunk_evidence`).
    """
    if not has_both(readings):
        return weight
    out = np.zeros(len(weight))
    for reading in set(readings.tolist()):
        own = readings == reading
        inside = weight[own] + _TINY
        out[own] = np.exp(energy.min() - energy[own].min()) * inside / inside.sum()
    return np.asarray(out / out.sum())


class TrunkSide(RecordedTerm):
    """1/2 (max(0, least - ray . (ends - about)) / std)^2 with the middles of two groups of landmarks.

    Nothing where the ends lead farther along the ray than `least`.

    Parameters
    ----------
    ends, about: landmarks of the body. ray (3,): unit vector in the world. least, std [m].

    The Hessian is Gauss-Newton's, also where the exact one is requested: it leaves out the curvature of the kinematics.
    """

    name, kind = "trunk side", TRUNK

    def __init__(
        self, body: Body, ends: Sequence[int], about: Sequence[int], ray: np.ndarray, least: float, std: float
    ) -> None:
        landmarks = np.array([*ends, *about], dtype=np.int64)
        share = np.r_[np.full(len(ends), 1.0 / len(ends)), np.full(len(about), -1.0 / len(about))]
        joint, local = body.landmark_joint[landmarks], body.landmark_local[landmarks]
        self._body, self._points = body, (joint, local, share)
        self._side = np.asarray(ray, float), float(least), float(std)

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        joint, local, share = self._points
        return trunk_record(joint, self._body.last_columns(joint), local, share, *self._side)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        trunk_values(placed.placements, *self._points, *self._side, values)
        return values
