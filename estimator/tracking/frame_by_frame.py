"""A tracker on its way through a clip, given one frame at a time: what runs and whoever tracks live have in common."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Generic, TypeVar

import numpy as np

from estimator.data.observation import Observation
from estimator.trackers.base import State, TrackerProtocol
from estimator.trackers.capabilities import capabilities_of
from estimator.trackers.frame_result import RESULT_FIELDS, FrameResult
from estimator.tracking.leaps import LastFrame, LeapCheck

S = TypeVar("S", bound=State)


class FrameByFrame(Generic[S]):
    """Takes the frames of a clip in order and returns the result of each as soon as the following frames that its
    tracker uses have arrived.

    Every frame has its own random generator made from the seed and the frame's index, so that a resumed run is the
    same as an uninterrupted one. Frames before the first that the tracker can start from are "unobserved" and have no
    hypotheses. A frame in which the root leapt is "hard", see `estimator.tracking.leaps`.

    Parameters
    ----------
    state: the tracker's after the last searched frame, None before the first. last: the reference for leaps from there.
        before: the frames before the first one to be tracked, at least as many as the tracker looks back.

    Attributes
    ----------
    state, last: as they are now.
    """

    def __init__(
        self,
        tracker: TrackerProtocol[S],
        seed: int,
        *,
        state: S | None = None,
        last: LastFrame | None = None,
        before: Iterable[Observation] = (),
    ) -> None:
        self.tracker, self.seed = tracker, seed
        self.state, self.last = state, last
        self._check = LeapCheck(tracker.body)
        self._can = capabilities_of(tracker)
        self._waiting: deque[Observation] = deque()
        self._before = deque(before, maxlen=self._can.frames_behind)

    def push(self, observation: Observation) -> FrameResult | None:
        """Take the next frame; the result of the one that now has all that follow it, None where there is none yet."""
        self._waiting.append(observation)
        return self._next() if len(self._waiting) > self._can.frames_ahead else None

    def rest(self) -> Iterator[FrameResult]:
        """The results that are still held back, at the end of a clip."""
        while self._waiting:
            yield self._next()

    def stored(self) -> dict[str, np.ndarray]:
        """State for a resumed run."""
        if self.state is None:
            return {}
        return self.state.arrays() | ({} if self.last is None else self.last.arrays())

    def _next(self) -> FrameResult:
        observation = self._waiting.popleft()
        result = self._searched(observation, tuple(self._waiting))
        self._before.append(observation)
        self.last = LastFrame.after(self.last, result)
        return result

    def _searched(self, observation: Observation, following: Sequence[Observation]) -> FrameResult:
        tracker: Any = self.tracker  # whose methods take the arguments that its capabilities declare
        result: FrameResult
        rng = np.random.default_rng((self.seed, observation.index))
        ahead = (following,) if self._can.frames_ahead or self._can.frames_behind else ()
        if self.state is None:
            if not tracker.can_start(observation):
                return _empty(observation, tracker.body.nq, tracker.body.nv)
            self.state, result = tracker.init(rng, observation, *ahead)
            return result
        behind = (tuple(self._before),) if self._can.frames_behind else ()
        self.state, result = tracker.step(rng, self.state, observation, *ahead, *behind)
        leapt = result.status == "tracked" and self._check.leapt_since(self.last, result)
        return replace(result, status="hard") if leapt else result


def _empty(observation: Observation, nq: int, nv: int) -> FrameResult:
    sizes = {"K": 0, "nq": nq, "nv": nv}
    arrays = {name: field.nothing(*(sizes[size] for size in field.shape)) for name, field in RESULT_FIELDS.items()}
    return FrameResult.of(observation.index, observation.time, "unobserved", arrays)
