"""What cues of the pictures may know of the person before they are read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.known_person import KnownPerson, known_persons
from estimator.vision.likelihood.registry import CUES
from estimator.vision.likelihood.settings import CueSettings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import BUILT_IN, Subject, load_subject


def persons_before(
    subject: Subject, cameras: Sequence[Camera], pixels: np.ndarray, confidence: np.ndarray, chosen: CueSettings
) -> Sequence[KnownPerson] | None:
    """What keypoints (T, C, L, 2), confidence (T, C, L), say beforehand of where the person is, for every camera; None
    where no cue asks.

    The body is a built-in subject as it was shipped, so that a run's own, which was fitted later, gives the same.
    """
    if not any(CUES[name].uses_masks for name in chosen.used):
        return None
    shipped = load_subject(subject.source, base=subject.base) if subject.source in BUILT_IN else subject
    return known_persons(Body(shipped), cameras, pixels, confidence)
