"""Feet that stand: their points are where they were a moment ago, and level, as floors are."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.energy.kernels.points import to_world
from estimator.energy.kernels.records import SOLES, Record
from estimator.energy.kernels.soles import sole_record, sole_values
from estimator.energy.point_targets import PointTargets
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.robust import LORENTZIAN, rho
from estimator.numerics.vectors import dot
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody, points_in_world
from humanoid.support.compiled import jit
from humanoid.support.per_object import per_object

LEAST = 0.1  # probability of standing from which a point is held
_NU = 8.0  # squared standard deviations from which a point has begun to move


class HeldPoints:
    """The landmarks that stand in a frame, to be held where an earlier pose has them, that pose being held.

    standing (L,): probability that each landmark stands. std [m]: of its movement since, and of the earlier pose.
    """

    def __init__(self, body: Body, standing: np.ndarray, std: float, weight: float = 1.0) -> None:
        index = np.flatnonzero(standing >= LEAST)
        joint, local = body.landmark_joint[index], body.landmark_local[index]
        precision = np.repeat(np.eye(3)[None] / std**2, len(index), axis=0)
        self._joint, self._local = joint, local
        self._targets = PointTargets(
            body, joint, local, np.zeros((len(index), 3)), precision, weight=weight * standing[index],
            potential="lorentzian", nu=_NU, name="standing points",
        )  # fmt: skip

    def targets(self, before: PosedBody) -> list[PointTargets]:
        """Terms that hold them at their places in an earlier pose; none where none stands."""
        if not len(self._joint):
            return []
        return [self._targets.with_targets(points_in_world(before, self._joint, self._local))]


class TiedPoints(NamedTuple):
    """P points of a body: joint, column (P,), the last column of the spatial Jacobian that moves each, local (P, 3) [m]
    in the joint's frame, precision [1/m^2] of the movement, weight (P,)."""

    joint: np.ndarray
    column: np.ndarray
    local: np.ndarray
    precision: np.ndarray
    weight: np.ndarray


class StandingTie:
    """The same between the poses of two successive frames, neither of which is held.

    1/2 sum weight rho(|p_after - p_before|^2 / std^2) over the landmarks p that stand. index, weight (S,): which they
    are, and how much each is held. points: the same, as `tie_points` reads them.
    """

    def __init__(self, body: Body, index: np.ndarray, weight: np.ndarray, std: float) -> None:
        joint = body.landmark_joint[index]
        local, precision = np.ascontiguousarray(body.landmark_local[index]), np.full(len(index), 1.0 / std**2)
        self._body = body
        self.points = TiedPoints(joint, body.last_columns(joint), local, precision, np.asarray(weight, dtype=float))

    def accumulate_pair(self, before: PosedBody, after: PosedBody, gradient: np.ndarray, hessian: np.ndarray) -> float:
        """See `estimator.tracking.smoothing.ties.FlowTie`."""
        body, nv, nc = self._body, self._body.nv, len(before.spatial_jacobian)
        pull, blocks, value = np.zeros((2, nc)), np.zeros((2, 2, nc, nc)), np.zeros(1)
        placements, columns = (np.stack(both) for both in zip(before[1:], after[1:], strict=True))
        tie_points(
            np.zeros(len(self.points.joint), dtype=np.int64), *self.points, placements, columns,
            body.tree.column_parent, value, pull, blocks,
        )  # fmt: skip
        gradient += body.collected(pull).ravel()
        for t in range(2):
            own = slice(t * nv, (t + 1) * nv)
            hessian[own, own] += body.collected_hessian(blocks[0, t])
        across = body.collected_hessian(blocks[1, 0])
        hessian[:nv, nv:] += across
        hessian[nv:, :nv] += across.T
        return float(value[0])


