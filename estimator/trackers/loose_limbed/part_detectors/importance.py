"""Importance functions of limbs, from all that was proposed (Sigal et al., CVPR 2004, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.inference.beliefs.mixture import Density, KernelMixture, UniformBox, mixture_of
from estimator.inference.beliefs.space import PLACEMENTS
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class ImportanceSettings(CheckedSettings):
    """Q: kernels about what was proposed, and anywhere.

    place [m], turn [rad]: standard deviations of the kernels. anywhere: share that is even in the cameras' common
    volume and turned anyhow, for limbs of which no proposal is right; without any proposal Q is that alone.
    """

    place: float = setting(0.04, above=0)
    turn: float = setting(0.25, above=0)
    anywhere: float = setting(0.1, above=0, below=1)


def importance_functions(
    detectors: Sequence[AllPartProposals], limbs: int, box: np.ndarray, settings: ImportanceSettings
) -> tuple[Density, ...]:
    """Q of each limb: what several part detectors say, each counting alike, box (2, 3) [m]: where limbs can be at
    all."""
    return tuple(
        _function([part_proposals[limb] for part_proposals in detectors], box, settings) for limb in range(limbs)
    )


def _function(part_proposals: Sequence[PartProposals], box: np.ndarray, settings: ImportanceSettings) -> Density:
    anywhere = UniformBox(PLACEMENTS, *box)
    received = [proposals for proposals in part_proposals if len(proposals.points)]
    if not received:
        return anywhere
    weight = np.concatenate([proposals.weights / proposals.weights.sum() for proposals in received])
    variance = np.square([[settings.place] * 3 + [settings.turn] * 3])
    kernels = mixture_of(PLACEMENTS, np.concatenate([proposals.points for proposals in received]), variance, weight)
    return KernelMixture(kernels.log_weight, kernels.mean, kernels.shape, kernels.shapes, anywhere, settings.anywhere)
