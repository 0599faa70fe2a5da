"""Superquadric ellipsoids, tapered and bent: points, normals and their derivatives (Barr 1984; CSS section 2, eq. 1).

Parameters of a part, (9,): a, b, c, e1, e2, tx, ty, bx, by.

    a, b, c     half-axes along x, y, z [m]
    e1, e2      exponents along z and around z: 1 is an ellipsoid, below 1 squarish, towards 2 a double pyramid
    tx, ty      tapering: x and y are multiplied by 1 + t z / c
    bx, by      bending: curvature of the z axis [1/m] towards x and y

The domain is u = (latitude in [-pi/2, pi/2], longitude in [-pi, pi]). Barr's ellipsoid (A. Barr, Superquadrics and
angle-preserving transformations, IEEE CG&A 1981) is tapered, then bent (A. Barr, Global and local deformations of solid
primitives, SIGGRAPH 1984).

Both bends are one, in the plane of the z axis and k = (bx, by), so that their order does not matter: the axis becomes
an arc of a circle through the origin, and sections stay plane and normal to it. With m = 1 - k . (x, y) and w = |k|^2
z^2,

    (x, y)' = (x, y) + k z^2 C(w) m,    C(w) = (1 - cos sqrt(w)) / w
    z'      = z S(w) m,                 S(w) = sin sqrt(w) / sqrt(w)

which is analytic in k, also where it is zero. The map folds where m <= 0. Its volume element is m, so that bending
leaves the volume of a part as it was.
"""

from __future__ import annotations

import numpy as np

from humanoid.subject.urdf_document import PLAUSIBLE

NAMES = ("a", "b", "c", "e1", "e2", "tx", "ty", "bx", "by")
EXPONENTS = (0.1, 2.0)  # beyond: corners that no number of nodes shows, and surfaces that cave in
TAPER = 0.95  # at 1 an end is a point or a line
_FOLD = 0.9  # of the centre of curvature's distance: how far the thickest section may reach towards it
_SERIES = 1e-2  # below this the series of C and S are exact to rounding with five terms
# signs that turn the parameters of a part into those of its mirror image in the plane y = 0
MIRROR = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0])


def fault(parameters: np.ndarray) -> tuple[str, str] | None:
    """The problem of invalid parameters (9,), and the remedy; None for valid ones."""
    p = np.asarray(parameters, dtype=float)
    if p.shape != (9,) or not np.isfinite(p).all():
        return "nine finite numbers are needed", "they are " + ", ".join(NAMES)
    radii, exponents, taper, bend = p[:3], p[3:5], p[5:7], p[7:]
    if radii.min() <= 0.0 or radii.max() > PLAUSIBLE:
        return "a size is not positive", "give radii in metres, above 0"
    if exponents.min() < EXPONENTS[0] or exponents.max() > EXPONENTS[1]:
        return f"exponents {_text(exponents)} are out of range", f"{EXPONENTS[0]:g} to {EXPONENTS[1]:g}, 1 for round"
    if np.abs(taper).max() > TAPER:
        return f"taper {_text(taper)} is out of range", f"-{TAPER:g} to {TAPER:g}, 0 for none"
    limit = largest_bend(p)
    if np.hypot(*bend) > limit:
        return f"bend {_text(bend)} folds the surface", f"at most {limit:.3g} per metre for this size"
    return None


def largest_bend(parameters: np.ndarray) -> float:
    """The largest curvature [1/m] at which a part neither folds nor becomes more than half a circle."""
    a, b, c, _, _, tx, ty, _, _ = parameters
    corner = np.hypot(a * (1.0 + abs(tx)), b * (1.0 + abs(ty)))  # as far as a squarish section may reach
    return float(min(_FOLD / corner, np.pi / (2.0 * c)))


