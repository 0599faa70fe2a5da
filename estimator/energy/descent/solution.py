"""What a search gives back, and the words and counts that it says how it went with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.energy.cost import QuadraticModel

# How a search ended that is no descent of `estimator.numerics.newton`.
# Parts that overlapped were parted, and the residual did not become small; a mean of particles, no end of a search.
SEPARATED, SAMPLED = "separated", "sampled"


class StepCounts(NamedTuple):
    """How many steps of a search each solver solved.

    free: no bound was active, by Cholesky decomposition. active_set: by the compiled active set. proxqp: by ProxQP.
    failed: by none, as no answer was certified. A model that is not convex has a step only where the active set leaves
    a convex part of it free; elsewhere it has none and is not counted.
    """

    free: int = 0
    active_set: int = 0
    proxqp: int = 0
    failed: int = 0

    @property
    def guessed(self) -> int:
        """Steps that needed no ProxQP."""
        return self.free + self.active_set

    @staticmethod
    def between(before: Sequence[int], after: Sequence[int]) -> StepCounts:
        """What was counted from one count to another."""
        return StepCounts(
            after[0] - before[0], after[1] - before[1], after[2] - before[2], after[3] - before[3]
        )  # fmt: skip

    def plus(self, other: StepCounts) -> StepCounts:
        """The steps of both."""
        return StepCounts(self[0] + other[0], self[1] + other[1], self[2] + other[2], self[3] + other[3])


class Solution(NamedTuple):
    """End of a search.

    quadratic: the quadratic model at the last accepted q. status: CONVERGED, STALLED, ITERATIONS or SEPARATED.
    kkt_residual: recomputed there. iterations: steps tried. steps: which solvers solved them; more than were tried
    where one step was solved several times, each with more damping.
    """

    quadratic: QuadraticModel
    status: str
    kkt_residual: float
    iterations: int
    steps: StepCounts = StepCounts()

    @property
    def q(self) -> np.ndarray:
        """Configuration (nq,)."""
        return self.quadratic.posed.q
