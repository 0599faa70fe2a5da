"""Which frames are enough: to begin by keypoints, and to be searched."""

from __future__ import annotations

from estimator.imaging.observation import Observation

MIN_KEYPOINTS = 4  # fewer say nothing worth a search


def enough_keypoints(observation: Observation) -> bool:
    """Whether a frame has enough keypoints for a pose."""
    return observation.count >= MIN_KEYPOINTS


def observable(observation: Observation) -> bool:
    """Whether a frame has enough to be searched from a pose that is known: keypoints, or pictures."""
    return enough_keypoints(observation) or bool(observation.cues)


class BeginsByKeypoints:
    """The beginning of trackers that find their first pose from keypoints (see `estimator.trackers.base.Tracker`)."""

    needs_keypoints = True

    def can_start(self, observation: Observation) -> bool:
        """Whether a frame has enough keypoints."""
        return enough_keypoints(observation)
