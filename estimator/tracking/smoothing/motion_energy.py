"""Energy of the motion prior along poses of successive frames, with its gradient and Hessian."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.inference.motion import MotionPrior
from humanoid.kinematics.body import Body
from humanoid.kinematics.compiled_tree import FREE, CompiledTree, difference
from humanoid.support.compiled import jit


class Movements(NamedTuple):
    """M movements in a row, the i-th of which is a sum of S steps between successive frames from the i + `first`-th on.

    factors (M, S): of the steps. precision (M, nv): of each degree of freedom. share (M,): weight of each movement.
    """

    factors: np.ndarray
    precision: np.ndarray
    share: np.ndarray
    first: int = 0

    def of(self, steps: np.ndarray) -> np.ndarray:
        """The movements (M, nv) of steps (T - 1, nv)."""
        count = len(self.factors)
        rows = (steps[self.first + s : self.first + s + count] for s in range(self.factors.shape[1]))
        return np.asarray(sum(factor[:, None] * row for factor, row in zip(self.factors.T, rows, strict=True)))


class MotionEnergy:
    """Energy of poses that are dt (T - 1,) [s] apart; see `MotionPrior`."""

    def __init__(self, body: Body, prior: MotionPrior, dt: np.ndarray) -> None:
        self._steps = _CompiledSteps(body, body.compiled) if body.compiled is not None else _Steps(body)
        self._adding = np.setdiff1d(np.arange(body.nv), self._steps.turning)
        self._nu, self._rows = prior.nu, tuple(_movements(body, prior, dt))

    def add(self, q: np.ndarray, gradient: np.ndarray, blocks: np.ndarray, exact: bool = False) -> float:
        """Add to gradient (T, nv) and blocks (1 + K, T, nv, nv) at poses q (T, nq), block k of which couples frame t
        with frame t + k; return the energy. The Hessian is Gauss-Newton's with robust weights, or, with `exact`, has
        the potential's own curvature; that of the manifold is left out."""
        steps, turns = self._steps.between(q)
        energy = 0.0
        for moved in self._rows:
            values = moved.of(steps)
            energy += self._cost(moved, values)
            add_movements(
                values, moved.factors, moved.precision, moved.share, self._nu, exact, moved.first, turns, self._adding,
                self._steps.turning, gradient, blocks,
            )  # fmt: skip
        return energy

    def energy(self, q: np.ndarray) -> float:
        """The value that `add` returns, to the last bit, without derivatives."""
        steps, _ = self._steps.between(q)
        energy = 0.0
        for moved in self._rows:
            energy += self._cost(moved, moved.of(steps))
        return energy

    def _cost(self, moved: Movements, values: np.ndarray) -> float:
        square = moved.precision * np.square(values)
        return float(0.5 * self._nu * np.sum(moved.share[:, None] * np.log1p(square / self._nu)))


def _movements(body: Body, prior: MotionPrior, dt: np.ndarray) -> Iterator[Movements]:
    """Velocities, accelerations and their innovations, those that count."""
    if not len(dt):
        return
    pace = np.ones((len(dt) + 1, body.nv)) if prior.pace is None else prior.pace
    velocity = 1.0 / np.square(prior.velocity_std)
    rates = 1.0 / dt
    yield Movements(rates[:, None], np.tile(velocity, (len(dt), 1)), _shares(prior, dt))
    if len(dt) < 2:
        return
    span = 0.5 * (dt[1:] + dt[:-1])
    shares, precision = _shares(prior, span), 1.0 / np.square(prior.acceleration_std * pace[1:-1])
    accelerations = np.stack([-rates[:-1] / span, rates[1:] / span], axis=1)
    alone = slice(0, 1 if prior.memory > 0.0 else len(span))
    yield Movements(accelerations[alone], precision[alone], shares[alone])
    if prior.memory > 0.0:
        after, before = (factor[:, None] for factor in prior.innovation(span[1:]))
        new = np.zeros((len(span) - 1, 3))
        new[:, 1:] += after * accelerations[1:]
        new[:, :2] -= before * accelerations[:-1]
        yield Movements(new, precision[1:], shares[1:])


def _shares(prior: MotionPrior, dt: np.ndarray) -> np.ndarray:
    return np.array([prior.share(d) for d in dt.tolist()])


