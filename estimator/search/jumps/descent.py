"""A short descent of joint angles within their bounds, from where closed forms lead to."""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.linear import solve_definite
from estimator.numerics.vectors import cross, dot, plus, turn_in_place
from humanoid.support.compiled import jit

EXACT = 1e-9  # m
SAME_ERROR = 1e-3  # m: angles that are this much worse are as good
DAMPING = 1e-6  # m^2
STEPS = 8
ALONG = 0.2  # weight of an error along a ray
TRIED = 2  # starts outside the limits that are pulled, the least outside first
SLOW = 0.1  # share of the error: a step that gains less is the last
SINGULAR = 1e-15  # m^2: least pivot of a step's matrix
LARGEST_TURN = 0.8  # rad a step


@jit
def best_turns(axes, through, points, counts, targets, rays, lower, upper, starts, best):  # type: ignore[no-untyped-def]
    """Fill best (m,) with the smallest turns among those that come nearest to the targets; starts (k, m) are put into
    the bounds (m,) and pulled from there; see `pulled`. Returns the largest error [m]."""
    m = axes.shape[0]
    excess = np.zeros(starts.shape[0])
    for k in range(starts.shape[0]):
        for a in range(m):
            x = within(starts[k, a], lower[a], upper[a])
            starts[k, a] = min(max(x, lower[a]), upper[a])
            excess[k] += abs(x - starts[k, a])
    least, least_change = np.inf, np.inf
    for tried in range(starts.shape[0]):
        k = int(np.argmin(excess))
        if excess[k] > 1e-9 and (least < SAME_ERROR or tried >= TRIED):
            break  # what is within the limits needs no descent
        excess[k] = np.inf
        error = pulled(axes, through, points, counts, targets, rays, ALONG, lower, upper, starts[k])
        change = 0.0
        for a in range(m):
            change += starts[k, a] * starts[k, a]
        if error < least - SAME_ERROR or (error < least + SAME_ERROR and change < least_change):
            least, least_change = error, change
            best[:] = starts[k]
    if least > EXACT:  # limits, or axes that miss each other: at last the image alone
        pulled(axes, through, points, counts, targets, rays, 0.0, lower, upper, best)
    return least


@jit
def pulled(axes, through, points, counts, targets, rays, along, lower, upper, turns):  # type: ignore[no-untyped-def]
    """Bring points to targets by damped Gauss-Newton steps within bounds, changing turns (m,) [rad] in place.

    axes, through (m, 3): unit vectors and points of the axes, from the root outwards. points (P, 3); counts (P,): how
    many of the axes move each. targets (P, 3) [m] on `rays` (P, 3), unit vectors, along which an error counts `along`
    times: where limits forbid the place, the image is kept. lower, upper (m,): bounds of the turns. Returns the
    largest error [m], so weighted.
    """
    m, count = axes.shape[0], points.shape[0]
    A, g, row = np.empty((m, m)), np.empty(m), np.empty((m, 3))
    w, s, p = np.empty((m, 3)), np.empty((m, 3)), np.empty((count, 3))
    best, least, order = turns.copy(), np.inf, np.arange(m)
    damping = DAMPING
    for step in range(STEPS + 1):
        error = _missed(axes, through, points, counts, targets, rays, along, turns, w, s, p)
        if error < least:
            gained, least, damping = least - error, error, max(DAMPING, 0.1 * damping)
            best[:] = turns
            if error < EXACT or (step > 2 and gained < SLOW * error):
                break
        else:
            damping *= 100.0
            if damping > 1.0:
                break
            turns[:] = best
            _missed(axes, through, points, counts, targets, rays, along, turns, w, s, p)
        A[:], g[:] = 0.0, 0.0
        for i in range(count):
            off = plus(targets[i], -1.0, p[i])
            off = plus(off, (along - 1.0) * dot(off, rays[i]), rays[i])
            for a in range(counts[i]):
                row[a] = cross(w[a], plus(p[i], -1.0, s[a]))
                row[a] = plus(row[a], (along - 1.0) * dot(row[a], rays[i]), rays[i])
                for c in range(3):
                    g[a] += row[a, c] * off[c]
                for b in range(a + 1):
                    A[a, b] += dot(row[a], row[b])
        _step(A, g, order, damping, lower, upper, turns)
    turns[:] = best
    return least


@jit
def _missed(axes, through, points, counts, targets, rays, along, turns, w, s, p):  # type: ignore[no-untyped-def]
    """Place everything (`placed`); returns the largest weighted distance of a point from its target [m]."""
    placed(axes, through, points, counts, turns, w, s, p)
    error = 0.0
    for i in range(points.shape[0]):
        off = plus(p[i], -1.0, targets[i])
        depth = dot(off, rays[i])
        error = max(error, dot(off, off) - (1.0 - along * along) * depth * depth)
    return math.sqrt(error)


@jit
def placed(axes, through, points, counts, turns, w, s, p):  # type: ignore[no-untyped-def]
    """Fill w, s (m, 3), p (P, 3): the axes, points of them, and the points after the turns; see `pulled`."""
    m = axes.shape[0]
    w[:], s[:], p[:] = axes, through, points
    for a in range(m - 1, -1, -1):  # the innermost turn moves everything behind it, and moves it last
        cosine, sine = math.cos(turns[a]), math.sin(turns[a])
        for b in range(a + 1, m):
            turn_in_place(axes[a], through[a], 0.0, cosine, sine, w[b])
            turn_in_place(axes[a], through[a], 1.0, cosine, sine, s[b])
        for i in range(points.shape[0]):
            if counts[i] > a:
                turn_in_place(axes[a], through[a], 1.0, cosine, sine, p[i])


@jit
def _step(A, g, order, damping, lower, upper, turns):  # type: ignore[no-untyped-def]
    """Solve (A + damping) x = g in the turns (m,) that are free to move and add x, kept within lower, upper (m,).

    A (m, m), of which the lower triangle counts, and g (m,) are overwritten. order (m,): 0, 1, ..., m - 1.
    """
    m = g.shape[0]
    for a in range(m):
        held = (turns[a] <= lower[a] and g[a] < 0.0) or (turns[a] >= upper[a] and g[a] > 0.0)
        A[a, a] += damping
        if held:
            g[a] = 0.0
            A[a, :a] = 0.0
            A[a + 1 :, a] = 0.0
    solve_definite(A, order, m, SINGULAR, A, g)
    for a in range(m):
        turns[a] = min(max(turns[a] + min(max(g[a], -LARGEST_TURN), LARGEST_TURN), lower[a]), upper[a])


@jit
def within(turn, lower, upper):  # type: ignore[no-untyped-def]
    """The same angle [rad] some whole turns away, as near to its bounds as there is one."""
    full = 2.0 * math.pi
    turn -= full * math.floor((turn + math.pi) / full)
    if turn > upper and turn - full - lower > upper - turn:
        turn -= full
    elif turn < lower and upper - turn - full > turn - lower:
        turn += full
    return turn
