"""Steps as the tracker leaves them, or smoothed some frames later."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from estimator.data.observation import Observation
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing import FixedLag
from humanoid.kinematics.body import Body
from kinemode.streams.step import Step


class Delay:
    """Gives every frame back in order, `lag` frames later and smoothed where there is a smoother.

    A frame without hypotheses, which a smoother leaves out, comes in its turn, as it is.
    """

    def __init__(self, body: Body, smoother: FixedLag | None, lag: int) -> None:
        self._body, self._smoother, self._lag = body, smoother, lag
        self._waiting: deque[FrameResult] = deque()
        self._smoothed: dict[int, np.ndarray] = {}

    def push(self, observation: Observation, result: FrameResult) -> Step | None:
        """Take a frame, with its pictures' cues; the one whose turn it is, None where there is none yet."""
        self._waiting.append(result)
        if self._smoother is not None:
            self._smoothed.update(self._smoother.push(observation, result))
        return self._give() if len(self._waiting) > self._lag and self._ready() else None

    def rest(self) -> Iterator[Step]:
        """The frames that are still held back."""
        if self._smoother is not None:
            self._smoothed.update(self._smoother.flush())
        while self._waiting:
            yield self._give()

    def _ready(self) -> bool:
        first = self._waiting[0]
        return self._smoother is None or not len(first.weight) or first.index in self._smoothed

    def _give(self) -> Step:
        result = self._waiting.popleft()
        return Step.of(self._body, result, self._smoothed.pop(result.index, None))