@jit
def tie_points(  # type: ignore[no-untyped-def]
    frame, joint, column, local, precision, weight, placements, columns, column_parent, values, gradient, blocks
):
    """Add the value of each point n, which stands from frame[n] to the one after, to values (T - 1,), its derivatives
    to gradient (T, nc) and blocks (K, T, nc, nc), K at least 2, block k of which couples frame t with frame t + k.

    frame, joint, column, precision, weight (P,), local (P, 3): see `TiedPoints`. placements (T, njoints, 12), columns
    (T, nc, 6): see `PosedBody`. column_parent (nc,): see `Tree`.
    """
    p, x = np.empty((2, 3)), np.empty(3)
    moving, rows = np.empty(columns.shape[1], dtype=np.int64), np.empty((2, columns.shape[1], 3))
    for n in range(joint.shape[0]):
        t, square = frame[n], 0.0
        for s in range(2):
            to_world(placements[t + s, joint[n]], local[n], p[s])
        for i in range(3):
            x[i] = p[1, i] - p[0, i]
            square += precision[n] * x[i] * x[i]
        cost, slope, _ = rho(LORENTZIAN, square, _NU)
        values[t] += 0.5 * weight[n] * cost
        stiff, count, k = precision[n] * weight[n] * slope, 0, column[n]
        while k >= 0:
            moving[count] = k
            for s in range(2):
                J, row, sign = columns[t + s, k], rows[s, count], 1.0 if s else -1.0
                row[0] = sign * (J[0] + J[4] * p[s, 2] - J[5] * p[s, 1])
                row[1] = sign * (J[1] + J[5] * p[s, 0] - J[3] * p[s, 2])
                row[2] = sign * (J[2] + J[3] * p[s, 1] - J[4] * p[s, 0])
            count, k = count + 1, column_parent[k]
        for a in range(count):
            i = moving[a]
            for s in range(2):
                gradient[t + s, i] += stiff * dot(rows[s, a], x)
            for b in range(count):
                blocks[0, t, i, moving[b]] += stiff * dot(rows[0, a], rows[0, b])
                blocks[0, t + 1, i, moving[b]] += stiff * dot(rows[1, a], rows[1, b])
                blocks[1, t, i, moving[b]] += stiff * dot(rows[0, a], rows[1, b])


def standing_ties(body: Body, standing: np.ndarray, std: float, weight: float = 1.0) -> list[StandingTie]:
    """A tie as `HeldPoints` has targets; nothing where none stands."""
    index = np.flatnonzero(standing >= LEAST)
    return [StandingTie(body, index, weight * standing[index], std)] if len(index) else []


class Soles(NamedTuple):
    """Soles of the feet, from heel to toes.

    heel, toe (S,): landmarks. joint (S,): that moves both. along (S, 3): from one to the other in its frame [m]. rise
    (S,): how much higher the toes are where all joints are at zero [m].
    """

    heel: np.ndarray
    toe: np.ndarray
    joint: np.ndarray
    along: np.ndarray
    rise: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> Soles:
        """The soles of feet whose first toe is on the heel's joint; none where the body's upright axis is unknown."""
        upright, names, joint = body.subject.upright, body.landmark_names, body.landmark_joint
        toes = [(i, [j for j, n in enumerate(names) if n.endswith("toe") and joint[j] == joint[i]])
                for i, name in enumerate(names) if name.endswith("heel") and upright is not None]  # fmt: skip
        heel, toe = np.array([(i, some[0]) for i, some in toes if some], np.int64).reshape(-1, 2).T
        at_zero = body.landmarks(body.at(pin.neutral(body.model)))
        up = np.zeros(3) if upright is None else np.array(upright.axis)
        along = body.landmark_local[toe] - body.landmark_local[heel]
        return Soles(heel, toe, joint[heel], along, (at_zero[toe] - at_zero[heel]) @ up)


class LevelFeet(RecordedTerm):
    """1/2 sum weight rho((up . d - rise)^2 / (std |d|)^2) over soles d, from heel to toes in the world.

    weight (S,): of each, none of those that weigh less than `LEAST`. up (3,): unit vector in the world. std [rad]: of a
    foot's tilt, and of the assumed up.
    """

    name, kind = "level feet", SOLES

    def __init__(self, body: Body, soles: Soles, weight: np.ndarray, up: np.ndarray, std: float) -> None:
        some = np.flatnonzero(weight >= LEAST)
        along = np.ascontiguousarray(soles.along[some])
        precision = 1.0 / np.square(std * np.linalg.norm(along, axis=1))
        self._body = body
        self._soles = (soles.joint[some], along, soles.rise[some], np.asarray(up, float), precision, weight[some])

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return sole_record(*self._soles)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        sole_values(placed.placements, *self._soles, values)
        return values
