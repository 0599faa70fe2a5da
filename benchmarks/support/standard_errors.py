"""Standard errors of figures that are not plain means of independent numbers."""

from __future__ import annotations

import numpy as np


def of_share(hits: int, count: int) -> float:
    """Of a share of independent trials, binomial, with one hit and one miss added: none of ten is not known exactly."""
    share = (hits + 1.0) / (count + 2.0)
    return float(np.sqrt(share * (1.0 - share) / (count + 2.0)))


def of_ratio(above: np.ndarray, below: np.ndarray) -> float:
    """Of the ratio of the means of pairs (N,), by the delta method; NaN for a single pair."""
    residual = above - above.mean() / below.mean() * below
    return of_mean(residual) / float(below.mean())


def of_mean(values: np.ndarray) -> float:
    """Of the mean of independent values (N,); NaN for a single one."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")
