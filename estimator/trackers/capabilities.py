"""What a tracker may be able to do beside tracking. It says so itself, in one record: a tracker with an attribute
`capabilities` has those, one without has none and is a whole one all the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from estimator.data.observation import Observation
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import TrackerProtocol
from estimator.trackers.frame_result import FrameResult
from estimator.vision.cues.cue_picture import CuePicture
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class Capabilities:
    """Each is off as long as nothing else is said.

    energy: the search whose energy the hypotheses have, frame by frame: what `estimator.tracking.smoothing` ties
        together and what `explain` takes apart.
    needed_cues: without one of these cues of the pictures it can do nothing.
    frames_ahead, frames_behind: how many of the frames after and before it is shown, fewer at the ends of a clip:
        `init` then takes (rng, observation, following), `step` (rng, state, observation, following, before), the last
        only of a tracker that is shown such; tuples of observations in order, with their pictures' cues.
    seen_as: a frame as it was to the tracker, by its result, where it may have gone by more than was observed.
    pictures: its own, for an explanation of a frame observed with cues, by the number of the camera and in the pixels
        of its cues.
    """

    energy: ModeSearch | None = None
    needed_cues: tuple[str, ...] = ()
    frames_ahead: int = 0
    frames_behind: int = 0
    seen_as: Callable[[Observation, FrameResult], Observation] | None = None
    pictures: Callable[[Observation, FrameResult], Mapping[int, CuePicture]] | None = None


def capabilities_of(tracker: TrackerProtocol[Any]) -> Capabilities:
    """What a tracker is able to do beside tracking."""
    said: Capabilities = getattr(tracker, "capabilities", Capabilities())
    return said


def energy_of(tracker: TrackerProtocol[Any], name: str) -> ModeSearch:
    """The search whose energy the hypotheses of a tracker of some name have; raises InputError where they have none."""
    energy = capabilities_of(tracker).energy
    if energy is None:
        raise InputError("tracker", f"the hypotheses of {name} have no energy", remedy="choose another tracker")
    return energy
