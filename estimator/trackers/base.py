"""The interface of trackers: `init` makes a state, `step` takes it to the next frame. What else a tracker can do it
declares in one record, its attribute `capabilities`; without it, it has none, and is complete nevertheless.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from estimator.data.observation import Observation
from estimator.search.examples.person_seen import CUES, can_look_up
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import BY_INDEX
from estimator.trackers.frame_result import FrameResult
from estimator.vision.cues.cue_picture import CuePicture
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError


class State(Protocol):
    """State of a tracker between frames: all that the next frame needs, and only that. Each tracker has its own."""

    @property
    def time(self) -> float:
        """Time of its last frame, in seconds since the clip's start."""
        ...

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything as plain arrays (numbers, booleans, text), exact to the last bit; `TrackerProtocol.state_from` is
        the inverse. Names that begin with "last_" are the runner's."""
        ...


S = TypeVar("S", bound=State)


class TrackerProtocol(Protocol[S]):
    """The family of trackers. Equal random generators give equal tracks; a hard frame is flagged, never raised.

    body: what is tracked.
    needs_keypoints: whether `can_start` refuses every frame without keypoints, even with pictures. Such a tracker is
        not run on clips that have none.
    """

    body: Body

    @property
    def needs_keypoints(self) -> bool:
        """See above."""
        ...

    def can_start(self, observation: Observation) -> bool:
        """Whether tracking can start from a frame, with its image cues where these are used."""
        ...

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[S, FrameResult]:
        """First state, from a frame to start with and no manual pose."""
        ...

    def step(self, rng: np.random.Generator, state: S, observation: Observation) -> tuple[S, FrameResult]:
        """Carry the state to a later frame; one in which nothing is seen is "unobserved"."""
        ...

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> S:
        """The state with these `arrays`, which may include others, as stored by this version or an earlier one.

        Raises
        ------
        ValueError: an array is missing or has impossible values.
        """
        ...


@dataclass(frozen=True)
class Capabilities:
    """All are off by default.

    energy: the search whose energy the hypotheses have, for each frame. `estimator.tracking.smoothing` couples these
        energies, and `explain` splits them into terms.
    needed_cues: it needs at least one of these image cues.
    frames_ahead, frames_behind: how many frames after and before the current one it is given, fewer at the ends of a
        clip: `init` then takes (rng, observation, following), `step` (rng, state, observation, following, before), the
        last only if it uses earlier frames. Both are tuples of observations in order, with their image cues.
    seen_as: a frame as the tracker used it, given its result, where it may have used more than the observation.
    pictures: its own diagnostic images of a frame observed with cues, by camera number and in the pixels of the cues.
    """

    energy: ModeSearch | None = None
    needed_cues: tuple[str, ...] = ()
    frames_ahead: int = 0
    frames_behind: int = 0
    seen_as: Callable[[Observation, FrameResult], Observation] | None = None
    pictures: Callable[[Observation, FrameResult], Mapping[int, CuePicture]] | None = None


def capabilities_of(tracker: TrackerProtocol[Any]) -> Capabilities:
    """Optional capabilities of a tracker."""
    said: Capabilities = getattr(tracker, "capabilities", Capabilities())
    return said


def energy_of(tracker: TrackerProtocol[Any], name: str) -> ModeSearch:
    """The search whose energy the hypotheses of a tracker of some name have; raises InputError where they have none."""
    energy = capabilities_of(tracker).energy
    if energy is None:
        raise InputError("tracker", f"the hypotheses of {name} have no energy", remedy="choose another tracker")
    return energy


class Initialisation:
    """The initialisation of trackers that find their first pose by `estimator.search.first_pose.start_modes` (see
    `TrackerProtocol`): from keypoints, or from an index, depending on
    `ModeSearchSettings.start`."""

    search: ModeSearch

    @property
    def needs_keypoints(self) -> bool:
        """Whether it starts from keypoints."""
        return self.search.settings.start != BY_INDEX

    @property
    def capabilities(self) -> Capabilities:
        """The hypotheses have the energy of the search; without keypoints poses are looked up by cues."""
        return Capabilities(energy=self.search, needed_cues=() if self.needs_keypoints else CUES)

    def can_start(self, observation: Observation) -> bool:
        """Whether a frame has enough keypoints, or shows the person where poses are looked up."""
        if self.needs_keypoints:
            return observation.has_enough_points
        return can_look_up(observation, self.search.evidence)
