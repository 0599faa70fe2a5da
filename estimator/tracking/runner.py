"""Runs a tracker over observations, frame by frame, into a run file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from estimator.imaging.observation import Observation
from estimator.sequences.source import Cues, Progress
from estimator.trackers.base import Tracker, TrackState, startable
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.leaps import LeapCheck


class Writer(Protocol):
    """Where results go, each with the exact state after it (see `estimator.results.run_file.RunWriter`)."""

    def append(self, result: FrameResult, state: Mapping[str, np.ndarray]) -> None:
        """Store one frame."""
        ...


def run(
    tracker: Tracker,
    observations: Sequence[Observation],
    seed: int,
    *,
    state: TrackState | None = None,
    first: int = 0,
    cues: Cues | None = None,
) -> Iterator[tuple[FrameResult, TrackState | None]]:
    """Results and states of the observations from `first` on; `state` is the one after the frame before.

    `cues` gives what the pictures of a frame show; without it keypoints alone are looked at.

    Every frame has its own random generator made from the seed and the frame's index, so that a resumed run is the
    same as an uninterrupted one. Frames before the first usable one are "unobserved" and have no hypotheses. A frame in
    which the root leapt is "hard", see `estimator.tracking.leaps`.
    """
    check = LeapCheck(tracker.body)
    for observation in observations[first:]:
        if cues is not None:
            observation = replace(observation, cues=cues.at(observation.index))
        rng = np.random.default_rng((seed, observation.index))
        if state is not None:
            before = state
            state, result = tracker.step(rng, before, observation)
            if result.status == "tracked" and _leapt(check, before, result):
                result = replace(result, status="hard")
        elif startable(observation):
            state, result = tracker.init(rng, observation)
        else:
            result = _empty(observation, tracker.body.nq, tracker.body.nv)
        yield result, state


def _leapt(check: LeapCheck, before: TrackState, result: FrameResult) -> bool:
    modes = before.mixture.modes
    q, covariance = np.array([m.q for m in modes]), np.array([m.covariance for m in modes])
    return check.leapt(q, covariance, result.q[0], result.covariance[0], result.time - before.time + before.unobserved)


def run_into(
    writer: Writer,
    tracker: Tracker,
    observations: Sequence[Observation],
    seed: int,
    *,
    state: TrackState | None = None,
    first: int = 0,
    cues: Cues | None = None,
    progress: Progress | None = None,
) -> None:
    """`run`, each frame stored as soon as it is done; `progress` is told how many of how many are."""
    done = first
    for result, after in run(tracker, observations, seed, state=state, first=first, cues=cues):
        writer.append(result, {} if after is None else after.arrays())
        done += 1
        if progress is not None:
            progress(done, len(observations))


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
