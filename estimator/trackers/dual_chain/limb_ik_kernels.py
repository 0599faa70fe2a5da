"""The compiled part of `limb_ik`: all ways in which a limb's end comes to a place with a swivel, and their volume."""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.linear import eliminate
from estimator.numerics.vectors import cross, dot, plus, rotated, times
from estimator.search.jumps.descent import placed, within
from estimator.search.jumps.subproblems import ball_turns, hinge_turns
from humanoid.support.compiled import jit

EXACT = 1e-10  # m: solutions farther from their target do not count
SLACK = 1e-10  # rad: so little outside of a limit is rounding
ITSELF = 1e-6  # rad: a solution this near to the given angles is the same
NEWTON = 10  # steps that meet a place where the ball's axes nearly meet
FARTHEST = 0.3  # m: from farther away they are not tried
STRAIGHT = 1e-4  # of the upper segment's length: an elbow this near to the line to the end has no swivel


@jit
def across(reach):  # type: ignore[no-untyped-def]
    """Two unit vectors normal to reach (3,) and to each other, the rows of (2, 3): from which a swivel is measured."""
    out = np.empty((2, 3))
    size = math.sqrt(dot(reach, reach))
    k = 0
    for c in range(1, 3):
        if abs(reach[c]) < abs(reach[k]):
            k = c
    unit = np.zeros(3)
    unit[k] = 1.0
    first = cross(reach, unit)
    out[0] = times(1.0 / math.sqrt(dot(first, first)), first)
    out[1] = times(1.0 / size, cross(reach, out[0]))
    return out


@jit
def slopes(root, w, s, p, J):  # type: ignore[no-untyped-def]
    """Fill J (m, m) with d(end, swivel) / d(turns), in what its determinant needs; d end / d turns of three axes.

    root (3,); w, s (m, 3), p (2, 3): of `placed`. At a fixed end the swivel turns the middle about the line from root
    to end, so that its row is that of the middle along the tangent, over the distance from the line; what else the
    end's motion does to the swivel is a sum of the end's own rows and changes no determinant.
    """
    m = w.shape[0]
    reach, upper = plus(p[1], -1.0, root), plus(p[0], -1.0, root)
    for a in range(m):
        column = cross(w[a], plus(p[1], -1.0, s[a]))
        for c in range(3):
            J[c, a] = column[c]
    if m > 3:
        tangent = cross(reach, upper)
        square = dot(tangent, tangent)  # (|reach| times the distance of the middle from the line)^2
        scale = math.sqrt(dot(reach, reach)) / max(square, 1e-300)
        for a in range(m):
            J[3, a] = scale * dot(tangent, cross(w[a], plus(p[0], -1.0, s[a]))) if a < m - 1 else 0.0


@jit
def log_volume(root, w, s, p, J, rest):  # type: ignore[no-untyped-def]
    """Logarithm of |d(end, swivel) / d(turns)| [m^3 rad / rad^m], or of |d end / d turns| of a limb of three axes.

    root (3,); w, s (m, 3), p (2, 3): of `placed`. J (m, m), rest (m,): room.
    """
    slopes(root, w, s, p, J)
    rest[:] = 0.0
    return log_size(J, rest)


@jit
def log_size(J, rest):  # type: ignore[no-untyped-def]
    """Logarithm of |det J|, J (m, m) being used up, -inf where it is singular; rest (m,) is zeros."""
    if not eliminate(J, rest):
        return -np.inf
    size = 1.0
    for a in range(J.shape[0]):
        size *= J[a, a]
    return math.log(abs(size)) if abs(size) > 0.0 else -np.inf


@jit
def swivel_of(root, p):  # type: ignore[no-untyped-def]
    """Swivel [rad] of a limb with root (3,), middle and end p (2, 3); 0 where the middle is on the line of both."""
    reach, upper = plus(p[1], -1.0, root), plus(p[0], -1.0, root)
    frame = across(reach)
    return math.atan2(dot(frame[1], upper), dot(frame[0], upper))


