"""Which bits of a description distinguish similar poses from others: thresholds learned from pairs (Shakhnarovich,
Viola, Darrell 2003, section 3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

LEAST_TRUE, LEAST_GAP = 0.65, 0.1  # of a bit that is kept; ELMO section 4
_AT_ONCE = 512  # features whose thresholds are tried together


@dataclass(frozen=True)
class Bits:
    """Bits h(x) = [x_feature >= threshold] of a description x; in the order of features.

    feature (M,) int32, rising. threshold (M,) uint16. true_rate, false_rate (M,) float64: shares of the similar and of
    the dissimilar pairs of the learning that have the same value.
    """

    feature: np.ndarray
    threshold: np.ndarray
    true_rate: np.ndarray
    false_rate: np.ndarray

    def __len__(self) -> int:
        return len(self.feature)

    def of(self, descriptions: np.ndarray) -> np.ndarray:
        """Values (N, M) bool for descriptions (N, D)."""
        return np.asarray(descriptions[:, self.feature] >= self.threshold)


def learned_bits(
    similar: tuple[np.ndarray, np.ndarray],
    dissimilar: tuple[np.ndarray, np.ndarray],
    least_true: float = LEAST_TRUE,
    least_gap: float = LEAST_GAP,
) -> Bits:
    """At most one bit of every feature: the threshold with the widest gap between the two rates among those at which
    similar pairs agree often enough.

    similar, dissimilar: the first and the second of each pair, (P, D) and (Q, D) uint16.

    Raises
    ------
    ValueError: no pair of one kind.
    """
    if not len(similar[0]) or not len(dissimilar[0]):
        raise ValueError(
            f"{len(similar[0])} similar and {len(dissimilar[0])} dissimilar pairs: some of both are needed"
        )
    parts = list(_best(similar, dissimilar, least_true))
    threshold, true_rate, false_rate = (np.concatenate(part) for part in zip(*parts, strict=True))
    kept = np.flatnonzero((true_rate >= least_true) & (true_rate - false_rate >= least_gap))
    return Bits(kept.astype(np.int32), threshold[kept].astype(np.uint16), true_rate[kept], false_rate[kept])


def _best(
    similar: tuple[np.ndarray, np.ndarray], dissimilar: tuple[np.ndarray, np.ndarray], least_true: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Threshold, and rates with it, of some features after others."""
    for first in range(0, similar[0].shape[1], _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        pairs = [(a[:, some], b[:, some]) for a, b in (similar, dissimilar)]
        most = max(int(x.max()) for pair in pairs for x in pair)
        true, false = (_agreement(*pair, most) for pair in pairs)
        gap = np.where(true >= least_true, true - false, -np.inf)
        best = gap.argmax(axis=1)  # the lowest of equals
        rows = np.arange(len(best))
        yield best, true[rows, best], false[rows, best]


def _agreement(a: np.ndarray, b: np.ndarray, most: int) -> np.ndarray:
    """Share (D, most + 1) of the pairs a, b (P, D) whose two values lie on one side of a threshold 0 ... most.

    A pair is parted by the thresholds above its lower value, up to the higher one.
    """
    count, features = a.shape
    column = np.arange(features) * (most + 2)
    low, high = np.minimum(a, b), np.maximum(a, b)
    begins = np.bincount((low + column + 1).ravel(), minlength=features * (most + 2))
    ends = np.bincount((high + column + 1).ravel(), minlength=features * (most + 2))
    parted = np.cumsum((begins - ends).reshape(features, most + 2), axis=1)[:, : most + 1]
    return np.asarray(1.0 - parted / count)
