"""The constrained step of a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.numerics.quadratic_program import UNBOUNDED, QuadraticProgram, solve

TRUST = 0.4
"""[rad or m] A frame's step: what stands may be far from where the body is, and rows are linear."""
STANDING = 1e7  # energy by m^2 of a foot that cannot be where it stands
SHORT = 1e8  # energy by m^2 of parts that cannot be as far from each other, or the floor, as they have to
_ACCURACY, _ITERATIONS = 1e-6, 60


class StepRows(NamedTuple):
    """What a step dx has to meet: equal dx = to, equal (m, nv) and to (m,), and above dx >= least, (k, nv) and (k,)."""

    equal: np.ndarray
    to: np.ndarray
    above: np.ndarray
    least: np.ndarray


def constrained_step(
    hessian: np.ndarray, gradient: np.ndarray, box: np.ndarray, rows: StepRows
) -> tuple[np.ndarray, bool]:
    """The step (n,) that minimises 1/2 dx'H dx + g'dx, within its box (2, n) to the last bit, and whether it meets the
    rows.

    Where nothing does, what stands counts as an energy; where that does not help either, all of `above` may fall short
    by as little as there can be.
    """
    program = QuadraticProgram(hessian, gradient, *rows, np.full(len(rows.least), UNBOUNDED), *box)
    answer = solve(program, _ACCURACY, _ITERATIONS)
    met = answer.solved
    if not met:
        program = program.softened(STANDING)
        answer = solve(program, _ACCURACY, _ITERATIONS)
    if not answer.solved:
        answer = solve(_falling_short(program), _ACCURACY, _ITERATIONS)
    x = answer.x[: len(gradient)] if answer.solved else np.zeros(len(gradient))
    return np.clip(x, box[0], box[1]), met


def _falling_short(program: QuadraticProgram) -> QuadraticProgram:
    """With rows x + s >= least, s as small as can be: a variable more. There are no equations."""
    n = len(program.gradient)
    hessian = np.zeros((n + 1, n + 1))
    hessian[:n, :n], hessian[n, n] = program.hessian, SHORT
    return program._replace(
        hessian=hessian, gradient=np.append(program.gradient, 0.0), equal=np.zeros((0, n + 1)),
        rows=np.column_stack([program.rows, np.ones(len(program.least))]),
        low=np.append(program.low, 0.0), high=np.append(program.high, np.inf),
    )  # fmt: skip