@jit
def off_line(root, p):  # type: ignore[no-untyped-def]
    """Distance of the middle from the line of root (3,) and end, in lengths of the upper segment; p (2, 3)."""
    reach, upper = plus(p[1], -1.0, root), plus(p[0], -1.0, root)
    normal = cross(reach, upper)
    return math.sqrt(dot(normal, normal) / (dot(reach, reach) * dot(upper, upper)))


@jit
def _closed_form(axes, through, points, target, swivel, bend, starts):  # type: ignore[no-untyped-def]
    """Fill starts (2, m) with turns that bring the end to target (3,) with a swivel [rad], the hinge turned by `bend`;
    axes, through (m, 3), points (3, 3)."""
    ball = axes.shape[0] - 1
    hinge, seat, root = axes[ball], through[ball], points[0]
    end = plus(plus(seat, 1.0, rotated(hinge, bend, plus(points[2], -1.0, seat))), -1.0, root)
    upper, reach = plus(points[1], -1.0, root), plus(target, -1.0, root)
    size = math.sqrt(dot(reach, reach))
    along = dot(upper, end) / max(math.sqrt(dot(end, end)), 1e-12)
    away = math.sqrt(max(dot(upper, upper) - along * along, 0.0))
    frame = across(reach)
    upper_target = times(along / size, reach)
    upper_target = plus(upper_target, away * math.cos(swivel), frame[0])
    upper_target = plus(upper_target, away * math.sin(swivel), frame[1])
    balls = np.empty((2, ball))
    ball_turns(axes[:ball], end, upper, reach, upper_target, hinge, balls)
    for j in range(2):
        starts[j, :ball] = balls[j]
        starts[j, ball] = bend


@jit
def _refined(axes, through, points, target, swivel, turns, w, s, p, J, rest):  # type: ignore[no-untyped-def]
    """Newton's steps of turns (m,) to target (3,) and swivel; for axes that nearly meet. Returns the distance [m].

    axes, through (m, 3), points (3, 3); w, s (m, 3), p (2, 3), J (m, m), rest (m,): room.
    """
    m = axes.shape[0]
    counts = np.array([m - 1, m])
    reach = plus(target, -1.0, points[0])
    frame = across(reach)
    error = np.inf
    for step in range(NEWTON + 1):
        placed(axes, through, points[1:], counts, turns, w, s, p)
        off = plus(target, -1.0, p[1])
        rest[:3] = off
        turned = 0.0
        if m > 3:
            # measured about the line to the target, which the end is nearly on
            upper = plus(p[0], -1.0, points[0])
            turned = within(swivel - math.atan2(dot(frame[1], upper), dot(frame[0], upper)), -math.pi, math.pi)
            rest[3] = turned
        error = max(math.sqrt(dot(off, off)), 0.1 * abs(turned))
        if error < EXACT or step == NEWTON or not error < FARTHEST:
            break
        slopes(points[0], w, s, p, J)
        if not eliminate(J, rest):
            break
        for a in range(m):
            turns[a] += min(max(rest[a], -0.5), 0.5)
    return error


@jit
def ways(axes, through, points, low, high, loose, target, swivel, out, w, s, p, J, rest):  # type: ignore[no-untyped-def]
    """Fill rows of out (4, m) with the turns inside of low, high (m,) that meet target (3,) and swivel [rad]; how many.

    axes, through (m, 3), points (3, 3): of the limb without turns; w, s (m, 3), p (2, 3), J (m, m), rest (m,): room.
    What the closed form puts farther than `loose` [rad] outside of a limit is left out: 0 where axes meet, so that it
    is exact.
    """
    m = axes.shape[0]
    reach, seat = plus(target, -1.0, points[0]), through[m - 1]
    distance = math.sqrt(dot(reach, reach))
    if not distance > EXACT:
        return 0
    loose = max(loose, SLACK)
    bends, starts = np.empty(2), np.empty((2, m))
    hinge_turns(axes[m - 1], plus(points[2], -1.0, seat), plus(points[0], -1.0, seat), distance, bends)
    count = 0
    for k in range(2):
        bend = within(bends[k], low[m - 1], high[m - 1])
        if not low[m - 1] - loose <= bend <= high[m - 1] + loose:
            continue
        _closed_form(axes, through, points, target, swivel, bend, starts)
        for j in range(2):
            turns = starts[j]
            if not _inside(turns, low, high, loose):
                continue
            if not _refined(axes, through, points, target, swivel, turns, w, s, p, J, rest) < EXACT:
                continue
            inside = _inside(turns, low, high, SLACK)
            for i in range(count):  # where two ways meet they are one
                inside = inside and _apart(out[i], turns) > 1e-7
            if inside:
                for a in range(m):
                    out[count, a] = min(max(turns[a], low[a]), high[a])
                count += 1
    return count


