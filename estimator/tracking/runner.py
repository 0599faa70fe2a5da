"""Runs a tracker over observations, frame by frame, into a run file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from estimator.data.observation import Observation
from estimator.data.sequence import Cues, Progress
from estimator.trackers.base import State, TrackerProtocol
from estimator.trackers.capabilities import capabilities_of
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.frame_by_frame import FrameByFrame
from estimator.tracking.leaps import LastFrame
from humanoid.support.errors import InputError

S = TypeVar("S", bound=State)


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
    the frames that follow. How a frame is treated: `estimator.tracking.frame_by_frame.FrameByFrame`.
    """
    frames = FrameByFrame(tracker, seed, state=state, last=last, before=_before(tracker, observations[:first], cues))
    for result in _results(frames, observations[first:], cues):
        yield result, frames.state


def _results(frames: FrameByFrame[S], observations: Iterable[Observation], cues: Cues | None) -> Iterator[FrameResult]:
    """Each as soon as it is available; the pictures of each frame are read once, in order."""
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
    progress: Progress | None = None,
) -> None:
    """`run`, each frame stored as soon as it is done; `progress` is called with the number of finished frames and of
    all."""
    frames = FrameByFrame(tracker, seed, state=state, last=last, before=_before(tracker, observations[:first], cues))
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
