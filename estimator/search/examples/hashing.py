"""Parameter-sensitive hashing: the examples that look like a picture, from the buckets that it falls into
(Shakhnarovich, Viola, Darrell 2003, section 3.2; Gionis, Indyk, Motwani 1999), by bits that distinguish similar poses
from others (section 3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from humanoid.support.compiled import jit

TABLES, KEY_BITS = 50, 18  # ELMO section 4
_AT_ONCE = 1024  # examples whose bits are unpacked together


class Neighbours(NamedTuple):
    """Numbers of the examples (K,) int64, the nearest first, and in how many bits they differ (K,) int64.

    comparisons: with how many the picture was compared. fell_back: all, because too few shared a bucket with it.
    """

    numbers: np.ndarray
    distance: np.ndarray
    comparisons: int
    fell_back: bool


def random_keys(bits: int, rng: np.random.Generator, tables: int = TABLES, key_bits: int = KEY_BITS) -> np.ndarray:
    """Random choice of the bits in the keys of each table, (tables, key_bits) int64.

    Raises
    ------
    ValueError: there are fewer bits than a key has.
    """
    if bits < key_bits:
        raise ValueError(f"there are {bits} bits: keys of {key_bits} need as many")
    return np.array([rng.choice(bits, key_bits, replace=False) for _ in range(tables)])


class HashTables:
    """Examples, N, in buckets: each table sorts them by a key of some of their bits.

    codes (N, W) uint64: their bits, see `packed`. chosen (tables, key_bits): see `random_keys`.

    Raises
    ------
    ValueError: there are no examples.
    """

    def __init__(self, codes: np.ndarray, chosen: np.ndarray) -> None:
        if not len(codes):
            raise ValueError("there are no examples")
        self.codes, self.chosen = codes, chosen
        parts = range(0, len(codes), _AT_ONCE)
        keys = np.concatenate([self._keys(unpacked(codes[k : k + _AT_ONCE])) for k in parts], axis=1)
        self._order = np.argsort(keys, axis=1, kind="stable").astype(np.int32)
        self._sorted = np.take_along_axis(keys, self._order, axis=1)

    def __len__(self) -> int:
        return len(self.codes)

    def nearest(self, value: np.ndarray, count: int) -> Neighbours:
        """The `count` examples that differ least from value (M,) bool among those in one of its buckets, or among all
        if there are fewer; the first among equals. At most as many as there are examples."""
        code, keys = packed(value[None])[0], self._keys(value[None])[:, 0]
        shares = np.zeros(len(self), bool)
        _mark(self._sorted, self._order, keys, shares)
        candidates = np.flatnonzero(shares)
        if len(candidates) < min(count, len(self)):
            return self.nearest_of_all(value, count)._replace(fell_back=True)
        return self._nearest_among(candidates, code, count)

    def nearest_of_all(self, value: np.ndarray, count: int) -> Neighbours:
        """The `count` examples that differ least from value (M,) bool, compared with every one; of equals the first."""
        return self._nearest_among(np.arange(len(self)), packed(value[None])[0], count)

    def _nearest_among(self, candidates: np.ndarray, code: np.ndarray, count: int) -> Neighbours:
        distance = self._differences(code, candidates)
        rank = distance * len(self) + candidates  # no two are equal
        if count < len(rank):
            order = np.argpartition(rank, count)[:count]
            order = order[np.argsort(rank[order])]
        else:
            order = np.argsort(rank)
        return Neighbours(candidates[order], distance[order], len(candidates), False)

    def distances(self, value: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """In how many bits some examples (K,) int64 differ from value (M,) bool, (K,) int64."""
        return self._differences(packed(value[None])[0], numbers)

    def _differences(self, code: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        distance = np.empty(len(numbers), np.int64)
        _differing(self.codes, code, numbers, distance)
        return distance

    def _keys(self, values: np.ndarray) -> np.ndarray:
        """Keys (tables, N) of values (N, M)."""
        weight = 1 << np.arange(self.chosen.shape[1], dtype=np.int64)
        return np.ascontiguousarray((values[:, self.chosen] @ weight).T)


def packed(values: np.ndarray) -> np.ndarray:
    """Bits (N, M) bool in words (N, ceil(M / 64)) uint64, filled up with zeros."""
    count, bits = values.shape
    padded = np.zeros((count, -(-bits // 64) * 64), bool)
    padded[:, :bits] = values
    return np.packbits(padded, axis=1).view(np.uint64)


def unpacked(codes: np.ndarray) -> np.ndarray:
    """The bits (N, 64 W) bool of codes (N, W), those that filled them up included."""
    return np.unpackbits(np.ascontiguousarray(codes).view(np.uint8), axis=1).astype(bool)


@jit
def _mark(ordered, order, keys, shares):  # type: ignore[no-untyped-def]
    """Set shares (N,) bool where an example's key is that of keys (tables,) in some table: ordered (tables, N) are its
    keys in order, order (tables, N) the examples that have them."""
    for t in range(keys.shape[0]):
        low, high = 0, ordered.shape[1]
        while low < high:
            middle = (low + high) // 2
            if ordered[t, middle] < keys[t]:
                low = middle + 1
            else:
                high = middle
        while low < ordered.shape[1] and ordered[t, low] == keys[t]:
            shares[order[t, low]] = True
            low += 1


@jit
def _differing(codes, code, candidates, distance):  # type: ignore[no-untyped-def]
    """Fill distance (C,): bits in which codes (N, W) of the candidates (C,) differ from code (W,), words of 64 bits.

    Three times as fast as numpy's `bitwise_count`, which needs a copy of all that is compared.
    """
    for c in range(candidates.shape[0]):
        differing = np.uint64(0)
        for w in range(codes.shape[1]):
            x = codes[candidates[c], w] ^ code[w]
            x -= (x >> np.uint64(1)) & np.uint64(0x5555555555555555)
            x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
            x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
            differing += (x * np.uint64(0x0101010101010101)) >> np.uint64(56)
        distance[c] = differing


LEAST_TRUE, LEAST_GAP = 0.65, 0.1  # of a bit that is kept; ELMO section 4
_PAIRS_AT_ONCE = 512  # features whose thresholds are tried together


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
    for first in range(0, similar[0].shape[1], _PAIRS_AT_ONCE):
        some = slice(first, first + _PAIRS_AT_ONCE)
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