@jit
def _inside(turns, low, high, slack):  # type: ignore[no-untyped-def]
    """Whether turns (m,), moved by whole turns as near to their limits low, high (m,) as can be, are inside of them."""
    inside = True
    for a in range(turns.shape[0]):
        turns[a] = within(turns[a], low[a], high[a])
        inside = inside and low[a] - slack <= turns[a] <= high[a] + slack
    return inside


@jit
def _apart(a, b):  # type: ignore[no-untyped-def]
    """The largest difference between turns a, b (m,)."""
    most = 0.0
    for k in range(a.shape[0]):
        most = max(most, abs(a[k] - b[k]))
    return most


@jit
def solve_each(axes, through, points, low, high, loose, targets, swivels, picks, turns, counts, volumes):  # type: ignore[no-untyped-def]
    """One of the ways for each of N places: fill turns (N, m), counts (N,) of ways and volumes (N,), see `log_volume`.

    axes, through (m, 3), points (3, 3), low, high (m,), loose: of the limb. targets (N, 3) [m], swivels (N,) [rad];
    picks (N,): from 0 to 1, which of the ways is taken. counts is 0 where there is none, or where the elbow is
    straight.
    """
    m = axes.shape[0]
    out, w, s, p = np.empty((4, m)), np.empty((m, 3)), np.empty((m, 3)), np.empty((2, 3))
    J, rest, moved = np.empty((m, m)), np.empty(m), np.array([m - 1, m])
    for n in range(targets.shape[0]):
        counts[n] = ways(axes, through, points, low, high, loose, targets[n], swivels[n], out, w, s, p, J, rest)
        if counts[n] == 0:
            continue
        turns[n] = out[min(int(picks[n] * counts[n]), counts[n] - 1)]
        placed(axes, through, points[1:], moved, turns[n], w, s, p)
        volumes[n] = log_volume(points[0], w, s, p, J, rest)
        if m > 3 and not off_line(points[0], p) >= STRAIGHT:
            counts[n] = 0


@jit
def forward_each(axes, through, points, low, high, loose, turns, ends, counts, volumes):  # type: ignore[no-untyped-def]
    """Fill ends (N, 3) [m], counts (N,) of ways to the same end and swivel, and volumes (N,) of given turns (N, m).

    axes, through (m, 3), points (3, 3), low, high (m,), loose: of the limb. counts is 0 where the turns themselves are
    not among the ways, so that `solve_each` has them never: outside of the limits, or where Newton's method fails.
    """
    m = axes.shape[0]
    out, w, s, p = np.empty((4, m)), np.empty((m, 3)), np.empty((m, 3)), np.empty((2, 3))
    J, rest, moved = np.empty((m, m)), np.empty(m), np.array([m - 1, m])
    for n in range(turns.shape[0]):
        placed(axes, through, points[1:], moved, turns[n], w, s, p)
        ends[n] = p[1]
        volumes[n] = log_volume(points[0], w, s, p, J, rest)
        if m > 3 and not off_line(points[0], p) >= STRAIGHT:
            continue
        swivel = swivel_of(points[0], p) if m > 3 else 0.0
        count = ways(axes, through, points, low, high, loose, ends[n], swivel, out, w, s, p, J, rest)
        for i in range(count):
            if _apart(out[i], turns[n]) < ITSELF:
                counts[n] = count
