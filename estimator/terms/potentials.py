"""Robust error potentials (CSS section 3.1.1).

A potential rho acts on a squared, whitened residual s = r' r / sigma^2; an observation costs rho(s) / 2, so that all
potentials agree with a Gaussian, s / 2, near zero. `nu` is the spread of the outliers: the squared residual, in units
of sigma^2, where an observation starts to lose its pull. In the notation of CSS, rho(s, sigma_css) with
sigma_css^2 = nu sigma^2.
"""

from __future__ import annotations

from estimator.terms.kernels import GAUSSIAN, LECLERC, LORENTZIAN

POTENTIALS = {"gaussian": GAUSSIAN, "lorentzian": LORENTZIAN, "leclerc": LECLERC}
"""Potentials by name; `estimator.terms.kernels.rho` computes them."""
