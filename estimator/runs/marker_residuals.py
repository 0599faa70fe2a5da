"""Distances of measured markers from their places on the tracked body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.energy.marker_targets import MarkerNoise
from estimator.runs.run_reader import Run

_NEAREST = 3.0  # standard deviations along one axis up to which a marker is not an outlier


class MarkerResiduals(NamedTuple):
    """names (M). apart (T, M) [m]: from each place on the body at `Run.q` to where the marker was measured, NaN where
    it was not, or there is no pose. std (M,) [m]: its expected standard deviation along each axis."""

    names: tuple[str, ...]
    apart: np.ndarray
    std: np.ndarray

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of each marker (M,) [m], outliers included; NaN of one that was never measured."""
        square = np.square(self.apart)
        count = np.isfinite(square).sum(axis=0)
        return np.asarray(np.sqrt(np.nansum(square, axis=0) / np.where(count, count, np.nan)))

    @property
    def median(self) -> np.ndarray:
        """Median distance of each marker (M,) [m]; NaN of one that was never measured."""
        known = np.isfinite(self.apart).any(axis=0)
        medians = np.full(len(self.names), np.nan)
        medians[known] = np.nanmedian(self.apart[:, known], axis=0)
        return medians

    @property
    def outlying(self) -> np.ndarray:
        """Share of each marker's measurements (M,) that lie farther away than three standard deviations."""
        seen = np.isfinite(self.apart).sum(axis=0)
        far = (np.nan_to_num(self.apart) > _NEAREST * self.std).sum(axis=0)
        return np.asarray(far / np.where(seen, seen, np.nan))

    @property
    def missing(self) -> np.ndarray:
        """Share of the frames (M,) in which each was not measured."""
        return np.asarray(np.isnan(self.apart).mean(axis=0))


def marker_residuals(run: Run, noise: MarkerNoise) -> MarkerResiduals | None:
    """Residuals of a run by markers; None for any other. noise: that of its settings."""
    body, measured = run.body, run.markers
    if measured is None:
        return None
    places = body.markers_of(body.placed(np.nan_to_num(run.q)))
    apart = np.linalg.norm(measured[run.index] - places, axis=2)
    apart[~np.isfinite(run.q).all(axis=1)] = np.nan
    return MarkerResiduals(body.marker_names, apart, noise.stds(body))
