"""Scipy's `least_squares` on the residuals of a frame, watched."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from benchmarks.speed.mode_search_residuals import Residuals


class Watched:
    """Residuals that note the CPU time spent in them, and when half their square was first at a level or below.

    clock: gives the time [s].
    """

    def __init__(self, residuals: Residuals, level: float, clock: Callable[[], float] = time.process_time) -> None:
        self._residuals, self._level, self._clock = residuals, level, clock
        self.inside = 0.0
        self.reached: float | None = None

    def residuals(self, x: np.ndarray) -> np.ndarray:
        r = self._timed(self._residuals.residuals, x)
        if self.reached is None and 0.5 * float(r @ r) <= self._level:
            self.reached = self._clock()
        return r

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        return self._timed(self._residuals.jacobian, x)

    def _timed(self, function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        began = self._clock()
        value = function(x)
        self.inside += self._clock() - began
        return value


def scipy_search(watched: Watched, residuals: Residuals) -> OptimizeResult:
    """With scipy's own tolerances and step limits."""
    return least_squares(
        watched.residuals, residuals.x0, watched.jacobian, bounds=(residuals.lower, residuals.upper), method="trf"
    )
