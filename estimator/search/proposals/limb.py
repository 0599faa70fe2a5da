"""One limb elsewhere, the rest of the body where it is."""

from __future__ import annotations

import numpy as np

from humanoid.kinematics.body import Body


class LimbProposal:
    """Moves the joints from one joint outwards, all others staying where they are.

    Pictures are matched to a hypothesis from nearby, so a limb that has lost its image is found again only by trying it
    elsewhere: one limb at a time, since a sample of all joints at once is nowhere near the image (partitioned sampling,
    MacCormick and Isard 2000).

    least, most [rad]: standard deviation of the joints' change; less than `least` is what a search finds by itself.
    """

    def __init__(self, body: Body, least: float = 0.3, most: float = 1.2) -> None:
        self.body = body
        self._spread = np.log([least, most])  # rad, of the joints' change
        first = range(body.first_joint_dof, body.nv)  # a free root is not a limb
        self._behind = [np.flatnonzero([self._moves(d, e) for e in range(body.nv)]) for d in first]

    def _moves(self, dof: int, other: int) -> bool:
        """Whether `other` is `dof` or lies behind it, or behind a joint that follows it."""
        tree = self.body.tree
        column = int(tree.dof_column[other])
        while column >= 0 and tree.column_dof[column] != dof:
            column = int(tree.column_parent[column])
        return column >= 0

    def sample(self, rng: np.random.Generator, q: np.ndarray) -> np.ndarray:
        """q (nq,) with the joints behind a random one changed by a spread drawn evenly in its logarithm."""
        if not self._behind:
            return q
        dofs = self._behind[int(rng.integers(len(self._behind)))]
        step = np.zeros(self.body.nv)
        step[dofs] = np.exp(rng.uniform(*self._spread)) * rng.standard_normal(len(dofs))
        return self.body.integrate(q, step)
