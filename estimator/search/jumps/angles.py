"""Angles of a limb whose joints are to be at given places: closed forms, and a short bounded descent after them.

A limb is a ball joint of two or three revolute axes and, further out, one more hinge: shoulder and elbow, hip and knee.
Angles are changes from the pose in which the axes are given (product of exponentials), so that no convention of a URDF
matters. The subproblems are those of Paden and Kahan (Murray, Li and Sastry, A Mathematical Introduction to Robotic
Manipulation, 1994, section 3.3).
"""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.linear import solve_definite
from humanoid.support.compiled import jit

EXACT = 1e-9  # m
SAME_ERROR = 1e-3  # m: readings of a limb this much worse are as good
DAMPING = 1e-6  # m^2
STEPS = 8
ALONG = 0.2  # weight of an error along a ray
TRIED = 2  # starts outside the limits that are pulled, the least outside first
SLOW = 0.1  # share of the error: a step that gains less is the last
LARGEST_TURN = 0.8  # rad a step
SINGULAR = 1e-15  # m^2: least pivot of a step's matrix
STRAIGHT = 1e-6  # sine of the angle between two segments that leave the plane of a limb open


@jit
def dot(a, b):  # type: ignore[no-untyped-def]
    """Of vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a, b):  # type: ignore[no-untyped-def]
    """Of vectors (3,)."""
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@jit
def plus(a, factor, b):  # type: ignore[no-untyped-def]
    """a + factor b, vectors (3,)."""
    out = np.empty(3)
    for c in range(3):
        out[c] = a[c] + factor * b[c]
    return out


@jit
def times(factor, a):  # type: ignore[no-untyped-def]
    """Of a vector (3,)."""
    out = np.empty(3)
    for c in range(3):
        out[c] = factor * a[c]
    return out


@jit
def axes_of(spatial_jacobian, dofs):  # type: ignore[no-untyped-def]
    """Unit axes and the points of them nearest to the world's origin [m] of revolute `dofs` (n,), (n, 3) each.

    spatial_jacobian (nv, 6): see `PosedBody`.
    """
    axes, through = np.empty((dofs.shape[0], 3)), np.empty((dofs.shape[0], 3))
    for k in range(dofs.shape[0]):
        axes[k] = spatial_jacobian[dofs[k], 3:]
        through[k] = cross(axes[k], spatial_jacobian[dofs[k], :3])
    return axes, through


@jit
def meeting_point(axes, through):  # type: ignore[no-untyped-def]
    """The point (3,) [m] nearest to all of some lines, not all parallel: unit vectors and points of them (n, 3)."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    for k in range(axes.shape[0]):
        along = dot(axes[k], through[k])
        for i in range(3):
            b[i] += through[k, i] - along * axes[k, i]
            A[i, i] += 1.0
            for j in range(3):
                A[i, j] -= axes[k, i] * axes[k, j]
    first, second, third = cross(A[1], A[2]), cross(A[2], A[0]), cross(A[0], A[1])  # A is symmetric: Cramer's rule
    scale = 1.0 / dot(A[0], first)
    out = np.empty(3)
    out[0], out[1], out[2] = scale * dot(first, b), scale * dot(second, b), scale * dot(third, b)
    return out


@jit
def rotated(axis, angle, v):  # type: ignore[no-untyped-def]
    """v (3,) turned by `angle` [rad] about the unit vector `axis` (3,)."""
    c, s = math.cos(angle), math.sin(angle)
    along = dot(axis, v) * (1.0 - c)
    out = np.empty(3)
    out[0] = c * v[0] + s * (axis[1] * v[2] - axis[2] * v[1]) + along * axis[0]
    out[1] = c * v[1] + s * (axis[2] * v[0] - axis[0] * v[2]) + along * axis[1]
    out[2] = c * v[2] + s * (axis[0] * v[1] - axis[1] * v[0]) + along * axis[2]
    return out


@jit
def turn_between(axis, a, b):  # type: ignore[no-untyped-def]
    """Angle [rad] about the unit vector `axis` that brings a (3,) as near to b (3,) as it can (subproblem 1)."""
    return math.atan2(dot(cross(axis, a), b), dot(a, b) - dot(axis, a) * dot(axis, b))


