"""When depth is open."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation


def only_camera(observation: Observation) -> Camera | None:
    """The camera that alone sees the body; None where several do, since depth is then known."""
    if observation.cues:
        return observation.cameras[0] if len(observation.cues) == 1 else None
    seeing = np.flatnonzero((observation.confidence > 0.0).any(axis=1))
    return observation.cameras[int(seeing[0])] if len(seeing) == 1 else None
