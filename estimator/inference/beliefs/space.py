"""The space that the states of a graph's nodes live in: R^n, with rotations or without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.numerics.rotations import difference, moved, turn_after, turned, turned_back
from humanoid.support.compiled import jit

TURNS_VOLUME = 8.0 * np.pi**2
"""Volume of all rotations [rad^3], in the measure of the densities: near any rotation it is that of rotation
vectors."""


@dataclass(frozen=True)
class Space:
    """R^n, or R^n x SO(3).

    A point is a row of n coordinates [m] and, with `turns`, a unit quaternion x, y, z, w; many are (N, size). A tangent
    at a point (dims,) has n coordinates and a rotation vector [rad] in the point's own frame. With n = 3 and turns a
    point is a placement: the tangent's first three numbers are in the point's own frame too, and placements follow one
    another as rigid motions do. Otherwise the coordinates add, whatever the rotation.
    """

    n: int = 3
    turns: bool = True

    @property
    def size(self) -> int:
        """Numbers of a point."""
        return self.n + 4 * self.turns

    @property
    def dims(self) -> int:
        """Numbers of a tangent."""
        return self.n + 3 * self.turns

    def differences(self, centres: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Tangents (N, dims) at the centres that lead to the points; each (N, size) or (size,)."""
        centres, points = np.broadcast_arrays(np.atleast_2d(centres), points)
        e = np.empty((len(points), self.dims))
        _differences(self.n, self.turns, np.ascontiguousarray(centres), np.ascontiguousarray(points), e)
        return e

    def moved(self, centres: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        """Points (N, size) that tangents (N, dims) or (dims,) at the centres (N, size) or (size,) lead to."""
        centres, tangents = np.atleast_2d(centres), np.atleast_2d(tangents)
        count = max(len(centres), len(tangents))
        centres = np.ascontiguousarray(np.broadcast_to(centres, (count, self.size)))
        tangents = np.ascontiguousarray(np.broadcast_to(tangents, (count, self.dims)))
        points = np.empty((count, self.size))
        _moved(self.n, self.turns, centres, tangents, points)
        return points

    def composed(self, first: np.ndarray, relative: np.ndarray) -> np.ndarray:
        """Points (N, M, size): every one of `first` (N, size) followed by every relative placement (M, size)."""
        points = np.empty((len(first), len(relative), self.size))
        _composed(self.n, self.turns, np.ascontiguousarray(first), np.ascontiguousarray(relative), points)
        return points

    def inverse(self, points: np.ndarray) -> np.ndarray:
        """Relative placements (N, size) that undo others (N, size)."""
        inverse = np.empty_like(points)
        _inverted(self.n, self.turns, np.ascontiguousarray(points), inverse)
        return inverse

    def integrate(self, centre: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """The point (size,) that a tangent (dims,) at a centre (size,) leads to."""
        return self.moved(centre, tangent)[0]


PLACEMENTS = Space(3, True)


def points_of(t: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Points (N, 7) of placements: t (N, 3) [m], R (N, 3, 3). Angles of 180 degrees are as good as others."""
    # the largest of the four squares first (Shepperd 1978): it is at least 1/4, so that nothing is lost in the others
    trace = R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2]
    outer = np.empty((len(R), 4, 4))  # of the quaternion with itself, four times
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        outer[:, i, i] = 1.0 + 2.0 * R[:, i, i] - trace
        outer[:, j, k] = outer[:, k, j] = R[:, j, k] + R[:, k, j]
        outer[:, i, 3] = outer[:, 3, i] = R[:, k, j] - R[:, j, k]
    outer[:, 3, 3] = 1.0 + trace
    best = np.argmax(np.einsum("nii->ni", outer), axis=1)
    quaternion = outer[np.arange(len(R)), best]
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.concatenate([t, quaternion], axis=1)


def placements_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """t (N, 3), R (N, 3, 3) of points (N, 7); the inverse of `points_of`."""
    R = np.empty((len(points), 3, 3))
    _matrices(np.ascontiguousarray(points), R)
    return points[:, :3].copy(), R


@jit
def _matrices(points, R):  # type: ignore[no-untyped-def]
    """Rotations R (N, 3, 3) of points (N, 7)."""
    for i in range(len(points)):
        q = points[i, 3:]
        R[i, 0, 0], R[i, 1, 0], R[i, 2, 0] = turned(q, 1.0, 0.0, 0.0)
        R[i, 0, 1], R[i, 1, 1], R[i, 2, 1] = turned(q, 0.0, 1.0, 0.0)
        R[i, 0, 2], R[i, 1, 2], R[i, 2, 2] = turned(q, 0.0, 0.0, 1.0)


@jit
def _differences(n, turns, centres, points, e):  # type: ignore[no-untyped-def]
    """Tangents e (N, n + 3 * turns) at centres (N, n + 4 * turns) that lead to points (N, n + 4 * turns)."""
    for i in range(len(points)):
        difference(n, turns, centres[i], points[i], e[i])


@jit
def _moved(n, turns, centres, e, points):  # type: ignore[no-untyped-def]
    """Fill points (N, n + 4 * turns) that tangents e (N, n + 3 * turns) at centres (N, n + 4 * turns) lead to."""
    for i in range(len(points)):
        moved(n, turns, centres[i], e[i], points[i])


@jit
def _composed(n, turns, first, relative, points):  # type: ignore[no-untyped-def]
    """Fill points (N, M, n + 4 * turns): first (N, n + 4 * turns) followed by relative (M, n + 4 * turns)."""
    for i in range(len(first)):
        for m in range(len(relative)):
            a, b, c = first[i], relative[m], points[i, m]
            if turns and n == 3:
                c[0], c[1], c[2] = turned(a[3:], b[0], b[1], b[2])
                for k in range(3):
                    c[k] += a[k]
            else:
                for k in range(n):
                    c[k] = a[k] + b[k]
            if turns:
                c[n], c[n + 1], c[n + 2], c[n + 3] = turn_after(a[n:], b[n:])


@jit
def _inverted(n, turns, points, inverse):  # type: ignore[no-untyped-def]
    """The inverse (N, n + 4 * turns) of each of the points (N, n + 4 * turns)."""
    for i in range(len(points)):
        a, b = points[i], inverse[i]
        for k in range(n):
            b[k] = -a[k]
        if turns:
            b[n], b[n + 1], b[n + 2], b[n + 3] = -a[n], -a[n + 1], -a[n + 2], a[n + 3]
            if n == 3:
                b[0], b[1], b[2] = turned_back(a[3:], b[0], b[1], b[2])
