"""Whether ranks of truths among samples are uniform, as those of a right posterior are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, kstwo

_BINS = 10  # of the ranks; fewer where these would hold less than five each
_FEWEST = 5
LEVELS = np.linspace(0.05, 0.95, 19)


@dataclass(frozen=True, eq=False)
class RankStatistics:
    """Ranks of true values among samples of the posteriors that claim to know them (Talts et al. 2018).

    names (n): of the coordinates. ranks (N, n): how many of the `samples` are below each of N truths, 0 to `samples`.
    """

    names: tuple[str, ...]
    ranks: np.ndarray
    samples: int

    @property
    def chi_square(self) -> np.ndarray:
        """Chi-square statistic (n,) of the ranks in bins of equal probability, with `degrees` of freedom."""
        count = self.degrees + 1
        edges = np.linspace(0.0, 1.0, count + 1)
        inside = np.array([np.histogram(place, edges)[0] for place in self._places().T])
        expected = len(self.ranks) / count
        return np.asarray(np.sum(np.square(inside - expected), axis=1) / expected)

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `chi_square`: one less than there are bins."""
        return int(np.clip(len(self.ranks) // _FEWEST, 2, _BINS)) - 1

    @property
    def p_value(self) -> np.ndarray:
        """Probability (n,) that ranks of a right posterior have so large a `chi_square`."""
        return np.asarray(chi2.sf(self.chi_square, self.degrees))

    @property
    def deviation(self) -> np.ndarray:
        """Largest distance (n,) of a coordinate's empirical distribution from the uniform one: of its ranks, which show
        a bias, and of the central intervals that reach the truth, which show a wrong width."""
        return np.maximum(self._of_ranks(), self._of_intervals())

    @property
    def calibration_error(self) -> float:
        """See `calibration_error`: of central intervals, over all coordinates together."""
        return calibration_error(self._levels())

    def coverage(self, levels: float | np.ndarray) -> np.ndarray:
        """Share of truths within the central intervals of these probabilities, over all coordinates together."""
        return coverage(self._levels(), levels)

    def band(self, chance: float) -> float:
        """The `deviation` that some coordinate of a right posterior exceeds with this probability at most: Kolmogorov's
        distribution, for all coordinates together by Bonferroni's inequality, and a step of the ranks."""
        each = kstwo.isf(chance / (2 * len(self.names)), len(self.ranks))
        return float(each + 1.0 / (self.samples + 1))

    def worst(self) -> str:
        """What is wrong with the coordinate of the largest deviation, in words."""
        k, count = int(np.argmax(self.deviation)), len(self.ranks)
        bias = self._of_ranks()[k] >= self._of_intervals()[k]
        place = np.sort((self._places() if bias else self._levels())[:, k])
        below = (np.arange(count) + 1.0) / count
        at = int(np.argmax(np.abs(below - place)))
        share, level = f"{below[at]:.0%}", f"{place[at]:.0%}"
        if bias:
            return f"{self.names[k]}: {share} of {count} truths are below the {level} quantile"
        return f"{self.names[k]}: central intervals of {level} have {share} of {count} truths in them"

    def _places(self) -> np.ndarray:
        return (self.ranks + 0.5) / (self.samples + 1)

    def _levels(self) -> np.ndarray:
        """The probability (N, n) of the smallest central interval that has the truth in it."""
        return np.abs(2.0 * self._places() - 1.0)

    def _of_ranks(self) -> np.ndarray:
        return _distance(self._places())

    def _of_intervals(self) -> np.ndarray:
        return _distance(self._levels())


def coverage(levels: np.ndarray, level: float | np.ndarray) -> np.ndarray:
    """Share (P,) of truths within their regions of the given level or levels (P,); levels (...): of the smallest region
    that has each truth in it."""
    return np.asarray(np.mean(levels.ravel()[:, None] <= np.atleast_1d(level), axis=0))


def calibration_error(levels: np.ndarray) -> float:
    """Expected calibration error: mean over `LEVELS` of how far the `coverage` is from the level."""
    return float(np.mean(np.abs(coverage(levels, LEVELS) - LEVELS)))


def rank_statistics(
    names: Sequence[str], truth: np.ndarray, drawn: np.ndarray, rng: np.random.Generator
) -> RankStatistics:
    """The ranks of N truths (N, n) among samples (N, S, n) each of n named coordinates; ties are broken at random."""
    below, equal = (np.sum(f(drawn, truth[:, None]), axis=1) for f in (np.less, np.equal))
    return RankStatistics(tuple(names), below + rng.integers(0, equal + 1), drawn.shape[1])


def _distance(places: np.ndarray) -> np.ndarray:
    """Kolmogorov's distance (n,) of N places (N, n) from the uniform distribution on 0 to 1."""
    ordered, steps = np.sort(places, axis=0), np.arange(len(places) + 1.0)[:, None] / len(places)
    return np.asarray(np.maximum(steps[1:] - ordered, ordered - steps[:-1]).max(axis=0))
