"""Huber's potential: a parabola near zero, a straight line beyond, so that an outlier's pull neither grows nor fades.

P. J. Huber, Robust estimation of a location parameter, Annals of Mathematical Statistics 35(1), 1964.
"""

from __future__ import annotations

import numpy as np

BEND = 1.345
"""Standard deviations from which it is straight: 95 % of the efficiency of least squares on normal errors."""


def huber_weights(r: np.ndarray) -> np.ndarray:
    """Weights (...), at most 1, by which least squares of whitened residuals r (...) have the potential's slope r w."""
    return np.asarray(BEND / np.maximum(np.abs(r), BEND))


def huber_values(r: np.ndarray) -> np.ndarray:
    """The potential (...) of whitened residuals r (...): 1/2 r^2 near zero."""
    inner = np.minimum(np.abs(r), BEND)
    return np.asarray(inner * (np.abs(r) - 0.5 * inner))
