"""The damped step with bounds, solved on a guessed active set and certified by its KKT conditions."""

from __future__ import annotations

import math

import numpy as np

from humanoid.support.compiled import jit


@jit
def solve_box(M, g, lower, upper, active, rounds, step):  # type: ignore[no-untyped-def]
    """Minimise 1/2 x'Mx + g'x subject to lower <= x <= upper, M (n, n) positive definite.

    `active` (n,) int: -1 at the lower bound, +1 at the upper, 0 free: the guess on entry, the last set tried on exit.
    Each round solves the free variables exactly; a set whose KKT conditions hold is the solution, otherwise violated
    variables become active and wrongly held ones free (a primal-dual active set iteration). Fills `step` (n,).
    Returns the rounds used if the solution is certified, 0 if not, -1 if M is not positive definite.
    """
    n = g.shape[0]
    L = np.zeros((n, n))
    free = np.zeros(n, dtype=np.int64)
    rhs = np.zeros(n)
    for i in range(n):
        # a bound that lies on the start is the usual guess: a step into it cannot move
        if (active[i] < 0 and lower[i] == -np.inf) or (active[i] > 0 and upper[i] == np.inf):
            active[i] = 0
    scale = 0.0
    for i in range(n):
        scale = max(scale, abs(g[i]))
    for sweep in range(1, rounds + 1):
        m = 0
        for i in range(n):
            if active[i] == 0:
                free[m] = i
                m += 1
            else:
                step[i] = lower[i] if active[i] < 0 else upper[i]
        for a in range(m):
            i = free[a]
            s = -g[i]
            if m < n:
                for k in range(n):
                    if active[k] != 0:
                        s -= M[i, k] * step[k]
            rhs[a] = s
            for b in range(a + 1):  # Cholesky, row by row
                t = M[i, free[b]]
                for c in range(b):
                    t -= L[a, c] * L[b, c]
                if a == b:
                    if t <= 0.0:
                        return -1
                    L[a, a] = math.sqrt(t)
                else:
                    L[a, b] = t / L[b, b]
        for a in range(m):
            t = rhs[a]
            for b in range(a):
                t -= L[a, b] * rhs[b]
            rhs[a] = t / L[a, a]
        for a in range(m - 1, -1, -1):
            t = rhs[a]
            for b in range(a + 1, m):
                t -= L[b, a] * rhs[b]
            rhs[a] = t / L[a, a]
            step[free[a]] = rhs[a]
        certified = True
        for i in range(n):
            if active[i] == 0:
                if step[i] < lower[i]:
                    active[i] = -1
                    certified = False
                elif step[i] > upper[i]:
                    active[i] = 1
                    certified = False
            else:
                slope = g[i]
                for k in range(n):
                    slope += M[i, k] * step[k]
                if slope * active[i] > 1e-12 * scale:  # the multiplier has the wrong sign
                    active[i] = 0
                    certified = False
        if certified:
            return sweep
    return 0


@jit
def solve_sets(M, g, lower, upper, A, b, active, held, step):  # type: ignore[no-untyped-def]
    """Minimise 1/2 x'Mx + g'x with given sets: x on its `active` (n,) bounds, rows A x = b where `held` (m,) is true.

    Fills `step` (n,) and returns whether it solves the problem with all bounds and all rows A x >= b: a solver's sets
    become a solution exact to rounding, the same on every machine state, or are found wanting.
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
def eliminate(K, x):  # type: ignore[no-untyped-def]
    """Solve K x = x in place by Gaussian elimination with partial pivoting; False if K is singular."""
    n = x.shape[0]
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(K[i, k]) > abs(K[p, k]):
                p = i
        if abs(K[p, k]) < 1e-300:
            return False
        if p != k:
            for j in range(n):
                K[k, j], K[p, j] = K[p, j], K[k, j]
            x[k], x[p] = x[p], x[k]
        for i in range(k + 1, n):
            w = K[i, k] / K[k, k]
            if w != 0.0:
                for j in range(k, n):
                    K[i, j] -= w * K[k, j]
                x[i] -= w * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= K[k, j] * x[j]
        x[k] /= K[k, k]
    return True


@jit
def _certified(M, g, lower, upper, A, b, active, multipliers, step):  # type: ignore[no-untyped-def]
    """KKT conditions of min 1/2 x'Mx + g'x, lower <= x <= upper, A x >= b, at x = step, to rounding."""
    n, m = g.shape[0], b.shape[0]
    scale = 1e-30
    for i in range(n):
        scale = max(scale, abs(g[i]))
    for k in range(m):
        value = 0.0
        for i in range(n):
            value += A[k, i] * step[i]
        if value < b[k] - 1e-10 or multipliers[k] < -1e-9 * scale:
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
def damped_step(  # type: ignore[no-untyped-def]
    H, g, damping, radius, q, bounded_q, bounded_v, lower_q, upper_q, active, rounds, M, lower, upper, step
):
    """Form M = H + damping diag(H) and the bounds of a step from q, then `solve_box`.

    The bounds are the joint limits and a trust box of half-width `radius` (nv,). Returns solve_box's verdict and the
    decrease -(g'x + 1/2 x'Hx) that the undamped model predicts.
    """
    n = g.shape[0]
    floor = 0.0
    for i in range(n):
        floor = max(floor, H[i, i])
    floor = max(1e-9, 1e-7 * floor)  # directions nothing is known of still get a finite step
    for i in range(n):
        lower[i], upper[i] = -radius[i], radius[i]
        for k in range(n):
            M[i, k] = H[i, k]
        M[i, i] += damping * max(H[i, i], floor) + 1e-12
    for b in range(bounded_v.shape[0]):
        i, k = bounded_v[b], bounded_q[b]
        lower[i] = max(lower[i], lower_q[k] - q[k])
        upper[i] = min(upper[i], upper_q[k] - q[k])
    return solve_box(M, g, lower, upper, active, rounds, step)


@jit
def model_decrease(H, g, step):  # type: ignore[no-untyped-def]
    """Decrease -(g'x + 1/2 x'Hx) of the quadratic model."""
    s = 0.0
    for i in range(g.shape[0]):
        row = 0.0
        for k in range(g.shape[0]):
            row += H[i, k] * step[k]
        s -= step[i] * (g[i] + 0.5 * row)
    return s


@jit
def projected_gradient(g, q, bounded_q, bounded_v, lower_q, upper_q, residual):  # type: ignore[no-untyped-def]
    """Fill `residual` (nv,) with the part of the gradient that no bound balances; returns its largest entry."""
    for i in range(g.shape[0]):
        residual[i] = g[i]
    for b in range(bounded_v.shape[0]):
        i, k = bounded_v[b], bounded_q[b]
        if q[k] <= lower_q[k]:
            residual[i] = min(residual[i], 0.0)
        if q[k] >= upper_q[k]:
            residual[i] = max(residual[i], 0.0)
    largest = 0.0
    for i in range(g.shape[0]):
        largest = max(largest, abs(residual[i]))
    return largest
