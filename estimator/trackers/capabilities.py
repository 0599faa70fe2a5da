"""What a tracker may be able to do beside tracking. The runner, smoothing, `explain` and the front door ask for it by
`isinstance`; a tracker that has none of it is a whole one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from estimator.data.observation import Observation
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import State, TrackerProtocol
from estimator.trackers.frame_result import FrameResult
from estimator.vision.cues.cue_picture import CuePicture
from humanoid.support.errors import InputError

S = TypeVar("S", bound=State)


@runtime_checkable
class SupportsSmoothing(Protocol):
    """Its hypotheses have the energy of a mode search, frame by frame: what `estimator.tracking.smoothing` ties
    together and what `explain` takes apart."""

    @property
    def search(self) -> ModeSearch:
        """The search over its body."""
        ...


@runtime_checkable
class Parallel(Protocol):
    """Several processes can share the work on a frame."""

    def shared(self, processes: int) -> AbstractContextManager[None]:
        """Within it so many processes do, this one among them; what comes out is the same to the last bit.

        Raises
        ------
        InputError: a number of processes that cannot be; later, that one of them has ended by itself.
        """
        ...


@runtime_checkable
class RequiresCues(Protocol):
    """May be able to do nothing without the pictures' cues. needed_cues: the names of those of which one is enough,
    none where it needs none."""

    @property
    def needed_cues(self) -> tuple[str, ...]:
        """See above."""
        ...


@runtime_checkable
class SeesOtherwise(Protocol):
    """May have gone by more than what was observed, and says so in its results."""

    def seen_as(self, observation: Observation, result: FrameResult) -> Observation:
        """The frame as it was to the tracker."""
        ...


@runtime_checkable
class HasDiagnosticImages(Protocol):
    """Has pictures of its own for an explanation of a frame."""

    def pictures(self, observation: Observation, result: FrameResult) -> Mapping[int, CuePicture]:
        """By the number of the camera, in the pixels of its cues; observation: with cues. result: the frame's."""
        ...


@runtime_checkable
class UsesLookahead(Protocol[S]):
    """Is shown the frames that follow. frames_ahead: how many, fewer at the end of the clip."""

    frames_ahead: int

    def init(
        self, rng: np.random.Generator, observation: Observation, following: Sequence[Observation] = ()
    ) -> tuple[S, FrameResult]:
        """As `TrackerProtocol.init`; following: the next frames in order, with their pictures' cues."""
        ...

    def step(
        self,
        rng: np.random.Generator,
        state: S,
        observation: Observation,
        following: Sequence[Observation] = (),
    ) -> tuple[S, FrameResult]:
        """As `TrackerProtocol.step`; following: see `init`."""
        ...


@runtime_checkable
class UsesLookback(UsesLookahead[S], Protocol[S]):
    """Is shown the frames before, too. frames_behind: how many, fewer at the beginning of a clip."""

    @property
    def frames_behind(self) -> int:
        """See the class."""
        ...

    def step(
        self,
        rng: np.random.Generator,
        state: S,
        observation: Observation,
        following: Sequence[Observation] = (),
        before: Sequence[Observation] = (),
    ) -> tuple[S, FrameResult]:
        """As `UsesLookahead.step`; before: the last frames in order, with their pictures' cues."""
        ...


def energy_of(tracker: TrackerProtocol[Any], name: str) -> ModeSearch:
    """The search whose energy the hypotheses of a tracker of some name have; raises InputError where they have none."""
    if not isinstance(tracker, SupportsSmoothing):
        raise InputError("tracker", f"the hypotheses of {name} have no energy", remedy="choose another tracker")
    return tracker.search


def frames_ahead(tracker: TrackerProtocol[Any]) -> int:
    """How many of the following frames a tracker is shown."""
    return tracker.frames_ahead if isinstance(tracker, UsesLookahead) else 0


def frames_behind(tracker: TrackerProtocol[Any]) -> int:
    """How many of the frames before a tracker is shown."""
    return tracker.frames_behind if isinstance(tracker, UsesLookback) else 0


def sharing(tracker: TrackerProtocol[Any], processes: int) -> AbstractContextManager[None]:
    """Within it so many processes share a tracker's work; one is this process alone.

    Raises
    ------
    InputError: several, of a tracker that works in one; and as `Parallel.shared`.
    """
    if isinstance(tracker, Parallel):
        return tracker.shared(processes)
    if processes != 1:
        raise InputError("workers", "this tracker works in one process", remedy="leave it out")
    return nullcontext()