@jit
def two_turns(first, second, p, t, out):  # type: ignore[no-untyped-def]
    """Fill out (2, 2) with the angles about two axes that bring p to t, the second axis turning p first (subproblem 2).

    Unit vectors `first`, `second`, not parallel; p, t (3,) of one length. Where t is out of reach, both rows are the
    nearest that there is.
    """
    c = dot(first, second)
    fall = max(1.0 - c * c, 1e-12)
    along_p, along_t = dot(second, p), dot(first, t)
    alpha, beta = (along_t - c * along_p) / fall, (along_p - c * along_t) / fall
    height = math.sqrt(max(0.0, (dot(p, p) - alpha * alpha - beta * beta - 2.0 * alpha * beta * c) / fall))
    normal = cross(first, second)
    for k in range(2):
        z = plus(plus(times((1.0 - 2.0 * k) * height, normal), alpha, first), beta, second)
        out[k, 0] = turn_between(first, z, t)
        out[k, 1] = turn_between(second, p, z)


@jit
def hinge_turns(axis, arm, other, distance, out):  # type: ignore[no-untyped-def]
    """Fill out (2,) with the angles about `axis` that bring `arm` to a distance [m] from `other` (subproblem 3).

    arm, other (3,): from a point of the axis. Where the distance is out of reach, both are the nearest that there is.
    """
    along = dot(axis, arm) * dot(axis, other)
    cosine, sine = dot(arm, other) - along, dot(other, cross(axis, arm))
    wanted = 0.5 * (dot(arm, arm) + dot(other, other) - distance * distance) - along
    size = math.hypot(cosine, sine)
    spread = math.acos(min(max(wanted / max(size, 1e-12), -1.0), 1.0))
    middle = math.atan2(sine, cosine)
    out[0], out[1] = middle + spread, middle - spread


@jit
def frame_of(a, b, side, out):  # type: ignore[no-untyped-def]
    """Fill out (3, 3) with unit vectors in its rows: along a, normal to a and b (nearest to `side` where these are
    in line), and the third."""
    out[0] = times(1.0 / max(math.sqrt(dot(a, a)), 1e-12), a)
    normal = cross(out[0], b)
    size = math.sqrt(dot(normal, normal))
    if size < STRAIGHT * math.sqrt(dot(b, b)):
        normal = plus(side, -dot(side, out[0]), out[0])
        size = math.sqrt(dot(normal, normal))
    out[1] = times(1.0 / max(size, 1e-12), normal)
    out[2] = cross(out[0], out[1])


@jit
def ball_turns(axes, upper, end, upper_target, end_target, side, out):  # type: ignore[no-untyped-def]
    """Fill out (2, n) with the angles about n = 2 or 3 axes through one point that turn `upper` to `upper_target`.

    All vectors (3,) are from that point; `side` is normal to a limb that is straight. Three axes also turn `end` to
    `end_target`, as far as the two are as far apart.
    """
    n = axes.shape[0]
    two = np.empty((2, 2))
    if n == 2:
        stretch = math.sqrt(dot(upper, upper) / max(dot(upper_target, upper_target), 1e-12))
        two_turns(axes[0], axes[1], upper, times(stretch, upper_target), out)
        return
    before, after = np.empty((3, 3)), np.empty((3, 3))
    frame_of(upper, end, side, before)
    frame_of(upper_target, end_target, side, after)
    two_turns(axes[0], axes[1], axes[2], _carried(before, after, axes[2]), two)
    across = before[0] if abs(dot(before[0], axes[2])) < abs(dot(before[1], axes[2])) else before[1]
    wanted = _carried(before, after, across)
    for k in range(2):
        back = rotated(axes[1], -two[k, 1], rotated(axes[0], -two[k, 0], wanted))
        out[k, 0], out[k, 1] = two[k, 0], two[k, 1]
        out[k, 2] = turn_between(axes[2], across, back)


@jit
def _carried(before, after, v):  # type: ignore[no-untyped-def]
    """v (3,) turned as unit vectors in the rows of `before` (3, 3) turn into those of `after`."""
    turned = times(dot(before[0], v), after[0])
    return plus(plus(turned, dot(before[1], v), after[1]), dot(before[2], v), after[2])


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
    best, least = turns.copy(), np.inf
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
        _step(A, g, damping, lower, upper, turns)
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
            _turn(axes[a], through[a], 0.0, cosine, sine, w[b])
            _turn(axes[a], through[a], 1.0, cosine, sine, s[b])
        for i in range(points.shape[0]):
            if counts[i] > a:
                _turn(axes[a], through[a], 1.0, cosine, sine, p[i])


@jit
def _turn(axis, through, place, cosine, sine, v):  # type: ignore[no-untyped-def]
    """Turn v (3,) in place about an axis: a point where `place` is 1, a direction where it is 0."""
    x, y, z = v[0] - place * through[0], v[1] - place * through[1], v[2] - place * through[2]
    along = (axis[0] * x + axis[1] * y + axis[2] * z) * (1.0 - cosine)
    v[0] = cosine * x + sine * (axis[1] * z - axis[2] * y) + along * axis[0] + place * through[0]
    v[1] = cosine * y + sine * (axis[2] * x - axis[0] * z) + along * axis[1] + place * through[1]
    v[2] = cosine * z + sine * (axis[0] * y - axis[1] * x) + along * axis[2] + place * through[2]


