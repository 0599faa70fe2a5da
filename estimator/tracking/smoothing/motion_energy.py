"""Energy of the motion prior along poses of successive frames, with its gradient and Gauss-Newton Hessian."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.inference.motion import MotionPrior
from humanoid.kinematics.body import Body
from humanoid.support.compiled import jit


class Movements(NamedTuple):
    """M movements in a row, the i-th of which depends on the frames from i + `first` on, K of them.

    values (M, nv). rates (M, K): derivatives of those degrees of freedom whose steps just add up, alike for all. turns
    (M, K, n, n): Jacobians of the n others, which are those of a free root and of ball joints.
    """

    values: np.ndarray
    rates: np.ndarray
    turns: np.ndarray
    first: int = 0

    def differences(self, span: np.ndarray) -> Movements:
        """Of each to the next, over span (M - 1,) [s]."""
        return self.mixed(1.0 / span, 1.0 / span)

    def mixed(self, after: np.ndarray, before: np.ndarray) -> Movements:
        """after (M - 1,) times the second and so on, less before (M - 1,) times the first and so on."""
        values = after[:, None] * self.values[1:] - before[:, None] * self.values[:-1]
        rates, turns = (
            _wider(part[1:], 1, 0) * _as(after, part) - _wider(part[:-1], 0, 1) * _as(before, part)
            for part in (self.rates, self.turns)
        )
        return Movements(values, rates, turns, self.first)

    def rows(self, rows: slice) -> Movements:
        """Some of them."""
        return Movements(self.values[rows], self.rates[rows], self.turns[rows], self.first + (rows.start or 0))


def _wider(part: np.ndarray, before: int, after: int) -> np.ndarray:
    """With so many frames more, on which it does not depend, before and after the others."""
    return np.pad(part, [(0, 0), (before, after), *[(0, 0)] * (part.ndim - 2)])


def _as(factor: np.ndarray, part: np.ndarray) -> np.ndarray:
    return factor.reshape(-1, *[1] * (part.ndim - 1))


class MotionEnergy:
    """Of poses that are dt (T - 1,) [s] apart; see `MotionPrior`."""

    def __init__(self, body: Body, prior: MotionPrior, dt: np.ndarray) -> None:
        self._body, self._prior, self._dt = body, prior, dt
        model = body.model
        self._turns, turning, places = pin.Model(), list[int](), list[int]()  # a model of what turns alone
        for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
            if joint.nv > 1:
                self._turns.addJoint(0, joint, pin.SE3.Identity(), name)
                turning += range(joint.idx_v, joint.idx_v + joint.nv)
                places += range(joint.idx_q, joint.idx_q + joint.nq)
        self._turning, self._turning_q = (np.array(i, dtype=np.int64) for i in (turning, places))
        self._adding = np.setdiff1d(np.arange(body.nv), self._turning)
        pace = np.ones((len(dt) + 1, body.nv)) if prior.pace is None else prior.pace
        self._velocity_precision = 1.0 / np.square(prior.velocity_std)
        self._acceleration_precision = 1.0 / np.square(prior.acceleration_std * pace[1:-1])

    def add(self, q: np.ndarray, gradient: np.ndarray, blocks: np.ndarray) -> float:
        """Add to gradient (T, nv) and blocks (1 + K, T, nv, nv) at poses q (T, nq), block k of which couples frame t
        with frame t + k; return the energy."""
        energy = 0.0
        for moved, precision, share in self._moved(q, turning=True):
            self._add(moved, precision, share, gradient, blocks)
            energy += self._cost(moved, precision, share)
        return energy

    def energy(self, q: np.ndarray) -> float:
        """What `add` returns, to the last bit, without derivatives."""
        energy = 0.0
        for moved, precision, share in self._moved(q, turning=False):
            energy += self._cost(moved, precision, share)
        return energy

    def _moved(self, q: np.ndarray, *, turning: bool) -> Iterator[tuple[Movements, np.ndarray, np.ndarray]]:
        """Velocities, accelerations and what is new in these, those that count, each with its precision, (nv,) or
        (M, nv), and its share (M,); with the Jacobians of what turns where these are asked for."""
        if len(q) < 2:
            return
        velocities = self._velocities(q, turning=turning)
        yield velocities, self._velocity_precision, self._shares(self._dt)
        if len(q) < 3:
            return
        span = 0.5 * (self._dt[1:] + self._dt[:-1])
        shares, precision = self._shares(span), self._acceleration_precision
        accelerations = velocities.differences(span)
        alone = slice(0, 1 if self._prior.memory > 0.0 else len(span))
        yield accelerations.rows(alone), precision[alone], shares[alone]
        if self._prior.memory > 0.0:
            yield accelerations.mixed(*self._prior.innovation(span[1:])), precision[1:], shares[1:]

    def _cost(self, moved: Movements, precision: np.ndarray, share: np.ndarray) -> float:
        square, nu = precision * np.square(moved.values), self._prior.nu
        return float(0.5 * nu * np.sum(share[:, None] * np.log1p(square / nu)))

    def _shares(self, dt: np.ndarray) -> np.ndarray:
        return np.array([self._prior.share(d) for d in dt.tolist()])

    def _velocities(self, q: np.ndarray, *, turning: bool) -> Movements:
        model, rate = self._body.model, 1.0 / self._dt
        values = rate[:, None] * np.array([pin.difference(model, a, b) for a, b in pairwise(q)])
        count = len(self._turning) if turning else 0
        turns = np.zeros((len(rate), 2, count, count))
        if count:
            for t, pair in enumerate(pairwise(q[:, self._turning_q])):
                turns[t] = pin.dDifference(self._turns, *pair)
            turns *= rate[:, None, None, None]
        return Movements(values, np.stack([-rate, rate], axis=1), turns)

    def _add(
        self, moved: Movements, precision: np.ndarray, share: np.ndarray, gradient: np.ndarray, blocks: np.ndarray
    ) -> None:
        """Add the derivatives of what movements cost, of precision (nv,) or (M, nv), each counted by its share (M,)."""
        square, nu = precision * np.square(moved.values), self._prior.nu
        weight = share[:, None] * precision / (1.0 + square / nu)
        add_movements(
            moved.values, moved.rates, moved.turns, moved.first, weight, self._adding, self._turning, gradient, blocks
        )


@jit
def add_movements(values, rates, turns, first, weight, adding, turning, gradient, blocks):  # type: ignore[no-untyped-def]
    """Add to gradient (T, nv) and blocks (R, T, nv, nv) the derivatives of 1/2 weight times squares of movements.

    values, weight (M, nv), rates (M, K), turns (M, K, n, n), first: see `Movements`. adding (A,), turning (n,): the
    degrees of freedom of rates and of turns.
    """
    count, reach, n = turns.shape[0], turns.shape[1], turns.shape[2]
    loaded = np.empty((n, n))
    for m in range(count):
        for k in range(reach):
            t, rate, J = first + m + k, rates[m, k], turns[m, k]
            for i in adding:
                gradient[t, i] += rate * (weight[m, i] * values[m, i])
            for a in range(n):
                w = weight[m, turning[a]]
                for b in range(n):
                    loaded[b, a] = J[a, b] * w
                    gradient[t, turning[b]] += J[a, b] * (w * values[m, turning[a]])
            for j in range(k, reach):
                block, product, other = blocks[j - k, t], rate * rates[m, j], turns[m, j]
                for i in adding:
                    block[i, i] += product * weight[m, i]
                for a in range(n):
                    row = block[turning[a]]
                    for b in range(n):
                        s = 0.0
                        for c in range(n):
                            s += loaded[a, c] * other[c, b]
                        row[turning[b]] += s
