"""A tracker on its way through a clip: frame by frame as a live track, or over observations into a run file."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from estimator.data.observation import Observation
from estimator.data.sequence import Cues, Progress
from estimator.trackers.base import State, TrackerProtocol, capabilities_of
from estimator.trackers.frame_result import RESULT_FIELDS, FrameResult
from estimator.tracking.leaps import LastFrame, LeapCheck
from estimator.tracking.learning import Learning
from estimator.vision.cues.learned import with_learned
from humanoid.support.errors import InputError

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
    learning: what the image cues have learned until there, None for nothing yet.

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
        learning: Learning | None = None,
    ) -> None:
        self.tracker, self.seed = tracker, seed
        self.state, self.last = state, last
        self._check = LeapCheck(tracker.body)
        self._can = capabilities_of(tracker)
        self._learning = learning or Learning(self._can.energy)
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
        return self.state.arrays() | ({} if self.last is None else self.last.arrays()) | self._learning.arrays()

    def _next(self) -> FrameResult:
        known = self._learning.extra
        as_read = self._waiting.popleft()
        observation = with_learned(as_read, known)
        result = self._searched(observation, tuple(self._waiting))
        if known:
            result = replace(result, extra={**result.extra, **known})
        self._learning.learn(observation, result)
        self._before.append(as_read)
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


class Writer(Protocol):
    """Receiver of results, each with the exact state after it (see `estimator.runs.run_file.RunWriter`)."""

    def append(self, result: FrameResult, state: Mapping[str, np.ndarray]) -> None:
        """Store one frame."""
        ...


def run(
    tracker: TrackerProtocol[S],
    observations: Sequence[Observation],
    seed: int,
    *,
    state: S | None = None,
    first: int = 0,
    cues: Cues | None = None,
    last: LastFrame | None = None,
) -> Iterator[tuple[FrameResult, S | None]]:
    """Results and states of the observations from `first` on; `state` is the one after the frame before, `last` the
    reference for leaps from there.

    `cues` reads the image cues of a frame; without it only keypoints are used. A tracker that looks ahead is also given
    the frames that follow. How a frame is treated: `estimator.tracking.runner.FrameByFrame`.
    """
    frames = FrameByFrame(tracker, seed, state=state, last=last, before=_before(tracker, observations[:first], cues))
    for result in _results(frames, observations[first:], cues):
        yield result, frames.state


def _results(frames: FrameByFrame[S], observations: Iterable[Observation], cues: Cues | None) -> Iterator[FrameResult]:
    """Results as soon as they are available; the pictures of each frame are read once, in order."""
    for observation in observations:
        result = frames.push(_seen(observation, cues))
        if result is not None:
            yield result
    yield from frames.rest()


def _before(tracker: TrackerProtocol[S], done: Sequence[Observation], cues: Cues | None) -> list[Observation]:
    """The finished frames that the tracker looks back at."""
    behind = capabilities_of(tracker).frames_behind
    return [_seen(observation, cues) for observation in done[max(0, len(done) - behind) :]]


def _seen(observation: Observation, cues: Cues | None) -> Observation:
    return observation if cues is None else replace(observation, cues=cues.at(observation.index))


def run_into(
    writer: Writer,
    tracker: TrackerProtocol[S],
    observations: Sequence[Observation],
    seed: int,
    *,
    state: S | None = None,
    first: int = 0,
    cues: Cues | None = None,
    last: LastFrame | None = None,
    learning: Learning | None = None,
    progress: Progress | None = None,
) -> None:
    """`run`, each frame stored as soon as it is done; `progress` is called with the number of finished frames and of
    all. learning: what the image cues have learned until `first`."""
    before = _before(tracker, observations[:first], cues)
    frames = FrameByFrame(tracker, seed, state=state, last=last, before=before, learning=learning)
    for done, result in enumerate(_results(frames, observations[first:], cues), first + 1):
        writer.append(result, frames.stored())
        if progress is not None:
            progress(done, len(observations))


def stored_state(
    tracker: TrackerProtocol[S], arrays: Mapping[str, np.ndarray] | None, source: Path
) -> tuple[S | None, LastFrame | None]:
    """State, and the reference for leaps, from the arrays that `run_into` stored after a frame; None before the first
    state.

    Raises
    ------
    InputError: they are not those of this tracker.
    """
    if not arrays:
        return None, None
    try:
        return tracker.state_from(arrays), LastFrame.from_arrays(arrays, tracker.body)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        problem = f"{error.args[0]} is missing" if isinstance(error, KeyError) else error
        raise InputError(source, f"is damaged: {problem}", place="state", remedy="--overwrite starts again") from None
