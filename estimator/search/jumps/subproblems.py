"""Closed forms for angles about one, two or three axes, and for lines in space: where they meet, lines of sight.

Angles are changes from the pose in which the axes are given (product of exponentials), so that no convention of a URDF
matters. The subproblems are those of Paden and Kahan (Murray, Li and Sastry, A Mathematical Introduction to Robotic
Manipulation, 1994, section 3.3).
"""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.vectors import cross, dot, plus, rotated, times
from humanoid.support.compiled import jit

STRAIGHT = 1e-6  # sine of the angle between two segments that leave the plane of a limb open


@jit
def turn_between(axis, a, b):  # type: ignore[no-untyped-def]
    """Angle [rad] about the unit vector `axis` (3,) that brings a (3,) as near to b (3,) as it can (subproblem 1)."""
    return math.atan2(dot(cross(axis, a), b), dot(a, b) - dot(axis, a) * dot(axis, b))


@jit
def two_turns(first, second, p, t, out):  # type: ignore[no-untyped-def]
    """Fill out (2, 2) with the angles about two axes that bring p to t, the second axis turning p first (subproblem 2).

    Unit vectors `first`, `second` (3,), not parallel; p, t (3,) of one length. Where t cannot be reached, both rows are
    the nearest that there is.
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
    """Fill out (2,) with the angles [rad] about the unit vector `axis` (3,) that bring `arm` to a distance [m] from
    `other` (subproblem 3).

    arm, other (3,): from a point of the axis. Where the distance cannot be reached, both are the nearest that there is.
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
    """Fill out (3, 3) with unit vectors in its rows: along a (3,), normal to a and b (3,) (nearest to `side` (3,) where
    these are in line), and the third."""
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
    """Fill out (2, n) with the angles [rad] about n = 2 or 3 axes (n, 3) through one point that turn `upper` to
    `upper_target`.

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
    two_turns(axes[0], axes[1], axes[2], _rotate_between_frames(before, after, axes[2]), two)
    across = before[0] if abs(dot(before[0], axes[2])) < abs(dot(before[1], axes[2])) else before[1]
    wanted = _rotate_between_frames(before, after, across)
    for k in range(2):
        back = rotated(axes[1], -two[k, 1], rotated(axes[0], -two[k, 0], wanted))
        out[k, 0], out[k, 1] = two[k, 0], two[k, 1]
        out[k, 2] = turn_between(axes[2], across, back)


@jit
def _rotate_between_frames(before, after, v):  # type: ignore[no-untyped-def]
    """v (3,) turned as unit vectors in the rows of `before` (3, 3) turn into those of `after` (3, 3)."""
    turned = times(dot(before[0], v), after[0])
    return plus(plus(turned, dot(before[1], v), after[1]), dot(before[2], v), after[2])


@jit
def axes_of(spatial_jacobian, dofs):  # type: ignore[no-untyped-def]
    """Unit axes and the points of them nearest to the world's origin [m], (n, 3) each, of revolute `dofs` (n,).

    spatial_jacobian (nv, 6): see `Body.dof_jacobian`.
    """
    axes, through = np.empty((dofs.shape[0], 3)), np.empty((dofs.shape[0], 3))
    for k in range(dofs.shape[0]):
        axes[k] = spatial_jacobian[dofs[k], 3:]
        through[k] = cross(axes[k], spatial_jacobian[dofs[k], :3])
    return axes, through


@jit
def meeting_point(axes, through):  # type: ignore[no-untyped-def]
    """The point (3,) [m] nearest to all of some lines, not all parallel: unit vectors axes (n, 3) and points
    of them, through (n, 3)."""
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
def depths(eye, ray, centre, radius, out):  # type: ignore[no-untyped-def]
    """Fill out (2, 3) with where a ray (3,), a unit vector from `eye` (3,), meets a sphere, nearer and
    farther, and return 2; where it misses, out[0] is its nearest point, and 1 is returned."""
    offset = plus(centre, -1.0, eye)
    along = dot(ray, offset)
    gap = radius * radius - dot(offset, offset) + along * along
    half = math.sqrt(max(gap, 0.0))
    for c in range(3):
        out[0, c], out[1, c] = eye[c] + (along - half) * ray[c], eye[c] + (along + half) * ray[c]
    return 2 if gap > 0.0 else 1


@jit
def other_depths(eyes, rays, points, pivot, out):  # type: ignore[no-untyped-def]
    """Fill out (P, 3) [m] with where else on their rays (P, 3) points (P, 3) are as far from the pivot (3,) as they
    are; eyes (P, 3) [m]: points of the rays."""
    places = np.empty((2, 3))
    for i in range(points.shape[0]):
        offset = plus(points[i], -1.0, pivot)
        depths(eyes[i], rays[i], pivot, math.sqrt(dot(offset, offset)), places)
        near, far = plus(places[0], -1.0, points[i]), plus(places[1], -1.0, points[i])
        out[i] = places[1] if dot(far, far) > dot(near, near) else places[0]
