"""The interface of trackers: `init` makes a state, `step` takes it to the next frame.

Optional capabilities are in `estimator.trackers.capabilities`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, TypeVar

import numpy as np

from estimator.data.observation import Observation
from estimator.trackers.frame_result import FrameResult
from humanoid.kinematics.body import Body


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
