"""A body's degrees of freedom in parts that can be drawn one after the other: the trunk, then each limb by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.search.jumps.anatomy import Anatomy
from estimator.search.point_features import PointFeatures
from estimator.trackers.dual_chain.limb_ik import LimbIK
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limbs_on_joints
from humanoid.support.errors import InputError


@dataclass(frozen=True, eq=False)
class PoseParts:
    """The parts of one body, of which the first is the trunk: everything that is in no limb.

    dofs: of each part. features: what is predicted of the body in an image; of_part: which of them each part moves, the
    trunk's first; of_limb (F,): the limb of `graph` that each is on, -1 for none. ik: of each limb, for its
    outermost feature. shapes: for each part, which limbs of `graph` (G,) bool its degrees of freedom move, and no part
    after it. rest: what joints return to.
    """

    body: Body
    features: PointFeatures
    graph: LimbGraph
    dofs: tuple[np.ndarray, ...]
    of_part: tuple[np.ndarray, ...]
    of_limb: np.ndarray
    ik: tuple[LimbIK, ...]
    shapes: tuple[np.ndarray, ...]
    rest: Rest

    @staticmethod
    def of(body: Body, anatomy: Anatomy, features: PointFeatures, graph: LimbGraph) -> PoseParts:
        """Those limbs of the anatomy that move a feature are parts; all else is the trunk.

        Raises
        ------
        InputError: a body none of whose limbs moves a feature.
        """
        chosen = [k for k in range(len(anatomy.limbs)) if len(features.ends(k))]
        if not chosen:
            problem = "has no limb of two segments that a feature is on"
            raise InputError(f"subject {body.subject.name}", problem, remedy="a subject with arms, such as upper13")
        limbs = [anatomy.limbs[k] for k in chosen]
        taken = np.concatenate([limb.dofs for limb in limbs])
        trunk = np.setdiff1d(np.arange(body.nv), taken)
        ends = [int(features.ends(k)[-1]) for k in chosen]
        ik = [
            LimbIK.of(body, limb, int(features.joint[end]), features.local[end])
            for limb, end in zip(limbs, ends, strict=True)
        ]
        on_trunk = np.array([f for f in range(len(features.names)) if features.limb[f] not in chosen], dtype=np.int64)
        joints, _ = limbs_on_joints(graph, body)
        moved = np.array([body.support(int(j)) for j in joints])  # (G, nv)
        by_limb = [np.asarray(moved[:, limb.dofs].any(axis=1)) for limb in limbs]
        return PoseParts(
            body,
            features,
            graph,
            (trunk, *(limb.dofs for limb in limbs)),
            (on_trunk, *(features.ends(k) for k in chosen)),
            np.array([next(iter(np.flatnonzero(joints == joint)), -1) for joint in features.joint], dtype=np.int64),
            tuple(ik),
            (np.asarray(~np.any(by_limb, axis=0)), *by_limb),
            Rest.of(body),
        )

    @property
    def count(self) -> int:
        """The trunk and the limbs."""
        return len(self.dofs)


@dataclass(frozen=True, eq=False)
class Rest:
    """Return of poses to rest: random steps whose stationary distribution of joints is that of their stabilisers.

    The joints (K,) with a stabiliser: entries and dofs, where they are in configurations and tangents; at (K,),
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
        """Rest as a tangent (nv,) at reference (nq,), and the deviation of joints from it (nv,), 1 where unknown."""
        rest, std = body.difference(reference, body.neutral), np.ones(body.nv)
        rest[self.dofs], std[self.dofs] = self.at - reference[self.entries], self.std
        return rest, std
