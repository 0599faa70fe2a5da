"""The compiled part of `point_features`."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.projection import project_with_jacobian
from humanoid.support.compiled import jit


@jit
def pixel_jacobians(points, columns, support, intrinsics, lens, R, t, pixels, jacobian):  # type: ignore[no-untyped-def]
    """Fill pixels (N, F, 2) [px] and jacobian (N, F, 2, C) [px per unit of a column], NaN where there is no image.

    points (N, F, 3) [m]: in the world, fixed to bodies. columns (N, C, 6): of the spatial Jacobians, linear at the
    world's origin and angular. support (F, C) bool: which columns move which point. The camera: intrinsics (5,), lens,
    R (3, 3), t (3,), T_camera_world.
    """
    slope = np.empty((2, 3))
    for n in range(points.shape[0]):
        for f in range(points.shape[1]):
            x, y, z = points[n, f, 0], points[n, f, 1], points[n, f, 2]
            u, v, seen = project_with_jacobian(points[n, f], intrinsics, lens, R, t, slope)
            if not seen:
                pixels[n, f], jacobian[n, f] = np.nan, np.nan
                continue
            pixels[n, f, 0], pixels[n, f, 1] = u, v
            for c in range(columns.shape[1]):
                jacobian[n, f, 0, c], jacobian[n, f, 1, c] = 0.0, 0.0
                if not support[f, c]:
                    continue
                a = columns[n, c]
                vx = a[0] + a[4] * z - a[5] * y
                vy = a[1] + a[5] * x - a[3] * z
                vz = a[2] + a[3] * y - a[4] * x
                jacobian[n, f, 0, c] = slope[0, 0] * vx + slope[0, 1] * vy + slope[0, 2] * vz
                jacobian[n, f, 1, c] = slope[1, 0] * vx + slope[1, 1] * vy + slope[1, 2] * vz
