"""Lens models, which map directions of rays to the image: Brown's distortion, OpenCV's longer models, and fisheyes.

A lens is one array. Of Brown's five coefficients (Brown 1966): (5,) k1, k2, p1, p2, k3. Of any other model one row
(1, 22): those five, k4, k5, k6 (rational), s1, s2, s3, s4 (thin prism), the nine numbers of a tilted sensor's
homography, row by row, and the model, `GENERAL` or `FISHEYE`. A fisheye's k1, k2, k3, k4 (Kannala and Brandt 2006)
take the places of k1, k2, k3, k4. Formulas and orders are those of OpenCV's `calib3d` and `fisheye` modules.

The two have different numbers of axes so that kernels are compiled for each: numba drops the branch of `if lens.ndim ==
2` that does not apply, and Brown's model is as fast as if there were no other (with a branch on a number it took 1.7 to
9 times as long, since it was no longer inlined). A parallel camera has no lens, but its array marks it as parallel: a
row as above with the model `PARALLEL`, (1, 1, 22). Where such a camera is among several, all have that many axes, and
the model number decides.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numba.extending import register_jitable

from humanoid.support.compiled import jit

_BROWN, _SIZE = 5, 22
COUNTS = (4, 5, 8, 12, 14)
"""Numbers of coefficients of OpenCV's models; a fisheye's has 4."""
GENERAL, FISHEYE, PARALLEL = 1.0, 2.0, 3.0
_K3, _K4 = 4, 5
_TILT = 12
_MODEL = 21
_TINY = 1e-300  # added to a squared radius: no division by zero, no other number changed
_SERIES = 0.01  # of r^2, below which atan(r)/r is taken from its series: its derivatives cancel
_STEPS = 50
_CLOSE = 1e-11  # of a direction, relative to its length


def lens_array(distortion: np.ndarray, *, fisheye: bool = False) -> np.ndarray:
    """Coefficients as OpenCV orders them -> what the functions here take, (5,) or (1, 22).

    distortion: (5,) k1, k2, p1, p2, k3, or without the last; (8,) then k4, k5, k6; (12,) then s1, s2, s3, s4; (14,)
    then the sensor's tilts tau_x, tau_y [rad]. Of a fisheye (4,) k1, k2, k3, k4.

    Raises ValueError: another number of coefficients.
    """
    count = distortion.size
    if distortion.ndim != 1 or count not in ((4,) if fisheye else COUNTS):
        raise ValueError(f"{count} coefficients" + " of a fisheye" * fisheye)
    if count <= _BROWN and not fisheye:
        return distortion if count == _BROWN else np.append(distortion, 0.0)
    lens = np.zeros(_SIZE)
    tilt = np.eye(3)
    if fisheye:
        lens[[0, 1, _K3, _K4]] = distortion
    else:
        lens[: min(count, 12)] = distortion[:12]
        tilt = _tilted(*distortion[12:]) if count == 14 else tilt
    lens[_TILT:_MODEL] = tilt.ravel()
    lens[_MODEL] = FISHEYE if fisheye else GENERAL
    return lens[None]


def parallel_lens() -> np.ndarray:
    """The lens array of a parallel camera, (1, 1, 22)."""
    lens = np.zeros((1, 1, _SIZE))
    lens[0, 0, _TILT:_MODEL] = np.eye(3).ravel()
    lens[0, 0, _MODEL] = PARALLEL
    return lens


def of_one_size(lenses: Sequence[np.ndarray]) -> np.ndarray:
    """Several lenses as one array, (C, 5), (C, 1, 22) where one of them is not Brown's, or (C, 1, 1, 22) where one is a
    parallel camera's."""
    axes = max((lens.ndim for lens in lenses), default=1)
    if axes > 1:
        lenses = [lens if lens.ndim > 1 else lens_array(np.append(lens, np.zeros(3))) for lens in lenses]
        lenses = [lens if lens.ndim == axes else lens[None] for lens in lenses]
    return np.array(lenses)


@jit
def is_parallel(lens):  # type: ignore[no-untyped-def]
    """Whether a lens (5,), (1, 22) or (1, 1, 22) is a parallel camera's; of the first two known when compiled."""
    if lens.ndim == 3:
        return lens[0, 0, _MODEL] == PARALLEL
    return False