@jit
def _step(A, g, damping, lower, upper, turns):  # type: ignore[no-untyped-def]
    """Solve (A + damping) x = g in the turns that are free to move and add x, kept within the bounds."""
    m = g.shape[0]
    for a in range(m):
        held = (turns[a] <= lower[a] and g[a] < 0.0) or (turns[a] >= upper[a] and g[a] > 0.0)
        A[a, a] += damping
        if held:
            g[a] = 0.0
            A[a, :a] = 0.0
            A[a + 1 :, a] = 0.0
    solve_definite(A, np.arange(m), m, SINGULAR, A, g)
    for a in range(m):
        turns[a] = min(max(turns[a] + min(max(g[a], -LARGEST_TURN), LARGEST_TURN), lower[a]), upper[a])


@jit
def within(turn, lower, upper):  # type: ignore[no-untyped-def]
    """The same angle some whole turns away, as near to its bounds as there is one."""
    full = 2.0 * math.pi
    turn -= full * math.floor((turn + math.pi) / full)
    if turn > upper and turn - full - lower > upper - turn:
        turn -= full
    elif turn < lower and upper - turn - full > turn - lower:
        turn += full
    return turn


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
def best_turns(axes, through, points, counts, targets, rays, lower, upper, starts, best):  # type: ignore[no-untyped-def]
    """Fill best (m,) with the smallest turns among those that come nearest to the targets; starts (k, m) are put into
    the bounds and pulled from there. Returns the largest error [m]."""
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
            break  # what the limits allow as it is needs no descent
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
def depths(eye, ray, centre, radius, out):  # type: ignore[no-untyped-def]
    """Fill out (2, 3) with where a ray (unit vector from `eye`) meets a sphere, nearer and farther, and return 2; where
    it misses, out[0] is its nearest point, and 1 is returned."""
    offset = plus(centre, -1.0, eye)
    along = dot(ray, offset)
    gap = radius * radius - dot(offset, offset) + along * along
    half = math.sqrt(max(gap, 0.0))
    for c in range(3):
        out[0, c], out[1, c] = eye[c] + (along - half) * ray[c], eye[c] + (along + half) * ray[c]
    return 2 if gap > 0.0 else 1


@jit
def other_depths(eye, rays, points, pivot, out):  # type: ignore[no-untyped-def]
    """Fill out (P, 3) [m] with where else on their rays (P, 3) points (P, 3) are as far from the pivot as they are."""
    places = np.empty((2, 3))
    for i in range(points.shape[0]):
        offset = plus(points[i], -1.0, pivot)
        depths(eye, rays[i], pivot, math.sqrt(dot(offset, offset)), places)
        near, far = plus(places[0], -1.0, points[i]), plus(places[1], -1.0, points[i])
        out[i] = places[1] if dot(far, far) > dot(near, near) else places[0]


@jit
def limb_alternatives(axes, through, points, counts, eye, rays, lower, upper, turns, errors, reached):  # type: ignore[no-untyped-def]
    """The four readings of a limb on the rays of its middle and end, rays (2, 3) unit vectors.

    Fills turns (4, m), reached (4, 2, 3) [m]: where middle and end come to be, and errors (4,): their largest distance
    from where they should be, less along the rays [m]; infinite where a ray misses and the farther reading is the
    nearer. The order is nearer nearer, nearer farther, farther nearer, farther farther. See `limb_turns`.
    """
    first, second = plus(points[1], -1.0, points[0]), plus(points[2], -1.0, points[1])
    upper_length, lower_length = math.sqrt(dot(first, first)), math.sqrt(dot(second, second))
    middles, ends, targets = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    w, s = np.empty(axes.shape), np.empty(axes.shape)
    errors[:] = np.inf
    for i in range(depths(eye, rays[0], points[0], upper_length, middles)):
        for j in range(depths(eye, rays[1], middles[i], lower_length, ends)):
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
    main = times(1.0 / size, centre) if size > 1e-9 else axes[0].copy()
    side = cross(main, axes[0] if abs(dot(main, axes[0])) < 0.9 else axes[1])
    starts = np.zeros((3, m))  # the last start is to leave it where it is
    main_target, side_target = np.empty(3), np.empty(3)
    for c in range(3):
        main_target[c], side_target[c] = dot(turn[c], main), dot(turn[c], side)
    ball_turns(axes, main, side, main_target, side_target, side, starts[:2])
    counts = np.full(points.shape[0], m)
    return best_turns(axes, through, points, counts, targets, rays, lower, upper, starts, best)
