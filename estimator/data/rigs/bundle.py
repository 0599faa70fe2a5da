"""Bundle adjustment of cameras on a person's joints: placements, clocks and lenses, with points whose segments keep
their lengths (Triggs et al., Bundle adjustment - a modern synthesis, 2000).

Residuals are in standard deviations, with Cauchy's tails, and derivatives analytic. Steps are Levenberg's and
Marquardt's, on normal equations that SuperLU factorises: points are tied within a frame alone, so they stay sparse.
(SciPy's `least_squares` with `lsmr` stops far from the minimum on them: the lengths are stiff beside the placements.)

A lens has one radial term beside the given one: flat = f x (1 + k |x|^2), x the place in the plane z = 1 (Brown,
Decentering distortion of lenses, 1966; OpenCV's k1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.sparse import csc_matrix, csr_matrix, diags
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial.transform import Rotation

from estimator.data.rigs.lengths import SegmentLengths
from estimator.numerics.newton import Damping, NewtonSettings, descend

_ROUNDS = 8  # of Newton's method
_FLAT = 1e-6  # of a radial term that counts as none
_LEAST_SLOPE = 0.1  # of the bent radius by the straight one: where it falls pictures fold


def bent(x: np.ndarray, focal: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """Projections (..., 2) of places x (..., 2); factors on the focal lengths, and radial terms, (...)."""
    return np.asarray((focal * (1.0 + radial * np.square(x).sum(axis=-1)))[..., None] * x)


def by_place(x: np.ndarray, focal: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2, 2) of `bent` by x."""
    own = (1.0 + radial * np.square(x).sum(axis=-1))[..., None, None] * np.eye(2)
    across = (2.0 * radial)[..., None, None] * x[..., :, None] * x[..., None, :]
    return np.asarray(focal[..., None, None] * (own + across))


def by_radial(x: np.ndarray, focal: np.ndarray) -> np.ndarray:
    """Derivatives (..., 2) of `bent` by the radial terms."""
    return np.asarray((focal * np.square(x).sum(axis=-1))[..., None] * x)


