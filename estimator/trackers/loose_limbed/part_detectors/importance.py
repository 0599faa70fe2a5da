"""Importance functions of limbs, from all that was shouted (Sigal et al., CVPR 2004, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.inference.beliefs.mixture import Box, Density, Mixture, mixture_of
from estimator.inference.beliefs.space import PLACEMENTS
from estimator.trackers.loose_limbed.part_detectors.contract import Shout, Shouts
from humanoid.support.settings import check, setting


@dataclass(frozen=True)
class ImportanceSettings:
    """Q: kernels about what was shouted, and anywhere.

    place [m], turn [rad]: standard deviations of the kernels. anywhere: share that is even in the cameras' common
    volume and turned anyhow, for limbs that nobody shouts of right; without a shout Q is that alone.
    """

    place: float = setting(0.04, above=0)
    turn: float = setting(0.25, above=0)
    anywhere: float = setting(0.1, above=0, below=1)

    def __post_init__(self) -> None:
        check(self)


def importance_functions(
    shouters: Sequence[Shouts], limbs: int, box: np.ndarray, settings: ImportanceSettings
) -> tuple[Density, ...]:
    """Q of each limb: what several shouters say, each counting alike, box (2, 3) [m]: where limbs can be at all."""
    return tuple(_function([shouts[limb] for shouts in shouters], box, settings) for limb in range(limbs))


def _function(shouts: Sequence[Shout], box: np.ndarray, settings: ImportanceSettings) -> Density:
    anywhere = Box(PLACEMENTS, *box)
    heard = [shout for shout in shouts if len(shout.points)]
    if not heard:
        return anywhere
    weight = np.concatenate([shout.weights / shout.weights.sum() for shout in heard])
    variance = np.square([[settings.place] * 3 + [settings.turn] * 3])
    kernels = mixture_of(PLACEMENTS, np.concatenate([shout.points for shout in heard]), variance, weight)
    return Mixture(kernels.log_weight, kernels.mean, kernels.shape, kernels.shapes, anywhere, settings.anywhere)
