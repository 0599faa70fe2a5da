"""Lags of several cameras that suit all pairs of them best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Lags:
    """Misfit at each lag of P pairs of cameras a, b (P,): table (P, 2 most + 1), by the lag of b after a in instants,
    from -most to most."""

    a: np.ndarray
    b: np.ndarray
    table: np.ndarray
    most: int

    def of(self, lags: np.ndarray) -> float:
        """Mean of the table for cameras delayed by lags (C,) in instants."""
        apart = np.clip(lags[self.b] - lags[self.a], -self.most, self.most)
        return float(self.table[np.arange(len(self.a)), apart + self.most].mean())

    def best(self, count: int, still: Sequence[int] = ()) -> np.ndarray:
        """Lags (C,) of `count` cameras with the least mean: downhill, one camera after the other, from no lags and from
        the best lags that each camera alone has of the others. Cameras in `still` keep a lag of 0."""
        starts = [np.zeros(count, dtype=np.int64)]
        for c in still or range(count):
            own = self.table.argmin(axis=1) - self.most
            lags = np.zeros(count, dtype=np.int64)
            lags[self.b[self.a == c]] = own[self.a == c]
            lags[self.a[self.b == c]] = -own[self.b == c]
            lags[list(still)] = 0
            starts.append(lags)
        return min((self._downhill(lags, still) for lags in starts), key=self.of)

    def _downhill(self, lags: np.ndarray, still: Sequence[int]) -> np.ndarray:
        tried = np.arange(-self.most, self.most + 1)
        before = np.inf
        while self.of(lags) < before:
            before = self.of(lags)
            for c in range(len(lags)):
                if c in still:
                    continue
                options = np.repeat(lags[None], len(tried), axis=0)
                options[:, c] = tried
                lags = min((lags, *options), key=self.of)
        return lags
