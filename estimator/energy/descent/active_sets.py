"""A step solved again on the sets of bounds and rows that a solver calls active, and certified by its KKT conditions.

A solver's last digits depend on what it did before and on where its memory lies; its sets do not, and what is solved
from them is exact to rounding, the same on every machine state.
"""

from __future__ import annotations

import numpy as np

from estimator.energy.descent.box_step import model_decrease, solve_box
from estimator.numerics.linear import eliminate
from humanoid.support.compiled import jit

ACTIVE = 1e-9  # multiplier, in the scaled problem, from which a bound or row is active


@jit
def settle(H, M, g, bounds, A, b, multipliers, active, rounds, step):  # type: ignore[no-untyped-def]
    """The step on the sets that multipliers name, if it satisfies the KKT conditions.

    min 1/2 x'Mx + g'x subject to bounds (2, n) and rows A x >= b, A (m, n), b (m,); H (n, n): the undamped matrix.
    multipliers (m + n,): of the rows, none positive, then of the bounds, negative at a lower, positive at an upper one.
    Fills `step` (n,) and `active` (n,), as in `solve_box`, whose operations these are where no row is active; there
    rounds beyond the first correct the sets. Returns whether the step is certified, and the decrease that the undamped
    model promises of it.
    """
    n, m = g.shape[0], b.shape[0]
    for i in range(n):
        z = multipliers[m + i]
        active[i] = 1 if z > ACTIVE else -1 if z < -ACTIVE else 0
    held = np.zeros(m, dtype=np.bool_)
    any_held = False
    for k in range(m):
        held[k] = multipliers[k] < -ACTIVE
        any_held = any_held or held[k]
    if any_held:
        certified = solve_sets(M, g, bounds[0], bounds[1], A, b, active, held, step)
    else:
        certified = solve_box(M, g, bounds[0], bounds[1], active, rounds, step) > 0 and _above(A, b, step)
    return certified, model_decrease(H, g, step) if certified else 0.0


@jit
def solve_sets(M, g, lower, upper, A, b, active, held, step):  # type: ignore[no-untyped-def]
    """Minimise 1/2 x'Mx + g'x with given sets: x on its `active` (n,) bounds, rows A x = b where `held` (m,) is true.

    M (n, n); g, lower, upper (n,): as in `solve_box`. A (m, n), b (m,).
    Fills `step` (n,) and returns whether it solves the problem with all bounds and all rows A x >= b.
    """
    n, m = g.shape[0], b.shape[0]
    f, r = 0, 0
    free, rows = np.zeros(n, dtype=np.int64), np.zeros(m, dtype=np.int64)
    for i in range(n):
        step[i] = 0.0
        if active[i] == 0:
            free[f] = i
            f += 1
        else:
            step[i] = lower[i] if active[i] < 0 else upper[i]
    for k in range(m):
        if held[k]:
            rows[r] = k
            r += 1
    size = f + r
    K, x = np.zeros((size, size)), np.zeros(size)
    for a in range(f):
        x[a] = -g[free[a]]
        for k in range(n):
            x[a] -= M[free[a], k] * step[k]
        for c in range(f):
            K[a, c] = M[free[a], free[c]]
        for c in range(r):
            K[a, f + c] = -A[rows[c], free[a]]
            K[f + c, a] = A[rows[c], free[a]]
    for c in range(r):
        x[f + c] = b[rows[c]]
        for k in range(n):
            x[f + c] -= A[rows[c], k] * step[k]
    if not eliminate(K, x):
        return False
    for a in range(f):
        step[free[a]] = x[a]
    multipliers = np.zeros(m)
    for c in range(r):
        multipliers[rows[c]] = x[f + c]
    return _certified(M, g, lower, upper, A, b, active, multipliers, step)


@jit
def _certified(M, g, lower, upper, A, b, active, multipliers, step):  # type: ignore[no-untyped-def]
    """KKT conditions of min 1/2 x'Mx + g'x, lower <= x <= upper, A x >= b, at x = step, to rounding;
    multipliers (m,). The arrays: see `solve_sets`."""
    n, m = g.shape[0], b.shape[0]
    scale = 1e-30
    for i in range(n):
        scale = max(scale, abs(g[i]))
    for k in range(m):
        if multipliers[k] < -1e-9 * scale:
            return False
    if not _above(A, b, step):
        return False
    for i in range(n):
        if active[i] == 0:
            if step[i] < lower[i] or step[i] > upper[i]:
                return False
            continue
        slope = g[i]
        for k in range(n):
            slope += M[i, k] * step[k]
        for k in range(m):
            slope -= A[k, i] * multipliers[k]
        if slope * active[i] > 1e-9 * scale:
            return False
    return True


@jit
def _above(A, b, step):  # type: ignore[no-untyped-def]
    """Whether rows A x >= b, A (m, n), b (m,), hold at x = step (n,), to rounding."""
    for k in range(b.shape[0]):
        value = 0.0
        for i in range(step.shape[0]):
            value += A[k, i] * step[i]
        if value < b[k] - 1e-10:
            return False
    return True