@jit
def row_of(lens):  # type: ignore[no-untyped-def]
    """The numbers (22,) of a lens beyond Brown's model, (1, 22) or (1, 1, 22)."""
    if lens.ndim == 3:
        return lens[0, 0]
    return lens[0]


def _tilted(tau_x: float, tau_y: float) -> np.ndarray:
    """Homography (3, 3) onto a sensor turned about x, then y, by angles [rad] (OpenCV's `computeTiltProjectionMatrix`;
    Louhichi et al. 2007)."""
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    R = about_y @ about_x
    return np.array([[R[2, 2], 0.0, -R[0, 2]], [0.0, R[2, 2], -R[1, 2]], [0.0, 0.0, 1.0]]) @ R


@register_jitable
def distorted(a, b, lens):  # type: ignore[no-untyped-def]
    """Directions (a, b, 1) distorted by the lens, in the plane z = 1: numbers, or arrays of one shape.

    The only place of the formulas: `estimator.data.cameras.projection` compiles it. lens (5,), (1, 22) or (1, 1, 22),
    of a camera that is not parallel.
    """
    if lens.ndim == 2:
        return _bent(a, b, lens[0])
    if lens.ndim == 3:
        return _bent(a, b, lens[0, 0])
    k1, k2, p1, p2, k3 = lens[0], lens[1], lens[2], lens[3], lens[4]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    ad = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    bd = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    return ad, bd


@register_jitable
def _bent(a, b, lens):  # type: ignore[no-untyped-def]
    """`distorted` beyond Brown's model, lens (22,)."""
    p1, p2 = lens[2], lens[3]
    r2 = a * a + b * b
    if lens[_MODEL] == FISHEYE:
        r = np.sqrt(r2 + _TINY)
        angle = np.arctan(r)
        t2 = angle * angle
        radial = angle / r * (1.0 + t2 * (lens[0] + t2 * (lens[1] + t2 * (lens[_K3] + t2 * lens[_K4]))))
        return a * radial, b * radial
    radial = 1.0 + r2 * (lens[0] + r2 * (lens[1] + r2 * lens[4]))
    radial = radial / (1.0 + r2 * (lens[5] + r2 * (lens[6] + r2 * lens[7])))
    ad = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a) + r2 * (lens[8] + r2 * lens[9])
    bd = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b + r2 * (lens[10] + r2 * lens[11])
    w = lens[18] * ad + lens[19] * bd + lens[20]
    return (lens[12] * ad + lens[13] * bd + lens[14]) / w, (lens[15] * ad + lens[16] * bd + lens[17]) / w


@jit
def _radial(w, lens):  # type: ignore[no-untyped-def]
    """The factor of a direction at squared radius w, and its first and second derivative by w; lens (22,)."""
    if lens[_MODEL] == FISHEYE:
        return _fisheye_radial(w, lens)
    n = 1.0 + w * (lens[0] + w * (lens[1] + w * lens[4]))
    n1 = lens[0] + w * (2.0 * lens[1] + w * 3.0 * lens[4])
    n2 = 2.0 * lens[1] + 6.0 * w * lens[4]
    d = 1.0 + w * (lens[5] + w * (lens[6] + w * lens[7]))
    d1 = lens[5] + w * (2.0 * lens[6] + w * 3.0 * lens[7])
    d2 = 2.0 * lens[6] + 6.0 * w * lens[7]
    g = n / d
    g1 = (n1 - g * d1) / d
    return g, g1, (n2 - 2.0 * g1 * d1 - g * d2) / d


