"""Robust error potentials (CSS section 3.1.1).

A potential rho acts on a squared, whitened residual s = r' r / sigma^2; an observation costs rho(s) / 2, so that all
potentials agree with a Gaussian, s / 2, near zero. `nu` is the spread of the outliers: the squared residual, in units
of sigma^2, where an observation starts to lose its pull. In the notation of CSS, rho(s, sigma_css) with
sigma_css^2 = nu sigma^2.

Typical size of distances, without outliers.
"""

from __future__ import annotations

import math
import warnings

import numpy as np

from humanoid.support.compiled import jit

GAUSSIAN, LORENTZIAN, LECLERC = 0, 1, 2
POTENTIALS = {"gaussian": GAUSSIAN, "lorentzian": LORENTZIAN, "leclerc": LECLERC}
"""Potentials by name; `rho` computes them."""


@jit
def rho(kind: int, s: float, nu: float) -> tuple[float, float, float]:
    """Value, first and second derivative of the potential at the squared whitened residual s."""
    if kind == LORENTZIAN:
        slope = 1.0 / (1.0 + s / nu)
        return nu * math.log1p(s / nu), slope, -slope * slope / nu
    if kind == LECLERC:
        e = math.exp(-s / nu)
        return nu * (1.0 - e), e, -e / nu
    return s, 1.0, 0.0


@jit
def slopes(kind, s, nu, out):  # type: ignore[no-untyped-def]
    """Fill out (N,) with the first derivatives of the potential at squares s (N,)."""
    for i in range(s.shape[0]):
        out[i] = rho(kind, s[i], nu)[1]


@jit
def robust_square(e, precision, kind, nu, exact, pull, bend):  # type: ignore[no-untyped-def]
    """1/2 sum rho(precision e^2) of e, precision (nv,); fills its derivative `pull` (nv,) and its curvature `bend`
    (nv,), Gauss-Newton's or the exact one."""
    value = 0.0
    for i in range(e.shape[0]):
        cost, slope, curve = rho(kind, e[i] * e[i] * precision[i], nu)
        value += 0.5 * cost
        pull[i] = slope * precision[i] * e[i]
        bend[i] = precision[i] * (slope + (2.0 * curve * e[i] * e[i] * precision[i] if exact else 0.0))
    return value


@jit
def robust_sum(e, precision, kind, nu):  # type: ignore[no-untyped-def]
    """The value of `robust_square` alone: e (nv,), precision (nv,)."""
    value = 0.0
    for i in range(e.shape[0]):
        value += 0.5 * rho(kind, e[i] * e[i] * precision[i], nu)[0]
    return value


PRIOR_DATA = 60.0
"""Samples that represent the prior knowledge of a detector's noise: 60 draws determine a standard deviation to a tenth,
and the errors of one detector differ between two people by no less."""
_MEDIAN = np.sqrt(np.log(2.0))  # over the root mean square, of distances in a plane of a normal distribution


def typical_distance(distances: np.ndarray, axis: int | tuple[int, ...] | None = None) -> np.ndarray:
    """Root mean square of distances in a plane over an axis, by default over all, without outliers: of the normal
    distribution that has their median; NaN where there are none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that there are none
        return np.asarray(np.nanmedian(distances, axis=axis) / _MEDIAN)


def measured_deviation(distances: np.ndarray, data: float) -> float:
    """Standard deviation along an axis, without outliers, of distances in a plane of which 1 was expected: estimated
    from `data` independent numbers and `PRIOR_DATA` prior ones that are as expected; 1 where there are none."""
    known = distances[np.isfinite(distances)]
    if not len(known):
        return 1.0
    square = 0.5 * float(typical_distance(known)) ** 2
    return float(np.sqrt((PRIOR_DATA + data * square) / (PRIOR_DATA + data)))
