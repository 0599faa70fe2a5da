"""What one instant's pictures show of limbs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.trackers.loose_limbed.limbs.likelihood import LimbView, limb_view

SILHOUETTE = "silhouette"
"""The cue that says where the person is."""

LimbLogRatio = Callable[[int, np.ndarray, np.ndarray], np.ndarray]
"""As `LimbLikelihood.log_ratio`: limb, t (N, 3), R (N, 3, 3) -> (N,) nats."""


def limb_views(observation: Observation) -> list[LimbView]:
    """A view of each camera with a picture, in their order; the person's place is known where a silhouette was read."""
    return [_view(cues) for cues in observation.cues if cues.picture is not None]


def _view(cues: ImageCues) -> LimbView:
    assert cues.picture is not None
    read = cues.get(SILHOUETTE)
    mask, known = (None, None) if read is None else (read.mask, read.known)
    return limb_view(cues.camera, cues.picture, mask, known)


def shows_person(views: Sequence[LimbView], least: float = 0.002) -> bool:
    """Whether a view has the person in at least that share of its pixels, or none knows where the person is and some
    picture is not of one colour."""
    told = [view for view in views if view.foreground.size]
    if told:
        return any(float((view.foreground == 1).mean()) >= least for view in told)
    return any(max(float(np.abs(m).max()) for m in view.ridges.first) > 0.0 for view in views)
