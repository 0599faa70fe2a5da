"""The damped step with bounds, solved on a guessed active set and certified by its KKT conditions."""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.linear import inverse_entries, invert_definite, solve_definite
from humanoid.support.compiled import jit

_NEAR = 0.1  # standard deviations of an unknown, the others held, from a bound that it may yet meet
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
def free_minimum(M, g, step):  # type: ignore[no-untyped-def]
    """Fill `step` (n,) with the minimum of 1/2 x'Mx + g'x, M (n, n), g (n,); False if M is not positive definite.

    To the last bit what `solve_box` does where no bound is active.
    """
    n = g.shape[0]
    rows, L = np.arange(n), np.zeros((n, n))
    for i in range(n):
        step[i] = -g[i]
    return solve_definite(M, rows, n, 0.0, L, step)


@jit
def damped_model(H, g, damping, radius, q, places, limits, M, bounds):  # type: ignore[no-untyped-def]
    """Fill M (nv, nv) with the damped matrix H + damping diag(H), bounds (2, nv) with those of the step from q (nq,).

    H (nv, nv), g (nv,): the model. radius (nv,): half-width of the trust box. places (B, 2) int: where a bounded joint
    stands in q and in the tangent. limits (2, B): its lower and upper limit.
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


@jit
def damped_step(H, g, damping, radius, q, places, limits, active, rounds, M, bounds, step):  # type: ignore[no-untyped-def]
    """The step from q (nq,) that minimises the damped model within joint limits and a trust box, by `solve_box`.

    active (nv,), rounds, step (nv,): see there; the others: see `damped_model`. Returns a verdict, NOT_CONVEX,
    UNSETTLED, FREE or BOUNDED, `step` being the solution in the last two, and then the decrease that the undamped model
    promises of it, else 0.
    """
    damped_model(H, g, damping, radius, q, places, limits, M, bounds)
    solved = solve_box(M, g, bounds[0], bounds[1], active, rounds, step)
    if solved <= 0:
        return (NOT_CONVEX if solved < 0 else UNSETTLED), 0.0
    verdict = FREE
    for i in range(active.shape[0]):
        if active[i] != 0:
            verdict = BOUNDED
    return verdict, model_decrease(H, g, step)


@jit
def free_or_scaled(H, g, damping, radius, q, places, limits, active, rounds, M, bounds, step, scaled, start):  # type: ignore[no-untyped-def]
    """As `damped_step`, but a convex step that bounds stop is not solved: it is UNSETTLED, made ready for a solver.

    FREE: the free minimum lies within the bounds, `active` is all 0. UNSETTLED: it does not; `scaled` and `start` are
    filled, see `scale`. Where M is not positive definite, as there may be a free block of it that is: as `damped_step`.
    """
    damped_model(H, g, damping, radius, q, places, limits, M, bounds)
    if not free_minimum(M, g, step):
        solved = solve_box(M, g, bounds[0], bounds[1], active, rounds, step)
        return (BOUNDED, model_decrease(H, g, step)) if solved > 0 else (NOT_CONVEX, 0.0)
    for i in range(g.shape[0]):
        if step[i] < bounds[0, i] or step[i] > bounds[1, i]:
            scale(M, g, bounds, step, scaled, start)
            return UNSETTLED, 0.0
    for i in range(g.shape[0]):
        active[i] = 0
    return FREE, model_decrease(H, g, step)


@jit
def scale(M, g, bounds, x, scaled, start):  # type: ignore[no-untyped-def]
    """The problem in the variables s x, s the root of the diagonal of M (n, n), where the matrix has a diagonal of 1.

    g (n,), bounds (2, n): see `solve_box`. scaled (n + 4, n): filled with the matrix, then the gradient, the lower and
    the upper bounds, and s. start (n,): filled with x (n,) cut to the bounds.
    """
    n = g.shape[0]
    s = scaled[n + 3]
    for i in range(n):
        s[i] = math.sqrt(M[i, i])
    for i in range(n):
        for k in range(n):
            scaled[i, k] = M[i, k] / (s[i] * s[k])
        scaled[n, i] = g[i] / s[i]
        scaled[n + 1, i], scaled[n + 2, i] = bounds[0, i] * s[i], bounds[1, i] * s[i]
        start[i] = min(max(x[i], bounds[0, i]), bounds[1, i]) * s[i]


@jit
def reduce(M, g, bounds, x, near, few):  # type: ignore[no-untyped-def]
    """The problem in the few unknowns that the free minimum x (n,) takes to a bound, or near one; returns how many, m.

    M (n, n), g (n,), bounds (2, n): see `solve_box`. Without bounds on the others these are eliminated exactly: what is
    left is min 1/2 (y - x)' S^-1 (y - x), S being the block of M^-1. near (F,): filled with their indices. few: filled
    with the problem in variables in which its matrix has a diagonal of 1: matrix (m, m), then gradient, lower and upper
    bounds, and start, m numbers each, in a row. 0 where there are more than F, or no convex problem.
    """
    n, m = M.shape[0], 0
    for i in range(n):
        room = min(x[i] - bounds[0, i], bounds[1, i] - x[i])
        if room * math.sqrt(M[i, i]) < _NEAR:
            if m == near.shape[0]:
                return 0
            near[m] = i
            m += 1
    S, identity, L = np.empty((m, m)), np.arange(m), np.empty((m, m))
    if not inverse_entries(M, near, m, np.empty((n, n)), np.empty((m, n)), S):
        return 0
    inverse = np.empty((m, m))
    if not invert_definite(S, identity, m, L, np.empty((m, m)), inverse):
        return 0
    for a in range(m):
        i, size = near[a], math.sqrt(inverse[a, a])
        t = 0.0
        for b in range(m):
            few[a * m + b] = inverse[a, b] / (size * math.sqrt(inverse[b, b]))
            t -= inverse[a, b] * x[near[b]]
        few[m * m + a] = t / size
        few[m * m + m + a], few[m * m + 2 * m + a] = bounds[0, i] * size, bounds[1, i] * size
        few[m * m + 3 * m + a] = min(max(x[i], bounds[0, i]), bounds[1, i]) * size
    return m


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
