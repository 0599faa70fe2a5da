"""Lines in space: axes of joints, where they meet, and lines of sight."""

from __future__ import annotations

import math

import numpy as np

from estimator.numerics.vectors import cross, dot, plus
from humanoid.support.compiled import jit


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