@jit
def _fisheye_radial(w, lens):  # type: ignore[no-untyped-def]
    """`_radial` of a fisheye, lens (22,): angle / r times a polynomial of the angle's square."""
    s, s1, s2 = 0.0, 0.0, 0.0
    if w < _SERIES:  # atan(r) / r = 1 - w/3 + w^2/5 - ...
        for n in range(9, -1, -1):
            c = (1.0 - 2.0 * (n % 2)) / (2.0 * n + 1.0)
            s2 = s2 * w + 2.0 * s1
            s1 = s1 * w + s
            s = s * w + c
    else:
        r = np.sqrt(w)
        s = np.arctan(r) / r
        s1 = (1.0 / (1.0 + w) - s) / (2.0 * w)
        s2 = (-1.0 / ((1.0 + w) * (1.0 + w)) - 3.0 * s1) / (2.0 * w)
    t = w * s * s  # the angle's square
    t1 = s / (1.0 + w)
    t2 = (s1 - t1) / (1.0 + w)
    k1, k2, k3, k4 = lens[0], lens[1], lens[_K3], lens[_K4]
    p = 1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)))
    p1 = k1 + t * (2.0 * k2 + t * (3.0 * k3 + t * 4.0 * k4))
    p2 = 2.0 * k2 + t * (6.0 * k3 + t * 12.0 * k4)
    g1 = s1 * p + s * p1 * t1
    return s * p, g1, s2 * p + 2.0 * s1 * p1 * t1 + s * (p2 * t1 * t1 + p1 * t2)


@jit
def bent_slopes(a, b, lens):  # type: ignore[no-untyped-def]
    """First derivatives of `distorted` beyond Brown's model, lens (22,): ad by a, ad by b, bd by a, bd by b."""
    x_a, x_b, y_a, y_b = _flat_slopes(a, b, lens)
    X_x, X_y, Y_x, Y_y, _ = _tilt_slopes(a, b, lens)
    return X_x * x_a + X_y * y_a, X_x * x_b + X_y * y_b, Y_x * x_a + Y_y * y_a, Y_x * x_b + Y_y * y_b


@jit
def bent_curvatures(a, b, lens):  # type: ignore[no-untyped-def]
    """Second derivatives of `distorted` beyond Brown's model, lens (22,): ad by aa, ab, bb, then bd by aa, ab, bb."""
    x_a, x_b, y_a, y_b = _flat_slopes(a, b, lens)
    X_x, X_y, Y_x, Y_y, w = _tilt_slopes(a, b, lens)
    p1, p2 = lens[2], lens[3]
    r2 = a * a + b * b
    _, g1, g2 = _radial(r2, lens)
    s, t = 2.0 * (lens[8] + 2.0 * lens[9] * r2), 2.0 * (lens[10] + 2.0 * lens[11] * r2)
    aab, abb = 2.0 * b * g1 + 4.0 * a * a * b * g2 + 2.0 * p1, 2.0 * a * g1 + 4.0 * a * b * b * g2 + 2.0 * p2
    x_aa = 6.0 * a * g1 + 4.0 * a * a * a * g2 + 6.0 * p2 + s + 8.0 * a * a * lens[9]
    x_ab = aab + 8.0 * a * b * lens[9]
    x_bb = abb + s + 8.0 * b * b * lens[9]
    y_aa = aab + t + 8.0 * a * a * lens[11]
    y_ab = abb + 8.0 * a * b * lens[11]
    y_bb = 6.0 * b * g1 + 4.0 * b * b * b * g2 + 6.0 * p1 + t + 8.0 * b * b * lens[11]
    h, k = lens[18] / w, lens[19] / w  # second derivatives of the tilt are products of these and its first
    wa, wb = h * x_a + k * y_a, h * x_b + k * y_b
    Xa, Xb = X_x * x_a + X_y * y_a, X_x * x_b + X_y * y_b
    Ya, Yb = Y_x * x_a + Y_y * y_a, Y_x * x_b + Y_y * y_b
    return (
        X_x * x_aa + X_y * y_aa - 2.0 * wa * Xa,
        X_x * x_ab + X_y * y_ab - wa * Xb - wb * Xa,
        X_x * x_bb + X_y * y_bb - 2.0 * wb * Xb,
        Y_x * x_aa + Y_y * y_aa - 2.0 * wa * Ya,
        Y_x * x_ab + Y_y * y_ab - wa * Yb - wb * Ya,
        Y_x * x_bb + Y_y * y_bb - 2.0 * wb * Yb,
    )


