"""Which frames a track can begin with: by keypoints, or by an index of examples."""

from __future__ import annotations

from estimator.data.observation import Observation
from estimator.search.examples.person_seen import CUES, can_look_up
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import BY_INDEX
from estimator.trackers.capabilities import Capabilities


class Initialisation:
    """The initialisation of trackers that find their first pose by `estimator.search.first_pose.start_modes` (see
    `estimator.trackers.base.TrackerProtocol`): from keypoints, or from an index, depending on
    `ModeSearchSettings.start`."""

    search: ModeSearch

    @property
    def needs_keypoints(self) -> bool:
        """Whether it begins by keypoints."""
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
