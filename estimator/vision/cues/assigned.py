"""Points of the body with image features assigned to them (CSS eqs. 5 to 9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.points import LoadedPoints, accumulate_points
from estimator.energy.term import BatchTerm
from estimator.numerics.robust import LORENTZIAN
from estimator.vision.cues.assigned_loads import assigned_loads, assigned_values, group_by_point, in_order, value_here
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody, points_in_world


class Assignments(NamedTuple):
    """Features assigned to points: each costs 1/2 weight rho(e' W e), e = target - projection of the point.

    point (A,) int: index of the point. target (A, 2) [px]. precision (A, 3): entries xx, xy, yy of W [1/px^2].
    weight (A,). potential (A,) int, nu (A,): see `estimator.numerics.robust`.
    """

    point: np.ndarray
    target: np.ndarray
    precision: np.ndarray
    weight: np.ndarray
    potential: np.ndarray
    nu: np.ndarray


def assignments(
    point: np.ndarray, target: np.ndarray, precision: np.ndarray, weight: np.ndarray, potential: int, nu: float
) -> Assignments:
    """`Assignments` that have one potential and one nu."""
    count = len(point)
    return Assignments(point, target, precision, weight, np.full(count, potential), np.full(count, float(nu)))


def nothing() -> Assignments:
    """No features."""
    return assignments(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0), LORENTZIAN, 1.0)


def isotropic(precision: np.ndarray) -> np.ndarray:
    """W (A, 3) that measures alike in all directions, with precision (A,) [1/px^2]."""
    return np.stack([precision, np.zeros_like(precision), precision], axis=1)


def value_of(
    posed: PosedBody, camera: Camera, joint: np.ndarray, local: np.ndarray, groups: Sequence[Assignments]
) -> float:
    """The value of `AssignedPoints` with these groups at one pose, to the last bit, and no term that has to be made."""
    parts = [np.concatenate(columns) for columns in zip(*groups, strict=True)]
    return float(value_here(posed.placements, joint, local, *camera.arrays, *parts))


class Features(NamedTuple):
    """Image features assigned to points of the body, at a pose.

    joint (A,), local (A, 3): the points in their joints' frames [m]. pixels (A, 2): where they appear. target (A, 2):
    where the features are. distance (A,): between these, in standard deviations. weight (A,): of each.
    """

    joint: np.ndarray
    local: np.ndarray
    pixels: np.ndarray
    target: np.ndarray
    distance: np.ndarray
    weight: np.ndarray


class AssignedPoints(BatchTerm):
    """Term of points on joints and the features of one image assigned to them; the assignment does not change.

    Parameters
    ----------
    joint (N,), local (N, 3): points in the frames of their joints [m].
    groups: assignments of the points.
    constant: energy of points without an assignment (back-facing and occluded nodes, contour points without an edge).
    name: of what is assigned.
    moves_with_past: of features followed from a past pose, whether they would lie elsewhere had the points been
        elsewhere then.
    """

    def __init__(
        self,
        body: Body,
        camera: Camera,
        joint: np.ndarray,
        local: np.ndarray,
        groups: Sequence[Assignments],
        constant: float = 0.0,
        *,
        name: str = "assigned features",
        moves_with_past: bool = True,
    ) -> None:
        self.name, self.moves_with_past = name, moves_with_past
        parts = [np.concatenate(columns) for columns in zip(*groups, strict=True)]
        point = parts[0]
        used, self._first, order = group_by_point(point, len(joint))
        self._features = in_order(order, *parts[1:])
        self._body, self.camera, self._constant = body, camera, float(constant)
        self._intrinsics, self._distortion, self._R, self._t = camera.arrays
        self._joint, self._local = joint[used], local[used]

    def points_of_features(self) -> tuple[np.ndarray, np.ndarray, Assignments]:
        """The features one by one: joint (A,) and local (A, 3) [m] of the point of each, and the assignments, in which
        feature a is that of point a."""
        point = np.repeat(np.arange(len(self._first) - 1), np.diff(self._first))
        return self._joint[point], self._local[point], Assignments(np.arange(len(point)), *self._features)

    def features(self, posed: PosedBody) -> Features:
        """The assigned features one by one, and where a pose has the points they are assigned to."""
        joint, local, (_, target, precision, weight, *_) = self.points_of_features()
        pixels = self.camera.project(points_in_world(posed, joint, local))
        x, y = (target - pixels).T
        squared = precision[:, 0] * x * x + 2.0 * precision[:, 1] * x * y + precision[:, 2] * y * y
        return Features(joint, local, pixels, target, np.sqrt(np.maximum(squared, 0.0)), weight)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        target, precision, weight, potential, nu = self._features
        loaded = LoadedPoints.passing(self._joint)
        value: float = assigned_loads(
            posed.placements, self._joint, self._local, self._intrinsics, self._distortion, self._R, self._t,
            self._first, target, precision, weight, potential, nu, exact, loaded.points, loaded.force, loaded.weight,
        )  # fmt: skip
        accumulate_points(self._body, posed, loaded, gradient, hessian, exact)
        return value + self._constant

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        target, precision, weight, potential, nu = self._features
        assigned_values(
            placed.placements, self._joint, self._local, self._intrinsics, self._distortion, self._R, self._t,
            self._first, target, precision, weight, potential, nu, values,
        )  # fmt: skip
        return values + self._constant