def points(parameters: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Surface points (N, 3) [m] of parameters (9,) at u (N, 2)."""
    return _bent(parameters, _tapered(parameters, _ellipsoid(parameters, u)))


def normals(parameters: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Outward unit normals (N, 3) at u (N, 2).

    Those of the ellipsoid (Barr 1981), taken along by the inverse transposed Jacobian of the deformation (Barr 1984);
    they exist where the parametrisation is singular too, as at the poles.
    """
    e1, e2 = parameters[3:5]
    (cos_lat, sin_lat), (cos_lon, sin_lon) = _circle(u[:, 0]), _circle(u[:, 1])
    across = _power(cos_lat, 2.0 - e1)
    own = np.stack(
        [across * _power(cos_lon, 2.0 - e2), across * _power(sin_lon, 2.0 - e2), _power(sin_lat, 2.0 - e1)], axis=-1
    )
    jacobian = deformation_jacobian(parameters, _ellipsoid(parameters, u))
    carried = np.linalg.solve(jacobian.transpose(0, 2, 1), (own / parameters[:3])[..., None])[..., 0]
    return carried / np.linalg.norm(carried, axis=1, keepdims=True)


def derivatives(parameters: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Derivatives of the points at u (N, 2) with respect to the nine parameters, (N, 3, 9)."""
    a, b, c, _, _, tx, ty, _, _ = parameters
    x, y, z = _ellipsoid(parameters, u).T
    (cos_lat, sin_lat), (cos_lon, sin_lon) = _circle(u[:, 0]), _circle(u[:, 1])
    log_cos, log_sin = _log(cos_lat), _log(sin_lat)
    s = z / c
    thick_x, thick_y = 1.0 + tx * s, 1.0 + ty * s
    tapered = np.zeros((len(u), 3, 9))
    tapered[:, 0, 0], tapered[:, 1, 1], tapered[:, 2, 2] = x / a * thick_x, y / b * thick_y, s
    tapered[:, 0, 3] = x * (log_cos * thick_x + tx * s * log_sin)  # s itself depends on e1, though not on c
    tapered[:, 1, 3] = y * (log_cos * thick_y + ty * s * log_sin)
    tapered[:, 2, 3] = z * log_sin
    tapered[:, 0, 4], tapered[:, 1, 4] = x * _log(cos_lon) * thick_x, y * _log(sin_lon) * thick_y
    tapered[:, 0, 5], tapered[:, 1, 6] = x * s, y * s
    q = np.stack([x * thick_x, y * thick_y, z], axis=-1)
    D = _bend_jacobian(parameters, q) @ tapered
    D[:, :, 7:] += _bend_by_curvature(parameters, q)
    return D


def deformation_jacobian(parameters: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Derivative of the deformed point by the point x (N, 3) of the undeformed part, (N, 3, 3)."""
    c, tx, ty = parameters[2], parameters[5], parameters[6]
    taper = np.zeros((len(x), 3, 3))
    taper[:, 0, 0], taper[:, 1, 1], taper[:, 2, 2] = 1.0 + tx * x[:, 2] / c, 1.0 + ty * x[:, 2] / c, 1.0
    taper[:, 0, 2], taper[:, 1, 2] = x[:, 0] * tx / c, x[:, 1] * ty / c
    return _bend_jacobian(parameters, _tapered(parameters, x)) @ taper


def _ellipsoid(parameters: np.ndarray, u: np.ndarray) -> np.ndarray:
    a, b, c, e1, e2 = parameters[:5]
    (cos_lat, sin_lat), (cos_lon, sin_lon) = _circle(u[:, 0]), _circle(u[:, 1])
    across = _power(cos_lat, e1)
    return np.stack(
        [a * across * _power(cos_lon, e2), b * across * _power(sin_lon, e2), c * _power(sin_lat, e1)], axis=-1
    )


def _tapered(parameters: np.ndarray, x: np.ndarray) -> np.ndarray:
    tapered = x.copy()
    tapered[:, :2] *= 1.0 + x[:, 2:] / parameters[2] * parameters[5:7]
    return tapered


def _bent(parameters: np.ndarray, x: np.ndarray) -> np.ndarray:
    k, z = parameters[7:9], x[:, 2]
    C, S, _, _ = _arc(k @ k * z**2)
    m = 1.0 - x[:, :2] @ k
    return np.concatenate([x[:, :2] + k * (z**2 * C * m)[:, None], (z * S * m)[:, None]], axis=1)


def _bend_jacobian(parameters: np.ndarray, x: np.ndarray) -> np.ndarray:
    k, z = parameters[7:9], x[:, 2]
    w = k @ k * z**2
    C, S, _, _ = _arc(w)
    m = 1.0 - x[:, :2] @ k
    J = np.empty((len(x), 3, 3))
    J[:, :2, :2] = np.eye(2) - np.outer(k, k) * (z**2 * C)[:, None, None]
    J[:, :2, 2] = k * (m * z * S)[:, None]
    J[:, 2, :2] = -k * (z * S)[:, None]
    J[:, 2, 2] = m * np.cos(np.sqrt(w))
    return J


def _bend_by_curvature(parameters: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Derivative of the bent point by (bx, by), (N, 3, 2)."""
    k, xy, z = parameters[7:9], x[:, :2], x[:, 2]
    C, S, dC, dS = _arc(k @ k * z**2)
    m = 1.0 - xy @ k
    J = np.empty((len(x), 3, 2))
    across = (2.0 * z**4 * dC * m)[:, None] * k - (z**2 * C)[:, None] * xy
    J[:, :2] = np.eye(2) * (z**2 * C * m)[:, None, None] + k[:, None] * across[:, None, :]
    J[:, 2] = (2.0 * z**3 * dS * m)[:, None] * k - (z * S)[:, None] * xy
    return J


def _arc(w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """C, S and their derivatives at w >= 0; where the closed forms cancel, their series."""
    small = w < _SERIES
    safe = np.where(small, 1.0, w)
    angle = np.sqrt(safe)
    C, S = 2.0 * np.sin(angle / 2.0) ** 2 / safe, np.sin(angle) / angle
    dC, dS = (0.5 * S - C) / safe, 0.5 * (np.cos(angle) - S) / safe
    v = np.where(small, w, 0.0)
    return (
        np.where(small, 1 / 2 - v / 24 + v**2 / 720 - v**3 / 40320 + v**4 / 3628800, C),
        np.where(small, 1.0 - v / 6 + v**2 / 120 - v**3 / 5040 + v**4 / 362880, S),
        np.where(small, -1 / 24 + v / 360 - v**2 / 13440 + v**3 / 907200, dC),
        np.where(small, -1 / 6 + v / 60 - v**2 / 1680 + v**3 / 90720, dS),
    )


def _circle(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.cos(angle), np.sin(angle)


def _power(x: np.ndarray, exponent: float) -> np.ndarray:
    """|x|^exponent with the sign of x."""
    return np.sign(x) * np.abs(x) ** exponent


def _log(x: np.ndarray) -> np.ndarray:
    """log |x|, and 0 at 0, where it only meets factors that vanish faster."""
    return np.log(np.where(x == 0.0, 1.0, np.abs(x)))


def _text(values: np.ndarray) -> str:
    return " ".join(f"{v:g}" for v in values)
