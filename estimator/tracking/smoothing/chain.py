"""Poses of successive frames tied by a motion prior: Newton's method on the block-banded system, limits as bounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky_banded, solveh_banded
from scipy.linalg.lapack import dtbtrs

from estimator.energy.cost import Cost
from estimator.energy.descent.solution import free_mask
from estimator.inference.motion import MotionPrior, frame_shares
from estimator.numerics.newton import Damping, NewtonSettings, Problem, Step, minimise
from estimator.tracking.smoothing.motion_energy import MotionEnergy
from estimator.tracking.smoothing.ties import Ties
from estimator.tracking.smoothing.window_energy import WindowEnergy, moved_poses
from humanoid.kinematics.body import SHORTEST_STEP, Body
from humanoid.support.compiled import jit

DAMPING = Damping(first=1e-6, grown_from=1e-5)
_EXACT_BELOW = 2e-3  # energy a frame that a step promises
_SOLVED = 4  # times at most for one step, with ever more variables at their limits
_BEYOND = 1e-6  # rad or m from which a step is clearly beyond a limit
_LEAST = 1e-4  # precision of unconstrained directions
_TOGETHER = 16  # frames whose energies are found at once, where only their sum is needed
REACH = 3
"""Frames before and after some that these are tied to: innovations of accelerations reach that far."""


def windows(count: int, size: int) -> Iterator[tuple[int, int, int, int]]:
    """Windows of a number of frames, which overlap by half: the first frame and that after the last, and the same with
    the adjacent frames that the window is tied to."""
    half = max(1, size // 2)
    for first in range(0, max(1, count - half), half):
        last = min(count, first + size)
        yield first, last, max(0, first - REACH), min(count, last + REACH)


class ChainModel(NamedTuple):
    """Quadratic model of a chain's energy at poses q (T, nq).

    gradient (T, nv). blocks (1 + REACH, T, nv, nv): of the Hessian; block k couples frame t with frame t + k. exact:
    whether that has the curvature that Gauss-Newton's leaves out.
    """

    value: float
    q: np.ndarray
    gradient: np.ndarray
    blocks: np.ndarray
    exact: bool = False


class FrameChain:
    """Frames tied by the motion prior.

    costs (T): static energy of each frame. times (T,) [s], rising. tolerance: energy that a step must gain.
    ties (T - 1): image terms for the movement from each frame to the next; none by default.
    """

    def __init__(
        self,
        body: Body,
        costs: Sequence[Cost],
        times: np.ndarray,
        motion: MotionPrior,
        tolerance: float,
        ties: Sequence[Ties] | None = None,
    ) -> None:
        self._body, self._costs, self._tolerance = body, costs, tolerance
        self._ties: Sequence[Ties] = ties if ties is not None else [()] * (len(costs) - 1)
        self._dt = np.maximum(np.diff(times), SHORTEST_STEP)
        self._motion = MotionEnergy(body, motion, self._dt)

    def energy(self, q: np.ndarray) -> float:
        """Energy of poses (T, nq): `ChainModel.value` to the last bit, in memory that does not grow with them."""
        own, tied = list[float](), list[float]()
        for first in range(0, len(q), _TOGETHER):
            last = min(len(q), first + _TOGETHER)
            part = slice(first, min(len(q), last + 1))  # with the frame that the last one is tied to
            window = WindowEnergy(self._body, self._costs[part], self._ties[first : part.stop - 1])
            values, pairs = window.values(q[part])
            own += values[: last - first].tolist()
            tied += pairs[: last - first].tolist()
        return _sum(own, tied) + self._motion.energy(q)

    def descend(self, q: np.ndarray, held: np.ndarray, iterations: int) -> np.ndarray:
        """A limited number of damped Newton steps from q (T, nq), after which the energy is no higher; the frames in
        `held` (T,) stay."""
        newton = NewtonSettings(iterations, DAMPING, enough=self._tolerance)
        return minimise(_Poses(self, held), self._model(q), newton).model.q

    def covariances(
        self, q: np.ndarray, lasting: float, prior: np.ndarray | None = None, frames: ChainModel | None = None
    ) -> np.ndarray:
        """Covariances (T, nv, nv) of poses q (T, nq), each given all frames, in its own tangent space: of the energy's
        Gauss-Newton Hessian, zero where a pose leans on a limit.

        lasting [s]: correlation time of a frame's evidence and of its errors. Frames nearer than that count as much
        less as they are nearer, as movements do by the prior's correlation. 0: each counts in full. prior (T, nv, nv):
        the part of each frame's Hessian that does not depend on observations. Successive poses are nearly the same and
        it must count once: it is added to each pose alone, beside the others' likelihood. frames: what `of_frames` has
        at q, where that is known; it is used up.

        Raises
        ------
        numpy.linalg.LinAlgError: a pose is not constrained.
        """
        model = self.of_frames(q) if frames is None else frames
        share = frame_shares(self._dt, lasting)
        moving, blocks = np.zeros_like(model.gradient), model.blocks
        if prior is not None:
            blocks[0] -= prior
        blocks[0] *= share[:, None, None]
        blocks[1, :-1] *= np.sqrt(share[:-1] * share[1:])[:, None, None]  # no tie reaches farther
        self._motion.add(q, moving, blocks)
        free = free_mask(self._body, q, share[:, None] * model.gradient + moving)
        both = free[:, :, None] & free[:, None, :]
        told = inverse_diagonal(_definite(blocks, free, blocks)) * both
        if prior is not None:
            told = np.linalg.solve(np.eye(self._body.nv) + told @ (prior * both), told)
        return 0.5 * (told + told.transpose(0, 2, 1))

    def draw(self, q: np.ndarray, count: int, rng: np.random.Generator, frames: ChainModel | None = None) -> np.ndarray:
        """Movements (T, nv, count) away from q (T, nq), drawn from the normal density that has the energy's
        Gauss-Newton Hessian there; none of variables that a limit stops. frames: what `of_frames` has at q, where that
        is known.

        Raises
        ------
        numpy.linalg.LinAlgError: it is not positive definite.
        """
        model = (
            self.of_frames(q)
            if frames is None
            else frames._replace(gradient=frames.gradient.copy(), blocks=frames.blocks.copy())
        )
        self._motion.add(q, model.gradient, model.blocks)
        free = free_mask(self._body, q, model.gradient)
        bands = _banded(model.blocks, free, added=_LEAST)
        del model
        factor = cholesky_banded(bands, overwrite_ab=True, lower=True, check_finite=False)
        moved, _ = dtbtrs(factor, rng.standard_normal((free.size, count)), uplo="L", trans="T")
        return np.asarray(moved).reshape(*free.shape, count) * free[:, :, None]

    def _model(self, q: np.ndarray, exact: bool = False) -> ChainModel:
        value, _, gradient, blocks = self.of_frames(q, exact)[:4]
        value += self._motion.add(q, gradient, blocks, exact)
        return ChainModel(value, q, gradient, blocks, exact)

    def plain(self, model: ChainModel) -> ChainModel:
        """The Gauss-Newton model where an exact one is."""
        return self._model(model.q)

    def of_frames(self, q: np.ndarray, exact: bool = False) -> ChainModel:
        """The model of the frames and their ties, without the motion prior."""
        count, nv = len(q), self._body.nv
        gradient, blocks = np.zeros((count, nv)), np.zeros((1 + REACH, count, nv, nv))
        own, tied = self._window.add(q, gradient, blocks, exact)
        return ChainModel(_sum(own.tolist(), tied.tolist()), q, gradient, blocks)

    @cached_property
    def _window(self) -> WindowEnergy:
        return WindowEnergy(self._body, self._costs, self._ties)

    def at(self, q: np.ndarray, step: np.ndarray, exact: bool = False) -> ChainModel:
        """The energy's model after a step (T, nv) from q (T, nq); a frame that stays keeps its bits."""
        return self._model(moved_poses(self._body, q, step), exact)

    def step(self, model: ChainModel, held: np.ndarray, damping: float) -> np.ndarray:
        """Damped Newton step (T, nv) of the variables that neither a limit nor `held` (T,) stops; those that it would
        take beyond their limits end there, and the others are solved for again."""
        free = free_mask(self._body, model.q, model.gradient) & ~held[:, None]
        step = np.zeros_like(model.gradient)
        for left in reversed(range(_SOLVED)):
            right = model.gradient + product(model.blocks, step) if step.any() else model.gradient
            bands = _banded(model.blocks, free, factor=1.0 + damping)
            right = np.where(free, -right, 0.0).ravel()
            solved = solveh_banded(bands, right, lower=True, check_finite=False, overwrite_ab=True)
            step = np.where(free, np.asarray(solved).reshape(step.shape), step)
            beyond, ends = self._beyond(model.q, step)
            if not left or not np.any(beyond & free):
                break
            free &= ~beyond
            step = np.where(free, 0.0, np.where(beyond, ends, step))
        return step

    def _beyond(self, q: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which variables (T, nv) a step (T, nv) from q (T, nq) takes clearly beyond their limits, and steps there."""
        places, body = self._body.bounded_q, self._body
        beyond, ends = np.zeros(step.shape, dtype=bool), np.zeros_like(step)
        moved = step[:, body.bounded_v]
        inside = np.clip(moved, body.lower[places] - q[:, places], body.upper[places] - q[:, places])
        beyond[:, body.bounded_v], ends[:, body.bounded_v] = np.abs(inside - moved) > _BEYOND, inside
        return beyond, ends


class _Poses(Problem[ChainModel]):
    """A chain in which the frames in `held` (T,) stay.

    Gauss-Newton's steps are safe and converge slowly: neither the curvature of robust potentials nor that of the
    kinematics is in them. Once a step promises little, the next model is exact. Where that has no minimum, or its step
    leads uphill, Gauss-Newton's step is taken instead, and the next model is exact where a step promises a tenth of it.
    """

    def __init__(self, chain: FrameChain, held: np.ndarray) -> None:
        self._chain, self._held, self._exact_below = chain, held, _EXACT_BELOW * len(held)
        self._tried: ChainModel | None = None  # the last one used for a step
        self._plain: ChainModel | None = None  # Gauss-Newton's in its place, where it is exact and has failed
        self._promised: float | None = None
        self._last_promise = 0.0  # of the step to the last trial

    def step(self, model: ChainModel, damping: float) -> Step | None:
        """The expected gain is that of a model's first step: a smaller one by more damping does not end the search."""
        refused, self._tried = self._tried is model, model
        if not refused:
            self._plain = self._promised = None
        if model.exact and self._plain is None:
            step = None if refused else self._solved(model, damping)
            if step is not None:
                return step
            self._exact_below = 0.1 * self._last_promise
            self._plain, self._promised, damping = self._chain.plain(model), None, DAMPING.first
        return self._solved(self._plain or model, damping)

    def _solved(self, model: ChainModel, damping: float) -> Step | None:
        try:
            step = self._chain.step(model, self._held, damping)
        except np.linalg.LinAlgError:  # not positive definite
            return None
        if self._promised is None:
            self._promised = -0.5 * float(np.sum(step * model.gradient))
        return step, self._promised

    def at(self, model: ChainModel, step: Step) -> ChainModel:
        assert step[1] is not None
        self._last_promise = step[1]
        return self._chain.at(model.q, step[0], exact=step[1] < self._exact_below)


def _sum(*rows: list[float]) -> float:
    """One number after the other."""
    total = 0.0
    for row in rows:
        for value in row:
            total += value
    return total


def _definite(blocks: np.ndarray, free: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Blocks (1 + REACH, T, nv, nv), in `out`, which may be the blocks themselves, with rows and columns of the
    identity for variables that are not free (T, nv), and a little more than nothing for those that nothing holds."""
    np.multiply(blocks, free[None, :, :, None], out=out)
    for k in range(len(blocks)):
        out[k, : max(0, len(free) - k)] *= free[k:, None, :]
    np.einsum("tii->ti", out[0])[:] += np.where(free, _LEAST, 1.0)
    return out


def _banded(blocks: np.ndarray, free: np.ndarray, factor: float = 1.0, added: float = 0.0) -> np.ndarray:
    """Lower banded form of the symmetric matrix whose blocks (t, t + k) are `blocks[k, t]`, with rows and columns of
    the identity for variables that are not free (T, nv), and the diagonal of the others times a factor plus a
    number."""
    _, count, nv, _ = blocks.shape
    bands = np.zeros((len(blocks) * nv, count * nv), order="F")  # as LAPACK has them, which then needs no copy
    fill_bands(blocks, free, factor, added, bands.T)
    return bands


def product(blocks: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The symmetric matrix of blocks (K, T, nv, nv), see `ChainModel`, times x (T, nv)."""
    out = np.zeros_like(x)
    add_product(blocks, x, out)
    return out


@jit
def add_product(blocks, x, out):  # type: ignore[no-untyped-def]
    """Add `product` of blocks (K, T, nv, nv) and x (T, nv) to out (T, nv)."""
    reach, count, nv = blocks.shape[0], blocks.shape[1], blocks.shape[2]
    for k in range(reach):
        for t in range(count - k):
            for i in range(nv):
                for j in range(nv):
                    out[t, i] += blocks[k, t, i, j] * x[t + k, j]
                    if k > 0:
                        out[t + k, j] += blocks[k, t, i, j] * x[t, i]


@jit
def fill_bands(blocks, free, factor, added, columns):  # type: ignore[no-untyped-def]
    """Fill columns (N, M) of `_banded`, N = T nv, M = K nv, zero before, from blocks (K, T, nv, nv), free (T, nv)."""
    reach, count, nv = blocks.shape[0], blocks.shape[1], blocks.shape[2]
    for t in range(count):
        for i in range(nv):
            column = columns[t * nv + i]
            if not free[t, i]:
                column[0] = 1.0
                continue
            for k in range(min(reach, count - t)):
                row = blocks[k, t, i]
                for j in range(i if k == 0 else 0, nv):
                    if free[t + k, j]:
                        column[k * nv + j - i] = row[j]
            column[0] = factor * column[0] + added


def inverse_diagonal(blocks: np.ndarray) -> np.ndarray:
    """The diagonal blocks (T, n, n) of the inverse of a positive definite matrix of T x T blocks.

    blocks (1 + B, T, n, n): block k of row t is at column t + k; those beyond the last column do not count. The block
    factors L D L' forwards, then the entries of the inverse within the band backwards, without any others (K.
    Takahashi, J. Fagan, M.-S. Chin, Formation of a sparse bus impedance matrix, PICA 1973).

    Raises
    ------
    numpy.linalg.LinAlgError: it is not positive definite.
    """
    inverse, factors = _factors(blocks)
    reach, count, n = len(blocks) - 1, *blocks.shape[1:3]
    # [k, 0]: of the inverse, at row t and column t + k; [k, i]: the same of row t + i, which are all that row t needs
    within = np.zeros((1 + reach, 1 + reach, n, n))
    for t in range(count - 1, -1, -1):
        within[:, 1:] = within[:, :-1].copy()
        within[:, 0] = 0.0
        for k in range(1, reach + 1):
            for j in range(1, reach + 1):
                entry = within[k - j, j] if k >= j else within[j - k, k].T
                within[k, 0] -= factors[j - 1, t].T @ entry
        within[0, 0] = inverse[t] - sum(factors[k - 1, t].T @ within[k, 0].T for k in range(1, reach + 1))
        within[0, 0] = 0.5 * (within[0, 0] + within[0, 0].T)
        inverse[t] = within[0, 0]
    return inverse


def _factors(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (T, n, n) of the blocks of D, and blocks (B, T, n, n) of L below these: [k, t] at row t + k + 1, column
    t."""
    reach, count, n = len(blocks) - 1, *blocks.shape[1:3]
    factors, inverse = np.zeros((reach, count, n, n)), np.zeros((count, n, n))
    left = blocks[:, : 1 + reach].copy()  # what is left of the columns from t on, as far as column t reaches
    for t in range(count):
        inverse[t] = cho_solve(cho_factor(left[0, 0], lower=True), np.eye(n))
        for k in range(1, min(reach, count - 1 - t) + 1):
            factors[k - 1, t] = left[k, 0].T @ inverse[t]
            for j in range(k, min(reach, count - 1 - t) + 1):
                left[j - k, k] -= factors[k - 1, t] @ left[j, 0]
        left[:, :-1] = left[:, 1:].copy()
        if t + 1 + reach < count:
            left[:, -1] = blocks[:, t + 1 + reach]
    return inverse, factors
