"""How sure a run is of every degree of freedom, frame by frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from estimator.results.run_reader import Run

LEVEL = 0.9
"""The level of the intervals that plots, pages and tables show."""


class Spread(NamedTuple):
    """The calibrated posterior of T frames, a degree of freedom at a time; NaN in frames without hypotheses.

    std (T, nv): standard deviations over all hypotheses [rad, m]. best (T, nq): the configuration that `ends` counts
    from. ends (T, 2, nv): where the central interval of a level begins and ends, in the tangent space at `best`, within
    the joint limits: quantiles of the mixture, which with several hypotheses is no Gaussian.
    """

    std: np.ndarray
    best: np.ndarray
    ends: np.ndarray


def spread_of(run: Run, level: float) -> Spread:
    """The spread of all frames of a run, with the central intervals of this probability."""
    body, count = run.body, len(run)
    std, best = np.full((count, body.nv), np.nan), np.full((count, body.nq), np.nan)
    ends = np.full((count, 2, body.nv), np.nan)
    for t, frame in enumerate(run):
        if len(frame.weight):
            posterior = run.posterior(t)
            best[t] = posterior.best
            std[t], ends[t] = posterior.marginals().spread(0.5 - 0.5 * level, 0.5 + 0.5 * level)
    return Spread(std, best, ends)