class _Steps:
    """Steps between poses, and their derivatives by those degrees of freedom whose steps do not just add up, which are
    those of a free root and of ball joints; by Pinocchio.

    turning (n,): these degrees of freedom.
    """

    def __init__(self, body: Body) -> None:
        self._model, self._turns = body.model, pin.Model()  # a model of the turning joints alone
        turning, places = list[int](), list[int]()
        for name, joint in list(zip(body.model.names, body.model.joints, strict=True))[1:]:
            if joint.nv > 1:
                self._turns.addJoint(0, joint, pin.SE3.Identity(), name)
                turning += range(joint.idx_v, joint.idx_v + joint.nv)
                places += range(joint.idx_q, joint.idx_q + joint.nq)
        self.turning, self._places = (np.array(i, dtype=np.int64) for i in (turning, places))

    def between(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps (T - 1, nv) between poses q (T, nq), and derivatives (T - 1, 2, n, n) by the pose before and after."""
        count, n = max(0, len(q) - 1), len(self.turning)
        steps = np.array([pin.difference(self._model, a, b) for a, b in pairwise(q)]).reshape(count, self._model.nv)
        turns = np.zeros((count, 2, n, n))
        if n:
            for t, pair in enumerate(pairwise(q[:, self._places])):
                turns[t] = pin.dDifference(self._turns, *pair)
        return steps, turns


class _CompiledSteps:
    """The same for a body with a `CompiledTree`."""

    def __init__(self, body: Body, tree: CompiledTree) -> None:
        self._indices, self._nv = tree.indices, body.nv
        free = self._indices[self._indices[:, 0] == FREE, 2]
        self.turning = (free[:, None] + np.arange(6)).ravel()

    def between(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `_Steps`."""
        count, n = max(0, len(q) - 1), len(self.turning)
        steps, turns = np.zeros((count, self._nv)), np.zeros((count, 2, n, n))
        fill_steps(self._indices, q, self.turning, steps, turns)
        return steps, turns


@jit
def fill_steps(indices, q, turning, steps, turns):  # type: ignore[no-untyped-def]
    """Fill steps (T - 1, nv), turns (T - 1, 2, n, n) of q (T, nq), see `_Steps`; indices (njoints - 1, 3):
    `CompiledTree.indices`, turning (n,)."""
    nv = steps.shape[1]
    back, slope = np.empty(nv), np.zeros((nv, nv))
    for t in range(steps.shape[0]):
        # the step back is the step's negative, so that its slope by where it ends is that by where the step begins
        for side in range(2 if turning.shape[0] else 1):
            if side == 0:
                difference(indices, q[t], q[t + 1], steps[t], slope)
            else:
                difference(indices, q[t + 1], q[t], back, slope)
            for a in range(turning.shape[0]):
                for b in range(turning.shape[0]):
                    entry = slope[turning[a], turning[b]]
                    turns[t, 1 - side, a, b] = -entry if side else entry


@jit
def add_movements(  # type: ignore[no-untyped-def]
    values, factors, precision, share, nu, exact, first, turns, adding, turning, gradient, blocks
):
    """Add to gradient (T, nv) and blocks (R, T, nv, nv) the derivatives of the movements' energy.

    values (M, nv), factors (M, S), precision (M, nv), share (M,), first: see `Movements`. turns (T - 1, 2, n, n): see
    `_Steps`. adding (A,), turning (n,): the degrees of freedom of either kind. exact: see `MotionEnergy.add`.
    """
    count, reach, nv, n = factors.shape[0], factors.shape[1] + 1, values.shape[1], turning.shape[0]
    rates, J, loaded = np.empty(reach), np.empty((reach, n, n)), np.empty((n, n))
    pull, stiff = np.empty(nv), np.empty(nv)
    for m in range(count):
        for i in range(nv):
            square = precision[m, i] * values[m, i] * values[m, i] / nu
            weight = share[m] * precision[m, i] / (1.0 + square)
            pull[i] = weight * values[m, i]
            stiff[i] = weight * (1.0 - square) / (1.0 + square) if exact else weight
        for k in range(reach):
            before = factors[m, k - 1] if k > 0 else 0.0
            after = factors[m, k] if k < reach - 1 else 0.0
            rates[k], t = before - after, first + m + k
            for a in range(n):
                for b in range(n):
                    J[k, a, b] = before * turns[t - 1, 1, a, b] if k > 0 else 0.0
                    if k < reach - 1:
                        J[k, a, b] += after * turns[t, 0, a, b]
        for k in range(reach):
            t = first + m + k
            for i in adding:
                gradient[t, i] += rates[k] * pull[i]
            for a in range(n):
                for b in range(n):
                    loaded[b, a] = J[k, a, b] * stiff[turning[a]]
                    gradient[t, turning[b]] += J[k, a, b] * pull[turning[a]]
            for j in range(k, reach):
                block, product = blocks[j - k, t], rates[k] * rates[j]
                for i in adding:
                    block[i, i] += product * stiff[i]
                for a in range(n):
                    for b in range(n):
                        s = 0.0
                        for c in range(n):
                            s += loaded[a, c] * J[j, c, b]
                        block[turning[a], turning[b]] += s
