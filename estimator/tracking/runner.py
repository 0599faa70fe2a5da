"""Runs a tracker over observations, frame by frame, into a run file."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from estimator.imaging.observation import Observation
from estimator.sequences.source import Cues, Progress
from estimator.trackers.base import State, Tracker
from estimator.trackers.capabilities import LooksAhead, frames_ahead
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.leaps import LastFrame, LeapCheck
from humanoid.support.errors import InputError

S = TypeVar("S", bound=State)


class Writer(Protocol):
    """Where results go, each with the exact state after it (see `estimator.results.run_file.RunWriter`)."""

    def append(self, result: FrameResult, state: Mapping[str, np.ndarray]) -> None:
        """Store one frame."""
        ...


def run(
    tracker: Tracker[S],
    observations: Sequence[Observation],
    seed: int,
    *,
    state: S | None = None,
    first: int = 0,
    cues: Cues | None = None,
    last: LastFrame | None = None,
) -> Iterator[tuple[FrameResult, S | None]]:
    """Results and states of the observations from `first` on; `state` is the one after the frame before, `last` what
    tells leaps from there.

    `cues` gives what the pictures of a frame show; without it keypoints alone are looked at. A tracker that looks ahead
    is given the frames that follow, too.

    Every frame has its own random generator made from the seed and the frame's index, so that a resumed run is the
    same as an uninterrupted one. Frames before the first that the tracker can start from are "unobserved" and have no
    hypotheses. A frame in which the root leapt is "hard", see `estimator.tracking.leaps`.
    """
    for result, after, _ in _frames(tracker, observations, seed, state, first, cues, last):
        yield result, after


def _frames(
    tracker: Tracker[S],
    observations: Sequence[Observation],
    seed: int,
    state: S | None,
    first: int,
    cues: Cues | None,
    last: LastFrame | None,
) -> Iterator[tuple[FrameResult, S | None, LastFrame | None]]:
    """`run`, with what tells leaps from each frame on."""
    check = LeapCheck(tracker.body)
    for observation, following in _with_following(observations[first:], cues, frames_ahead(tracker)):
        rng = np.random.default_rng((seed, observation.index))
        if state is not None:
            if isinstance(tracker, LooksAhead):
                state, result = tracker.step(rng, state, observation, following)
            else:
                state, result = tracker.step(rng, state, observation)
            if result.status == "tracked" and check.leapt_since(last, result):
                result = replace(result, status="hard")
        elif tracker.can_start(observation):
            state, result = tracker.init(rng, observation)
        else:
            result = _empty(observation, tracker.body.nq, tracker.body.nv)
        last = LastFrame.after(last, result)
        yield result, state, last


def _with_following(
    observations: Sequence[Observation], cues: Cues | None, ahead: int
) -> Iterator[tuple[Observation, tuple[Observation, ...]]]:
    """Every frame with those that follow it, `ahead` at most; the pictures of each are read once, in order."""
    seen = (o if cues is None else replace(o, cues=cues.at(o.index)) for o in observations)
    waiting = deque(islice(seen, ahead))
    for newest in seen:
        waiting.append(newest)
        yield waiting.popleft(), tuple(waiting)
    while waiting:
        yield waiting.popleft(), tuple(waiting)


def run_into(
    writer: Writer,
    tracker: Tracker[S],
    observations: Sequence[Observation],
    seed: int,
    *,
    state: S | None = None,
    first: int = 0,
    cues: Cues | None = None,
    last: LastFrame | None = None,
    progress: Progress | None = None,
) -> None:
    """`run`, each frame stored as soon as it is done; `progress` is told how many of how many are."""
    done = first
    for result, after, told in _frames(tracker, observations, seed, state, first, cues, last):
        writer.append(result, _stored(after, told))
        done += 1
        if progress is not None:
            progress(done, len(observations))


def _stored(state: State | None, last: LastFrame | None) -> dict[str, np.ndarray]:
    """What a resumed run needs."""
    if state is None:
        return {}
    return state.arrays() | ({} if last is None else last.arrays())


def stored_state(
    tracker: Tracker[S], arrays: Mapping[str, np.ndarray] | None, source: Path
) -> tuple[S | None, LastFrame | None]:
    """State, and what tells leaps, from the arrays that `run_into` stored after a frame; None before the first state.

    Raises
    ------
    InputError: they cannot be of this tracker.
    """
    if not arrays:
        return None, None
    try:
        return tracker.state_from(arrays), LastFrame.from_arrays(arrays, tracker.body)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        problem = f"{error.args[0]} is missing" if isinstance(error, KeyError) else error
        raise InputError(source, f"is damaged: {problem}", place="state", remedy="--overwrite starts anew") from None


def _empty(observation: Observation, nq: int, nv: int) -> FrameResult:
    none = np.zeros(0)
    return FrameResult(
        index=observation.index,
        time=observation.time,
        status="unobserved",
        q=np.zeros((0, nq)),
        weight=none,
        energy=none,
        covariance=np.zeros((0, nv, nv)),
        parent=np.zeros(0, dtype=np.int64),
        kkt_residual=none,
        penetration=none,
        association=(),
    )
