"""Even pieces of a clip, in each of which a clock is compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_PIECES, _SHORTEST, _LONGEST = 16, 1.0, 4.0  # pieces of a clip as a rule, and how long they are [s]
_FEWEST, _MOST = 5, 32
_INSTANTS = 960  # that are compared in all


@dataclass(frozen=True)
class ClipPieces:
    """Pieces of a clip: the middle of each (K,) and how long they are [s]."""

    middles: np.ndarray
    length: float

    @staticmethod
    def of(times: np.ndarray) -> ClipPieces | None:
        """The pieces of a camera's times (N,) [s], None for a clip that is too short."""
        span = float(times[-1] - times[0])
        length = float(np.clip(span / _PIECES, _SHORTEST, _LONGEST))
        count = min(_MOST, int(span / length + 1e-6))
        if count < _FEWEST:
            return None
        return ClipPieces(times[0] + (np.arange(count) + 0.5) * span / count, min(length, span / count))

    @property
    def centre(self) -> float:
        """The middle of all pieces [s]."""
        return float(self.middles.mean())

    @property
    def offsets(self) -> np.ndarray:
        """The middles beside that of all pieces (K,) [s]."""
        return np.asarray(self.middles - self.centre)

    def instants(self, start: float, step: float, count: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Instants of a grid of `count` from `start`: some that lie in pieces (I,), whose piece each is (I,), and the
        time that each stands for [s]."""
        stride = max(1, int(self.length / step * len(self.middles) / _INSTANTS))
        i = np.arange(0, count, stride)
        at = start + i * step
        piece = np.abs(at[:, None] - self.middles).argmin(axis=1)
        inside = np.abs(at - self.middles[piece]) <= 0.5 * self.length
        return i[inside], piece[inside], stride * step