@jit
def _flat_slopes(a, b, lens):  # type: ignore[no-untyped-def]
    """First derivatives before the sensor's tilt, lens (22,): x by a, x by b, y by a, y by b."""
    p1, p2 = lens[2], lens[3]
    r2 = a * a + b * b
    g, g1, _ = _radial(r2, lens)
    s, t = 2.0 * (lens[8] + 2.0 * lens[9] * r2), 2.0 * (lens[10] + 2.0 * lens[11] * r2)
    mixed = 2.0 * a * b * g1 + 2.0 * p1 * a + 2.0 * p2 * b
    x_a = g + 2.0 * a * a * g1 + 2.0 * p1 * b + 6.0 * p2 * a + a * s
    y_b = g + 2.0 * b * b * g1 + 6.0 * p1 * b + 2.0 * p2 * a + b * t
    return x_a, mixed + b * s, mixed + a * t, y_b


@jit
def _tilt_slopes(a, b, lens):  # type: ignore[no-untyped-def]
    """First derivatives of the sensor's tilt where it puts the direction (a, b, 1), and its divisor; lens (22,)."""
    X, Y = _bent(a, b, lens)
    # where on the plane before the tilt: its divisor there, from the homography's inverse as cofactors
    t00, t01, t02, t10, t11, t12 = lens[12], lens[13], lens[14], lens[15], lens[16], lens[17]
    t20, t21, t22 = lens[18], lens[19], lens[20]
    c0, c1, c2 = t10 * t21 - t11 * t20, t01 * t20 - t00 * t21, t00 * t11 - t01 * t10
    whole = t00 * (t11 * t22 - t12 * t21) - t01 * (t10 * t22 - t12 * t20) + t02 * (t10 * t21 - t11 * t20)
    w = whole / (c0 * X + c1 * Y + c2)
    return (t00 - X * t20) / w, (t01 - X * t21) / w, (t10 - Y * t20) / w, (t11 - Y * t21) / w, w


def undistorted(points: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """The inverse of `distorted`: places (N, 2) in the plane z = 1 -> directions a, b (N, 2), NaN where none leads
    there.

    Of Brown's model OpenCV's five iterations; of the others to rounding, by Newton's method.
    """
    if lens.ndim == 1:
        bent = np.ascontiguousarray(points[:, None])
        return np.asarray(cv2.undistortPoints(bent, np.eye(3), lens)[:, 0])
    row = lens[0]
    start = _fisheye_start(points, row) if row[_MODEL] == FISHEYE else points.copy()
    _refine(points, row, start)
    return start


def _fisheye_start(points: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Directions of a fisheye (N, 2), from the angle's polynomial by Newton's method."""
    bent = np.linalg.norm(points, axis=1)
    k = lens[[0, 1, _K3, _K4]]
    angle = np.minimum(bent, 1.0)
    for _ in range(_STEPS):
        t2 = angle**2
        value = angle * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
        slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
        angle = np.clip(angle - (value - bent) / np.where(np.abs(slope) > 1e-9, slope, 1.0), 0.0, 1.57)
    return np.asarray(points * (np.tan(angle) / np.maximum(bent, _TINY))[:, None] if len(points) else points)


@jit
def _refine(points, lens, start):  # type: ignore[no-untyped-def]
    """Newton's method for `undistorted`: from start (N, 2), filled in place, to the directions that lens (22,) puts at
    points (N, 2); NaN where that does not end."""
    for i in range(len(points)):
        a, b = start[i, 0], start[i, 1]
        solved = False
        for _ in range(_STEPS):
            x, y = _bent(a, b, lens)
            u, v = points[i, 0] - x, points[i, 1] - y
            if u * u + v * v <= (_CLOSE * _CLOSE) * (1.0 + x * x + y * y):
                solved = True
                break
            x_a, x_b, y_a, y_b = bent_slopes(a, b, lens)
            det = x_a * y_b - x_b * y_a
            da, db = (y_b * u - x_b * v) / det, (x_a * v - y_a * u) / det
            longest = 0.5 * (1.0 + np.sqrt(a * a + b * b)) / np.sqrt(da * da + db * db + _TINY)  # of a step
            share = min(1.0, longest)
            a, b = a + share * da, b + share * db
        start[i, 0], start[i, 1] = (a, b) if solved else (np.nan, np.nan)
