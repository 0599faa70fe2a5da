"""Robust error potentials (CSS section 3.1.1).

A potential rho acts on a squared, whitened residual s = r' r / sigma^2; an observation costs rho(s) / 2, so that all
potentials agree with a Gaussian, s / 2, near zero. `nu` is the spread of the outliers: the squared residual, in units
of sigma^2, where an observation starts to lose its pull. In the notation of CSS, rho(s, sigma_css) with
sigma_css^2 = nu sigma^2.
"""

from __future__ import annotations

import math

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
