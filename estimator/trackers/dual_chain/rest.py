"""How poses go back to rest: random steps that in the long run leave joints as their stabilisers have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid.kinematics.body import Body


@dataclass(frozen=True, eq=False)
class Rest:
    """The joints (K,) with a stabiliser: entries and dofs, where they are in configurations and tangents; at (K,),
    their mean, and std (K,) about it [rad or m]."""

    entries: np.ndarray
    dofs: np.ndarray
    at: np.ndarray
    std: np.ndarray

    @staticmethod
    def of(body: Body) -> Rest:
        """By the subject's stabilisers."""
        known = [s for s in body.subject.stabilisers if body.model.existJointName(s.joint)]
        joints = [body.model.getJointId(s.joint) for s in known]
        return Rest(
            np.array([body.model.idx_qs[j] for j in joints], dtype=np.int64),
            np.array([body.model.idx_vs[j] for j in joints], dtype=np.int64),
            np.array([s.moments[0] for s in known]),
            np.array([s.moments[1] for s in known]),
        )

    def returned(self, x: np.ndarray, reference: np.ndarray, step: np.ndarray, most: float) -> np.ndarray:
        """Tangents (N, nv) at reference (nq,) after the way back before a step of standard deviation `step` (nv,).

        x - rest shrinks by a with a^2 std^2 + step^2 = std^2 (an autoregressive process of first order), so that joints
        of which nothing is seen are in the end distributed about their rest, and not all over their range. It shrinks
        by no more than the share `most`: steps that are as long as fast motion needs would pull an arm that is held up
        back to rest at once.
        """
        keep = np.sqrt(np.maximum(1.0 - np.square(step[self.dofs] / self.std), (1.0 - most) ** 2))
        rest = self.at - reference[self.entries]
        out = x.copy()
        out[:, self.dofs] = rest + keep * (x[:, self.dofs] - rest)
        return out

    def guess(self, body: Body, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rest as a tangent (nv,) at reference (nq,), and how far from it joints are (nv,), 1 where nobody knows."""
        rest, std = body.difference(reference, body.neutral), np.ones(body.nv)
        rest[self.dofs], std[self.dofs] = self.at - reference[self.entries], self.std
        return rest, std
