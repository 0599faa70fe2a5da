"""How large distances are, without their outliers."""

from __future__ import annotations

import warnings

import numpy as np

_MEDIAN = np.sqrt(np.log(2.0))  # over the root mean square, of distances in a plane of a normal distribution


def typical_distance(distances: np.ndarray, axis: int | tuple[int, ...] | None = None) -> np.ndarray:
    """Root mean square of distances in a plane over an axis, over all unless given, without outliers: of the normal
    distribution that has their median; NaN where there are none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that there are none
        return np.asarray(np.nanmedian(distances, axis=axis) / _MEDIAN)
