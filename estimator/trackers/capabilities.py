"""Optional capabilities of a tracker. It declares them in one record, its attribute `capabilities`. A tracker without
that attribute has none, and is complete all the same."""

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
