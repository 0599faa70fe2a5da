"""A person's joints as several cameras see them, at any instants of any clocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.moving_rays import at_times, averaged

_SLOPE = 0.03  # s, to either side, over which a slope is measured


class JointView(NamedTuple):
    """camera: its lens; where it stands does not count. pixels (N, J, 2): of the joints, NaN where missing. times (N,)
    [s], rising, by its own clock."""

    camera: Camera
    pixels: np.ndarray
    times: np.ndarray


class JointRays:
    """Rays of a view, free of the lens, and averaged over 0.02 s."""

    def __init__(self, view: JointView) -> None:
        self.times = view.times
        self._rays = averaged(view.camera.directions(view.pixels)[..., :2], view.times)

    @property
    def extent(self) -> float:
        """The person's size in the plane z = 1, the median over the frames; NaN if not seen."""
        known = self._rays[np.isfinite(self._rays).all(axis=2).sum(axis=1) > 1]
        sides = np.nanmax(known, axis=1) - np.nanmin(known, axis=1)
        return float(np.median(np.hypot(sides[:, 0], sides[:, 1]))) if len(known) else np.nan

    def at(self, instants: np.ndarray) -> np.ndarray:
        """(T, J, 2) at instants (T,) [s] of its clock."""
        return at_times(self._rays, self.times, instants)

    def slope(self, instants: np.ndarray) -> np.ndarray:
        """(T, J, 2) [1/s] there."""
        return (self.at(instants + _SLOPE) - self.at(instants - _SLOPE)) / (2.0 * _SLOPE)


def with_depth(rays: np.ndarray) -> np.ndarray:
    """Places (..., 2) in the plane z = 1 as directions (..., 3)."""
    return np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)


def read(views: Sequence[JointRays], instants: np.ndarray, late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays and slopes (C, T, J, 2) where each clock is read so much later, late (C,) [s]."""
    rays = np.stack([view.at(instants + lag) for view, lag in zip(views, late, strict=True)])
    slope = np.stack([view.slope(instants + lag) for view, lag in zip(views, late, strict=True)])
    return rays, slope


def common_instants(views: Sequence[JointRays], late: np.ndarray, most: int) -> np.ndarray:
    """At most so many instants, evenly over the common time of all clocks; none without any."""
    begin = max(float(view.times[0] - lag) for view, lag in zip(views, late, strict=True))
    end = min(float(view.times[-1] - lag) for view, lag in zip(views, late, strict=True))
    step = max(float(np.median(np.diff(view.times))) for view in views)
    count = int(np.floor((end - begin) / step + 1e-6)) + 1 if end >= begin else 0
    frames = np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).round())
    return begin + step * frames