def straight(seen: np.ndarray, focal: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """The inverse of `bent`, NaN for NaN; nearest to the middle where a picture folds."""
    y = seen / focal[..., None]
    if not np.any(radial):
        return np.asarray(y)
    far = np.linalg.norm(y, axis=-1)
    fold = 1.0 / np.sqrt(3.0 * np.maximum(-radial, _FLAT))
    r = np.minimum(far, fold)
    for _ in range(_ROUNDS):
        slope = np.maximum(1.0 + 3.0 * radial * r * r, _LEAST_SLOPE)
        r = np.clip(r - (r * (1.0 + radial * r * r) - far) / slope, 0.0, fold)
    return np.asarray(y * (r / np.maximum(far, 1e-12))[..., None])


_LENGTH = 0.02  # m: by how much keypoints are off the joints, along a segment
_SIDES = 0.02  # m: between left and right ones, as a detector marks them
_TAIL = 1.5  # standard deviations from which a residual counts less
_NEAREST = 0.05  # m: least depth of a point
_DAMPING = Damping(first=1e-4, growth=6.0, shrink=1.0 / 6.0)
_LEAST_GAIN = 1e-5  # of the cost
_TINY = 1e-9
SIZE_KNOWN = 1e8
"""Precision of the logarithm of the person's size, for covariances that are of the rig's shape."""
BIAS = 0.5
"""Share of a ray's deviation that a detector marks elsewhere from every side."""


@dataclass(frozen=True)
class RigState:
    """The adjusted state. The world is the first camera's frame, and in it the body's size is that of the subject.

    R (C, 3, 3), t (C, 3) [m]: x_camera = R x + t. late (C,) [s]: how long after its given offset each camera's clock is
    read, since the rays were read. focal (C,): factors on the focal lengths; radial (C,): see
    `estimator.data.rigs.bundle`. lengths (S,) [m]: of the segments. points (T, J, 3) [m]: NaN where fewer than two
    cameras see one.
    """

    R: np.ndarray
    t: np.ndarray
    late: np.ndarray
    focal: np.ndarray
    radial: np.ndarray
    lengths: np.ndarray
    points: np.ndarray

    def straight(self, rays: np.ndarray) -> np.ndarray:
        """Rays (C, T, J, 2) free of the lenses: places in the plane z = 1."""
        return straight(rays, self.focal[:, None, None], self.radial[:, None, None])

    def through(self, c: int, rays: np.ndarray) -> np.ndarray:
        """Rays (..., 2) of one camera free of its lens."""
        return straight(rays, self.focal[c], self.radial[c])

    def bent(self, at: np.ndarray) -> np.ndarray:
        """Rays (C, T, J, 2) by which points at (C, T, J, 3) in the cameras are seen."""
        return bent(at[..., :2] / at[..., 2:], self.focal[:, None, None], self.radial[:, None, None])


@dataclass(frozen=True)
class RigRays:
    """Rays of C cameras to J joints at T instants, without lens distortion.

    rays (C, T, J, 2): places in the plane z = 1 by the given focal lengths, NaN where missing. slope (C, T, J,
    2) [1/s]: how they move. std (C, J): of each place. focal_std (C,): of the logarithms of the focal lengths;
    radial_std (C,): of the radial terms; late_std (C,) [s]: of the clocks; 0 of what is known.
    """

    rays: np.ndarray
    slope: np.ndarray
    std: np.ndarray
    focal_std: np.ndarray
    radial_std: np.ndarray
    late_std: np.ndarray


class Adjusted(NamedTuple):
    """state: of least cost. cost: half the sum of robust squares. chi: root mean square of the residuals, weighted by
    their tails, 1 where they are as large as given."""

    state: RigState
    cost: float
    chi: float


@dataclass(frozen=True)
class RigUncertainty:
    """The uncertainty of a rig where all residuals are independent. covariance (C, 7, C, 7): of all cameras' turns
    [rad] and shifts [m], each in its own frame, and logarithms of focal lengths; the person's size is held, the first
    camera's place has 0. of_bias (C, 7, C, 7): what it has besides of a detector that marks a joint elsewhere in each
    camera. late_std (C,) [s], radial_std (C,): of clocks and radial terms."""

    covariance: np.ndarray
    of_bias: np.ndarray
    late_std: np.ndarray
    radial_std: np.ndarray

    @staticmethod
    def of(
        column: np.ndarray, covariance: np.ndarray, biases: np.ndarray, late_std: np.ndarray, radial_std: np.ndarray
    ) -> RigUncertainty:
        """column (C, 7): where the covariance (N, K) of what was adjusted has each, -1 of what was not; biases (M, B):
        how biases of one deviation move the M that were, in this order."""
        free = np.flatnonzero(column.ravel() >= 0)
        of = column.ravel()[free]
        own, of_bias = np.zeros((2, column.size, column.size))
        own[np.ix_(free, free)], of_bias[np.ix_(free, free)] = covariance[np.ix_(of, of)], biases @ biases.T
        shape = (*column.shape, *column.shape)
        return RigUncertainty(own.reshape(shape), of_bias.reshape(shape), late_std, radial_std)

    def own(self, c: int) -> np.ndarray:
        """Covariance (7, 7) of one camera."""
        return np.asarray(self.covariance[c, :, c])


def adjusted(
    state: RigState, seen: RigRays, lengths: SegmentLengths, *, most: int = 40, free: Sequence[int] | None = None
) -> Adjusted:
    """The state of least robust cost near one; most: steps taken; free: the cameras that are placed, by default all but
    the first."""
    problem = RigProblem(state, seen, lengths, free)
    x = problem.start
    best = descend(
        (x, problem.residuals(x)), lambda at: robust_cost(at[1]), lambda at: problem.normal_equations(*at),
        problem.step, NewtonSettings(most, _DAMPING, share=_LEAST_GAIN, count_taken=True),
    ).model  # fmt: skip
    x, r = best.state
    return Adjusted(problem.state(x), best.value, problem.chi(r))


def uncertainty(state: RigState, seen: RigRays, lengths: SegmentLengths) -> RigUncertainty:
    """The uncertainty of an adjusted state."""
    return RigProblem(state, seen, lengths).uncertainty()


def _factors(A: csc_matrix) -> SuperLU:
    """Factors of a symmetric definite matrix."""
    return splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def robust_weights(r: np.ndarray) -> np.ndarray:
    """Weights of residuals with Cauchy tails."""
    return np.asarray(1.0 / (1.0 + np.square(r / _TAIL)))


def robust_cost(r: np.ndarray) -> float:
    """Half the sum of the squares of residuals, with Cauchy's tails."""
    return float(0.5 * _TAIL**2 * np.log1p(np.square(r / _TAIL)).sum())


class RigProblem:
    """Residuals and derivatives by one vector: turns and shifts of the cameras that are placed (6 each), all but the
    first unless they are given; clocks but the first one's, logarithms of the focal lengths, radial terms, logarithms
    of the segments' lengths, points. What is known has no column."""

    def __init__(
        self, state: RigState, seen: RigRays, lengths: SegmentLengths, free: Sequence[int] | None = None
    ) -> None:
        self._base, self._seen, self._lengths = state, seen, lengths
        cameras = len(seen.rays)
        known = np.isfinite(seen.rays).all(axis=3) & np.isfinite(state.points).all(axis=2)
        self._c, self._k, self._j = np.nonzero(known)
        self._have = known.any(axis=0)
        self._number = np.full(self._have.shape, -1)
        self._number[self._have] = np.arange(np.count_nonzero(self._have))
        self._free = np.arange(1, cameras) if free is None else np.array(free, dtype=np.int64)
        self._free_late = np.flatnonzero(seen.late_std[1:] > 0.0) + 1
        self._free_focal, self._free_radial = (np.flatnonzero(s > 0.0) for s in (seen.focal_std, seen.radial_std))
        own = len(self._free_late), len(self._free_focal), len(self._free_radial)
        sizes = [6 * len(self._free), *own, len(lengths.mean)]
        self._at = np.cumsum([0, *sizes])
        self._size = int(self._at[-1]) + 3 * int(np.count_nonzero(self._have))
        self._observed = seen.rays[self._c, self._k, self._j]
        self._slope = np.nan_to_num(seen.slope[self._c, self._k, self._j])
        self._std = seen.std[self._c, self._j]
        self._segments()

    def _segments(self) -> None:
        """Which segments are known in which frames, and what a metre of each weighs."""
        of = self._lengths
        frame, segment = np.nonzero(self._have[:, of.first] & self._have[:, of.second])
        self._ends = self._number[frame, of.first[segment]], self._number[frame, of.second[segment]]
        self._segment = segment
        self._stiff = (of.mean / np.hypot(_LENGTH, of.slack))[segment]
        self._alike = 0.5 * (of.mean[of.left] + of.mean[of.right]) / _SIDES

    @property
    def start(self) -> np.ndarray:
        """The vector of the state that it was made of."""
        x = np.zeros(self._size)
        x[self._at[1] : self._at[2]] = self._base.late[self._free_late]
        x[self._at[2] : self._at[3]] = np.log(self._base.focal[self._free_focal])
        x[self._at[3] : self._at[4]] = self._base.radial[self._free_radial]
        x[self._at[4] : self._at[5]] = np.log(self._base.lengths)
        x[self._at[5] :] = self._base.points[self._have].ravel()
        return x

    def state(self, x: np.ndarray) -> RigState:
        """The state of a vector."""
        moves, base = x[: self._at[1]].reshape(-1, 6), self._base
        R, t, late, focal, radial = (a.copy() for a in (base.R, base.t, base.late, base.focal, base.radial))
        R[self._free] = Rotation.from_rotvec(moves[:, :3]).as_matrix() @ R[self._free]
        t[self._free] += moves[:, 3:]
        late[self._free_late] = x[self._at[1] : self._at[2]]
        focal[self._free_focal] = np.exp(x[self._at[2] : self._at[3]])
        radial[self._free_radial] = x[self._at[3] : self._at[4]]
        points = np.full((*self._have.shape, 3), np.nan)
        points[self._have] = x[self._at[5] :].reshape(-1, 3)
        return RigState(R, t, late, focal, radial, np.exp(x[self._at[4] : self._at[5]]), points)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Counts of residuals: two per ray, of segments, and of given clocks, lenses and lengths."""
        state = self.state(x)
        seen, lengths, points = self._seen, self._lengths, x[self._at[5] :].reshape(-1, 3)
        place, _ = self._places(state)
        flat = bent(place, state.focal[self._c], state.radial[self._c])
        rays = flat - self._observed - self._slope * state.late[self._c, None]
        apart = np.linalg.norm(points[self._ends[0]] - points[self._ends[1]], axis=1)
        segments = (apart / state.lengths[self._segment] - 1.0) * self._stiff
        return np.concatenate([
            (rays / self._std[:, None]).ravel(), segments,
            state.late[self._free_late] / seen.late_std[self._free_late],
            np.log(state.focal[self._free_focal]) / seen.focal_std[self._free_focal],
            state.radial[self._free_radial] / seen.radial_std[self._free_radial],
            np.log(state.lengths / lengths.mean) / lengths.std,
            np.log(state.lengths[lengths.left] / state.lengths[lengths.right]) * self._alike,
        ])  # fmt: skip

    def _places(self, state: RigState) -> tuple[np.ndarray, np.ndarray]:
        """Points in the plane z = 1 (N, 2), and in the cameras (N, 3)."""
        at = np.einsum("nij,nj->ni", state.R[self._c], state.points[self._k, self._j]) + state.t[self._c]
        return at[:, :2] / np.maximum(at[:, 2:], _NEAREST), at

    def jacobian(self, x: np.ndarray) -> csr_matrix:
        """Derivatives of the residuals by the vector."""
        state, entries = self.state(x), _Entries()
        self._ray_entries(x, state, entries)
        rows = 2 * len(self._c)
        points = x[self._at[5] :].reshape(-1, 3)
        way = points[self._ends[0]] - points[self._ends[1]]
        apart = np.maximum(np.linalg.norm(way, axis=1), _TINY)
        stiff = self._stiff / state.lengths[self._segment]
        at = rows + np.arange(len(apart))
        slope = way * (stiff / apart)[:, None]
        for end, sign in zip(self._ends, (1.0, -1.0), strict=True):
            entries.add(at[:, None], self._at[5] + 3 * end[:, None] + np.arange(3), sign * slope)
        entries.add(at, self._at[4] + self._segment, -apart * stiff)
        rows += len(apart)
        told = (
            self._seen.late_std[self._free_late], self._seen.focal_std[self._free_focal],
            self._seen.radial_std[self._free_radial], self._lengths.std,
        )  # fmt: skip
        std = np.concatenate(told)
        entries.add(rows + np.arange(len(std)), self._at[1] + np.arange(len(std)), 1.0 / std)
        rows += len(std)
        for side, sign in ((self._lengths.left, 1.0), (self._lengths.right, -1.0)):
            entries.add(rows + np.arange(len(side)), self._at[4] + side, sign * self._alike)
        return entries.matrix(rows + len(self._alike), self._size)

    def _ray_entries(self, x: np.ndarray, state: RigState, entries: _Entries) -> None:
        place, at = self._places(state)
        c, rows = self._c, 2 * np.arange(len(self._c))[:, None] + np.arange(2)
        depth = np.maximum(at[:, 2], _NEAREST)
        of_place = by_place(place, state.focal[c], state.radial[c]) / (depth * self._std)[:, None, None]
        deeper = np.where(at[:, 2:] < _NEAREST, 0.0, -np.einsum("nij,nj->ni", of_place, place))
        of_point = np.concatenate([of_place, deeper[:, :, None]], axis=2)
        first = self._at[5] + 3 * self._number[self._k, self._j]
        entries.add(rows[:, :, None], first[:, None, None] + np.arange(3), of_point @ state.R[c])
        some = np.flatnonzero(np.isin(c, self._free))
        move = np.searchsorted(self._free, c[some])
        moves = x[: self._at[1]].reshape(-1, 6)
        turned = at[some] - state.t[c[some]]
        left = np.array([pin.Jexp3(-move[:3]) for move in moves]).reshape(-1, 3, 3)[move]
        by_turn = np.einsum("nxi,nij->nxj", np.cross(turned[:, None], of_point[some]), left)
        column = 6 * move[:, None, None]
        entries.add(rows[some][:, :, None], column + np.arange(3), by_turn)
        entries.add(rows[some][:, :, None], column + 3 + np.arange(3), of_point[some])
        for free, start, slope in (
            (self._free_late, self._at[1], -self._slope),
            (self._free_focal, self._at[2], bent(place, state.focal[c], state.radial[c])),
            (self._free_radial, self._at[3], by_radial(place, state.focal[c])),
        ):  # fmt: skip
            own = np.flatnonzero(np.isin(c, free))
            column = start + np.searchsorted(free, c[own])
            entries.add(rows[own], column[:, None], slope[own] / self._std[own, None])

    def normal_equations(self, x: np.ndarray, r: np.ndarray) -> tuple[csc_matrix, np.ndarray]:
        """Gauss and Newton's Hessian and gradient, residuals weighted by their tails."""
        J, weight = self.jacobian(x), robust_weights(r)
        return (J.T @ J.multiply(weight[:, None])).tocsc(), np.asarray(J.T @ (weight * r))

    def step(
        self, at: tuple[np.ndarray, np.ndarray], equations: tuple[csc_matrix, np.ndarray], damping: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """A step from a vector with its residuals, by its normal equations, to the next with its residuals."""
        A, g = equations
        x = at[0] - _factors(A + diags(damping * A.diagonal() + _TINY)).solve(g)
        return x, self.residuals(x)

    def chi(self, r: np.ndarray) -> float:
        """See `Adjusted`."""
        weight = robust_weights(r)
        return float(np.sqrt((weight * r * r).sum() / max(1.0, weight.sum() - self._size)))

    def uncertainty(self) -> RigUncertainty:
        """Evaluated at the state from which it was made."""
        count, J, weight = int(self._at[4]), self.jacobian(self.start), robust_weights(self.residuals(self.start))
        tall = np.zeros(self._size)
        tall[self._at[4] : self._at[5]] = self._lengths.mean / self._lengths.mean.sum()
        of_size = csr_matrix(tall)
        A = J.T @ J.multiply(weight[:, None]) + SIZE_KNOWN * (of_size.T @ of_size)
        columns = _factors(A + diags(_TINY * A.diagonal() + _TINY)).solve(np.eye(self._size, count))
        cameras = len(self._seen.rays)
        column = np.full((cameras, 7), -1)
        column[self._free, :6] = np.arange(self._at[1]).reshape(-1, 6)
        column[self._free_focal, 6] = np.arange(self._at[2], self._at[3])
        late, radial = np.zeros((2, cameras))
        stds = np.sqrt(np.maximum(np.diagonal(columns), 0.0))
        late[self._free_late] = stds[self._at[1] : self._at[2]]
        radial[self._free_radial] = stds[self._at[3] : self._at[4]]
        biases = self._by_bias(columns[:, column[column >= 0]], J, weight)
        return RigUncertainty.of(column, columns, biases, late, radial)

    def _by_bias(self, rows: np.ndarray, J: csr_matrix, weight: np.ndarray) -> np.ndarray:
        """The effect of biases of one deviation on the unknowns of the covariance's columns rows (n, K), (K,
        biases)."""
        joints, count = self._seen.std.shape[1], 2 * len(self._c)
        pull = (J @ rows)[:count] * weight[:count, None]
        bias = 2 * (self._c * joints + self._j)[:, None] + np.arange(2)
        which = csr_matrix((np.ones(count), (bias.ravel(), np.arange(count))), shape=(2 * self._seen.std.size, count))
        return np.asarray(BIAS * (which @ pull).T)


class _Entries:
    """Entries of a sparse matrix."""

    def __init__(self) -> None:
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        r, c, v = np.broadcast_arrays(rows, columns, values)
        self._parts.append((r.ravel(), c.ravel(), v.ravel()))

    def matrix(self, rows: int, columns: int) -> csr_matrix:
        r, c, v = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        return csr_matrix((v, (r, c)), shape=(rows, columns))
