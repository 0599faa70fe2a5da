"""Angles of limbs and parts whose joints are to be at given places.

A limb is a ball joint of two or three revolute axes and, further out, one more hinge: shoulder and elbow, hip and knee.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.vectors import cross, dot, plus, rotated, times
from estimator.search.jumps.descent import best_turns, placed
from estimator.search.jumps.subproblems import ball_turns, depths, hinge_turns
from humanoid.support.compiled import jit


@jit
def limb_turns(axes, through, points, counts, targets, rays, low, high, best):  # type: ignore[no-untyped-def]
    """Fill best (m,) with the turns [rad] that bring a limb's middle and end to targets (2, 3); see `pulled`.

    points (3, 3): root, middle and end. counts (2,): of middle and end. The last axis is the hinge, those before it go
    through the root. Bounds are kept. Returns the largest error [m].
    """
    ball = axes.shape[0] - 1
    starts = np.empty((4, ball + 1))
    bends, balls = np.empty(2), np.empty((2, ball))
    root, hinge, seat = points[0], axes[ball], through[ball]
    reach, upper = plus(targets[1], -1.0, root), plus(points[1], -1.0, root)
    arm, upper_target = plus(points[2], -1.0, seat), plus(targets[0], -1.0, root)
    hinge_turns(hinge, arm, plus(root, -1.0, seat), math.sqrt(dot(reach, reach)), bends)
    for k in range(2):
        end = plus(plus(seat, 1.0, rotated(hinge, bends[k], arm)), -1.0, root)
        ball_turns(axes[:ball], upper, end, upper_target, reach, hinge, balls)
        for j in range(2):
            starts[2 * k + j, :ball] = balls[j]
            starts[2 * k + j, ball] = bends[k]
    return best_turns(axes, through, points[1:], counts, targets, rays, low, high, starts, best)


@jit
def limb_alternatives(axes, through, points, counts, eyes, rays, lower, upper, turns, errors, reached):  # type: ignore[no-untyped-def]
    """The four solutions of a limb on the rays of its middle and end, rays (2, 3) unit vectors from eyes (2, 3).

    Fills turns (4, m), reached (4, 2, 3) [m]: where middle and end come to be, and errors (4,): their largest distance
    from where they should be, less along the rays [m]; infinite where a ray misses and the farther solution is the
    nearer. The order is nearer nearer, nearer farther, farther nearer, farther farther. See `limb_turns`.
    """
    first, second = plus(points[1], -1.0, points[0]), plus(points[2], -1.0, points[1])
    upper_length, lower_length = math.sqrt(dot(first, first)), math.sqrt(dot(second, second))
    middles, ends, targets = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    w, s = np.empty(axes.shape), np.empty(axes.shape)
    errors[:] = np.inf
    for i in range(depths(eyes[0], rays[0], points[0], upper_length, middles)):
        for j in range(depths(eyes[1], rays[1], middles[i], lower_length, ends)):
            k = 2 * i + j
            targets[0], targets[1] = middles[i], ends[j]
            errors[k] = limb_turns(axes, through, points, counts, targets, rays, lower, upper, turns[k])
            placed(axes, through, points[1:], counts, turns[k], w, s, reached[k])


@jit
def part_turns(axes, through, points, pivot, turn, targets, rays, lower, upper, best):  # type: ignore[no-untyped-def]
    """Fill best (m,) with the turns [rad] of a part whose m = 2 or 3 axes go through `pivot` that come nearest to the
    rotation `turn` (3, 3), then nearest to targets (P, 3) of its points (P, 3); see `pulled`. Returns the
    largest error [m].
    """
    m = axes.shape[0]
    centre = np.zeros(3)
    for i in range(points.shape[0]):
        for c in range(3):
            centre[c] += points[i, c] - pivot[c]
    size = math.sqrt(dot(centre, centre))
    main = times(1.0 / size, centre) if size > 1e-9 else times(1.0, axes[0])
    side = cross(main, axes[0] if abs(dot(main, axes[0])) < 0.9 else axes[1])
    starts = np.zeros((3, m))  # the last start is to leave it where it is
    main_target, side_target = np.empty(3), np.empty(3)
    for c in range(3):
        main_target[c], side_target[c] = dot(turn[c], main), dot(turn[c], side)
    ball_turns(axes, main, side, main_target, side_target, side, starts[:2])
    counts = np.full(points.shape[0], m)
    return best_turns(axes, through, points, counts, targets, rays, lower, upper, starts, best)
