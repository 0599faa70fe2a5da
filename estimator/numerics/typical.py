"""Typical size of distances, without outliers."""

from __future__ import annotations

import warnings

import numpy as np

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
