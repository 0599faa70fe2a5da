"""The output of a part detector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class PartProposals:
    """Proposed places of a limb by one instant alone: placements as points (K, 7)
    (`estimator.inference.beliefs.space.PLACEMENTS`) and weights (K,) above 0, which need not sum to 1; K may be 0."""

    points: np.ndarray
    weights: np.ndarray


AllPartProposals = tuple[PartProposals, ...]
"""One a limb, in the graph's order."""
