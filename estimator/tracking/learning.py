"""What image cues learn from frame to frame, such as the colours of limbs, passed on beside the tracker's state.

It is learned of each frame by its likeliest mode. What a frame was compared with is stored with its result, so that the
smoother and explanations of a run use the same. Frames that a tracker is given before or after the current one are as
they were read.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import TrackerProtocol, capabilities_of
from estimator.trackers.frame_result import TRACKED, FrameResult
from estimator.vision.cues.learned import LEARNED
from estimator.vision.cues.settings import CUES
from humanoid.support.errors import InputError

_STORED, _TIME = f"last_{LEARNED}", "last_time_learned"  # names of the runner begin with "last_"


class Learning:
    """What the cues of a track have learned so far, by the name of a cue an array (C, ...) with a row for each camera.

    search: has the image likelihoods of frames. Without it nothing is learned. stored: arrays that include those of
    `arrays`.

    Raises
    ------
    ValueError: a stored array is not one of these.
    """

    def __init__(self, search: ModeSearch | None, stored: Mapping[str, np.ndarray] | None = None) -> None:
        self._search = search
        stored = stored or {}
        self._time = float(stored.get(_TIME, 0.0))
        self._learned = {n.removeprefix(_STORED): array for n, array in stored.items() if n.startswith(_STORED)}
        for name, array in self._learned.items():
            if array.dtype.kind != "f" or array.ndim < 2 or not np.isfinite(array).all():
                raise ValueError(f"what {name} learned has the shape {array.shape} and type {array.dtype}")

    @property
    def extra(self) -> dict[str, np.ndarray]:
        """What was learned, as extra arrays of the next frame's result."""
        return {LEARNED + name: array for name, array in self._learned.items()}

    def arrays(self) -> dict[str, np.ndarray]:
        """What was learned, to be stored with the tracker's state, exact to the last bit."""
        if not self._learned:
            return {}
        return {_TIME: np.array(self._time), **{_STORED + name: array for name, array in self._learned.items()}}

    def learn(self, observation: Observation, result: FrameResult) -> None:
        """Learn of a frame by its likeliest mode, unless it is flagged. observation: as the tracker used it."""
        if self._search is None or result.status != TRACKED or not len(result.q):
            return
        names = _learning(observation)
        if not names:
            return
        elapsed, weight = max(0.0, result.time - self._time), float(result.weight[0])
        posed, cameras = self._search.body.at(result.q[0]), self._search.likelihood(observation, result.q[0]).cameras
        views = [camera.predictor.predict(posed) for camera in cameras]
        for name in names:
            pairs = zip(cameras, views, strict=True)
            learned = [camera.matchers[name].learn(view, elapsed, weight) for camera, view in pairs]
            arrays = [array for array in learned if array is not None]
            if len(arrays) == len(cameras):
                self._learned[name] = np.stack(arrays)
        self._time = result.time


def stored_learning(tracker: TrackerProtocol[Any], arrays: Mapping[str, np.ndarray] | None, source: Path) -> Learning:
    """What the cues of a tracker had learned, from the arrays that a run stored after a frame, None for none; raises
    InputError for arrays that were not learned."""
    try:
        return Learning(capabilities_of(tracker).energy, arrays)
    except (ValueError, TypeError) as error:
        remedy = "--overwrite starts again"
        raise InputError(source, f"is damaged: {error}", place="state", remedy=remedy) from None


def _learning(observation: Observation) -> list[str]:
    """Names of the cues that learn, of which every camera of a frame has a reading."""
    names = [name for name, cue in CUES.items() if cue.learns]
    return [name for name in names if observation.cues and all(name in cues for cues in observation.cues)]
