"""Figures over many runs: means with their errors, shares, differences of pairs."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from benchmarks.support.scores import FAR_MM, FAR_PX, TrackErrors

Key = TypeVar("Key", bound=Hashable)


class Spread(NamedTuple):
    """The mean of numbers that came in groups, such as the runs of several clips.

    mean. deviation: standard deviation of the numbers. error: standard error of the mean, that of independent numbers
    (deviation over the root of their count), or that of independent groups (the same of the groups' means) where it is
    larger: runs of one clip share its difficulties. Both NaN for a single number. numbers: how many.
    """

    mean: float
    deviation: float
    error: float
    numbers: int


def spread_of(values: Sequence[float], groups: Sequence[Hashable]) -> Spread:
    """The spread of values, groups[i] being that of values[i]; all NaN without any."""
    x = np.array(values, dtype=float)
    if not len(x):
        return Spread(float("nan"), float("nan"), float("nan"), 0)
    means = [float(x[[g == group for g in groups]].mean()) for group in dict.fromkeys(groups)]
    errors = [_error(x), _error(np.array(means))]
    known = [error for error in errors if np.isfinite(error)]
    return Spread(float(x.mean()), _deviation(x), max(known, default=float("nan")), len(x))


def _deviation(x: np.ndarray) -> float:
    return float(x.std(ddof=1)) if len(x) > 1 else float("nan")


def _error(x: np.ndarray) -> float:
    return _deviation(x) / float(np.sqrt(len(x)))


def paired(values: Mapping[Key, float], others: Mapping[Key, float], groups: Mapping[Key, Hashable]) -> Spread:
    """The mean of values minus others, over the runs that both have."""
    both = [key for key in values if key in others]
    return spread_of([values[key] - others[key] for key in both], [groups[key] for key in both])


class Gain(NamedTuple):
    """By how much the first of two is better, a lower number being so.

    share: in terms of the other's mean. difference: of the pairs, other minus ours.
    """

    share: float
    difference: Spread

    def shown(self, least: float) -> bool:
        """Whether it is at least this share and more than two standard errors."""
        return self.share >= least and self.difference.mean > 2.0 * self.difference.error

    def __str__(self) -> str:
        errors = self.difference.mean / self.difference.error if self.difference.error else float("inf")
        return f"lower by {self.share:.0%}, {errors:.1f} standard errors"


def gain(ours: Mapping[Key, float], theirs: Mapping[Key, float], groups: Mapping[Key, Hashable]) -> Gain:
    """The gain of ours over theirs, over the runs that both have."""
    both = [key for key in ours if key in theirs]
    other = float(np.mean([theirs[key] for key in both])) if both else float("nan")
    difference = paired(theirs, ours, groups)
    return Gain(difference.mean / other if other else float("nan"), difference)


class TrackStatistics(NamedTuple):
    """Trajectories of several runs by one criterion.

    error: mean errors [mm]. lost, runs: runs with a lost frame, and all. lost_at: of the lost ones the median of the
    first lost frame, NaN without any. of_limits, worst_of_limits: mean and largest over the runs of the largest error
    in terms of its limit; the mean is of the runs that have a pose in every frame. doubled: runs lost if the limit in
    the image were twice as wide, at 640 x 480.
    """

    error: Spread
    lost: int
    runs: int
    lost_at: float
    of_limits: float
    worst_of_limits: float
    doubled: int

    @property
    def mean_and_error(self) -> str:
        """The mean with its deviation, in millimetres."""
        e = self.error
        if not np.isfinite(e.error):
            return f"{e.mean:.1f}"
        return f"{e.mean:.1f} ± {e.error:.1f} ({e.deviation:.1f})"

    @property
    def how_near(self) -> str:
        """To the limits, in per cent."""
        return f"{self.of_limits:.0%}, {self.worst_of_limits:.0%}"


def track_statistics(
    errors: Sequence[TrackErrors], groups: Sequence[Hashable], measure: str = "mean"
) -> TrackStatistics:
    """Trajectories of runs, groups[i] being that of errors[i]; measure: which field is the error."""
    lost = [e.lost for e in errors if e.lost is not None]
    near = np.array([e.of_limits for e in errors], dtype=float)
    known = near[np.isfinite(near)]
    return TrackStatistics(
        error=spread_of([getattr(e, measure) for e in errors], groups),
        lost=len(lost),
        runs=len(errors),
        lost_at=float(np.median(lost)) if lost else float("nan"),
        of_limits=float(known.mean()) if len(known) else float("inf"),
        worst_of_limits=float(near.max(initial=0.0)),
        doubled=sum(not (e.worst <= FAR_MM and e.pixels <= 2.0 * FAR_PX) for e in errors),
    )
