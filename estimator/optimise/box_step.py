"""The damped step with bounds, solved on a guessed active set and certified by its KKT conditions."""

from __future__ import annotations

import numpy as np

from estimator.numerics.linear import eliminate, solve_definite
from humanoid.support.compiled import jit

NOT_CONVEX, UNSETTLED, FREE, BOUNDED = -1, 0, 1, 2  # verdicts on a step; FREE: no bound is active


@jit
def solve_box(M, g, lower, upper, active, rounds, step):  # type: ignore[no-untyped-def]
    """Minimise 1/2 x'Mx + g'x subject to lower <= x <= upper, M (n, n) positive definite; g, lower, upper (n,).

    `active` (n,) int: -1 at the lower bound, +1 at the upper, 0 free: the guess on entry, the last set tried on exit.
    Each round solves the free variables exactly; a set whose KKT conditions hold is the solution, otherwise violated
    variables become active and wrongly held ones free (a primal-dual active set iteration). Fills `step` (n,).
    Returns the rounds used if the solution is certified, 0 if not, -1 if M is not positive definite.
    """
    n = g.shape[0]
    L, free, x = np.zeros((n, n)), np.zeros(n, dtype=np.int64), np.zeros(n)
    scale = 0.0
    for i in range(n):
        scale = max(scale, abs(g[i]))
        # a bound that lies on the start is the usual guess: a step into it cannot move
        if (active[i] < 0 and lower[i] == -np.inf) or (active[i] > 0 and upper[i] == np.inf):
            active[i] = 0
    for sweep in range(1, rounds + 1):
        m = 0
        for i in range(n):
            if active[i] == 0:
                free[m] = i
                m += 1
            else:
                step[i] = lower[i] if active[i] < 0 else upper[i]
        for a in range(m):  # the system of the free variables with the others on their bounds
            i, t = free[a], -g[free[a]]
            if m < n:
                for k in range(n):
                    if active[k] != 0:
                        t -= M[i, k] * step[k]
            x[a] = t
        if not solve_definite(M, free, m, 0.0, L, x):
            return -1
        for a in range(m):
            step[free[a]] = x[a]
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

    M (n, n); g, lower, upper (n,): as in `solve_box`. A (m, n), b (m,).
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
def _certified(M, g, lower, upper, A, b, active, multipliers, step):  # type: ignore[no-untyped-def]
    """KKT conditions of min 1/2 x'Mx + g'x, lower <= x <= upper, A x >= b, at x = step, to rounding;
    multipliers (m,). The arrays: see `solve_sets`."""
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
def damped_step(H, g, damping, radius, q, places, limits, active, rounds, M, bounds, step):  # type: ignore[no-untyped-def]
    """The step from q (nq,) that minimises the damped model within joint limits and a trust box.

    H (nv, nv), g (nv,): the model. radius (nv,): half-width of the trust box. places (B, 2) int: where a bounded joint
    stands in q and in the tangent. limits (2, B): its lower and upper limit. active (nv,), rounds, step (nv,): see
    `solve_box`. M (nv, nv), bounds (2, nv): filled with the damped matrix H + damping diag(H) and the step's bounds.
    Returns a verdict, NOT_CONVEX, UNSETTLED, FREE or BOUNDED, `step` being the solution in the last two, and then the
    decrease that the undamped model promises of it, else 0.
    """
    n = g.shape[0]
    lower, upper = bounds[0], bounds[1]
    floor = 0.0
    for i in range(n):
        floor = max(floor, H[i, i])
    floor = max(1e-9, 1e-7 * floor)  # directions nothing is known of still get a finite step
    for i in range(n):
        lower[i], upper[i] = -radius[i], radius[i]
        for k in range(n):
            M[i, k] = H[i, k]
        M[i, i] += damping * max(H[i, i], floor) + 1e-12
    for b in range(places.shape[0]):
        k, i = places[b, 0], places[b, 1]
        lower[i] = max(lower[i], limits[0, b] - q[k])
        upper[i] = min(upper[i], limits[1, b] - q[k])
    settled = solve_box(M, g, lower, upper, active, rounds, step)
    if settled <= 0:
        return (NOT_CONVEX if settled < 0 else UNSETTLED), 0.0
    verdict = FREE
    for i in range(n):
        if active[i] != 0:
            verdict = BOUNDED
    return verdict, model_decrease(H, g, step)


@jit
def model_decrease(H, g, step):  # type: ignore[no-untyped-def]
    """Decrease -(g'x + 1/2 x'Hx) that the model g (n,), H (n, n) promises of a step x (n,)."""
    s = 0.0
    for i in range(g.shape[0]):
        row = 0.0
        for k in range(g.shape[0]):
            row += H[i, k] * step[k]
        s -= step[i] * (g[i] + 0.5 * row)
    return s


@jit
def projected_gradient(g, q, places, limits, residual):  # type: ignore[no-untyped-def]
    """Fill `residual` (nv,) with the part of the gradient g (nv,) that no bound balances; returns its largest entry.

    q (nq,), places, limits: see `damped_step`.
    """
    for i in range(g.shape[0]):
        residual[i] = g[i]
    for b in range(places.shape[0]):
        k, i = places[b, 0], places[b, 1]
        if q[k] <= limits[0, b]:
            residual[i] = min(residual[i], 0.0)
        if q[k] >= limits[1, b]:
            residual[i] = max(residual[i], 0.0)
    largest = 0.0
    for i in range(g.shape[0]):
        largest = max(largest, abs(residual[i]))
    return largest
