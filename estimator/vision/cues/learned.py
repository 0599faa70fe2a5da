"""What cues have learned before a frame, as arrays among the extra ones of its result, and added to its readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.vision.cues.settings import cues_of
from humanoid.support.errors import InputError

LEARNED = "learned_"
"""Prefix of the names of learned arrays among a frame's extra ones, see `FrameResult.extra`."""


def learned_arrays(extra: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The learned arrays among a frame's extra ones."""
    return {name: array for name, array in extra.items() if name.startswith(LEARNED)}


def without_learned(extra: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A frame's extra arrays without the learned ones: those of the tracker."""
    return {name: array for name, array in extra.items() if not name.startswith(LEARNED)}


def with_learned(observation: Observation, extra: Mapping[str, np.ndarray]) -> Observation:
    """A frame whose cues know what was learned before it, from the extra arrays of its result.

    Raises
    ------
    InputError: the arrays are not of these cameras and cues.
    """
    learned = {name.removeprefix(LEARNED): array for name, array in learned_arrays(extra).items()}
    if not learned or not observation.cues:
        return observation
    for name, array in learned.items():
        if len(array) != len(observation.cues):
            raise InputError(name, f"was learned in {len(array)} cameras, there are {len(observation.cues)}")
    return replace(observation, cues=tuple(_of_camera(cues, learned, c) for c, cues in enumerate(observation.cues)))


def _of_camera(cues: ImageCues, learned: Mapping[str, np.ndarray], camera: int) -> ImageCues:
    known = [cue for cue in cues_of(cues) if cue.name in learned]
    return cues.changed(**{cue.name: cue.with_learned(cues[cue.name], learned[cue.name][camera]) for cue in known})
