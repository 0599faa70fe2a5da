"""The uncertainty of every degree of freedom in a run, by frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from estimator.runs.marginals import Marginals
from humanoid.support.errors import InputError, misplaced

if TYPE_CHECKING:
    from estimator.runs.run_reader import Run

LEVEL = 0.9
"""The level of the intervals that plots, pages and tables show."""
_AT_ONCE = 400  # components of frames that are searched together: fewer cost more calls, more leave the cache


class Spread(NamedTuple):
    """The calibrated posterior of T frames, for each degree of freedom; NaN in frames without hypotheses, and for a
    retargeted motion, which was not measured.

    std (T, nv): standard deviations over all hypotheses [rad, m]. best (T, nq): the configuration that `ends` is
    relative to. ends (T, 2, nv): ends of the central interval of a level, in the tangent space at `best`, within the
    joint limits: quantiles of the mixture, which with several hypotheses is not Gaussian. Unobserved joints may be
    anywhere within their limits.
    """

    std: np.ndarray
    best: np.ndarray
    ends: np.ndarray


def checked_level(level: Any, joint: str) -> float:
    """A probability; raises InputError for any other number, and for anything else, such as the name of a joint. joint:
    for the example in the message."""
    if isinstance(level, bool) or not isinstance(level, (int, float, np.integer, np.floating)):
        taken = f"a probability, as run.interval({LEVEL}); of one joint: run[{joint!r}].low and .high"
        raise misplaced("level", level, taken)
    if not 0.0 <= level <= 1.0:
        raise InputError("level", f"{level:g} is not a probability", remedy="0 to 1, as 0.9")
    return float(level)


def spread_of(run: Run, level: float) -> Spread:
    """The spread of all frames of a run, with the central intervals of this probability, 0 to 1."""
    body, count = run.body, len(run)
    std, best = np.full((count, body.nv), np.nan), np.full((count, body.nq), np.nan)
    ends = np.full((count, 2, body.nv), np.nan)
    known = np.flatnonzero(np.isfinite(run.mode_weight).any(axis=1)).tolist()
    if run.header.retargeted:
        return Spread(std, run.q, ends)
    rows: list[int] = []
    parts: list[Marginals] = []
    for t in known:
        posterior = run.posterior(t)
        best[t] = posterior.best
        rows.append(t)
        parts.append(posterior.marginals())
        if t == known[-1] or sum(part.weight.shape[-1] for part in parts) >= _AT_ONCE:
            marginals = Marginals.stacked(parts)
            std[rows] = marginals.moments()[1].reshape(-1, body.nv)
            quantiles = marginals.quantiles(0.5 - 0.5 * level, 0.5 + 0.5 * level)
            ends[rows] = quantiles.reshape(2, -1, body.nv).transpose(1, 0, 2)
            rows, parts = [], []
    for joint in run.unseen_joints:
        v, i = body.v_names.index(joint), body.q_names.index(joint)
        std[known, v], ends[known, :, v] = _anywhere(body.lower[i], body.upper[i], best[known, i], level)
    return Spread(std, best, ends)


def _anywhere(lower: float, upper: float, best: np.ndarray, level: float) -> tuple[float, np.ndarray]:
    """Standard deviation, and ends (T, 2) of the central interval of a level beside the best (T,), of a joint that may
    be anywhere within its limits alike."""
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return half / np.sqrt(3.0), middle + level * half * np.array([-1.0, 1.0]) - best[:, None]
