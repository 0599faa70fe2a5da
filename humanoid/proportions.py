"""Segment lengths as parameters of the kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from humanoid.body import Body, PosedBody
from humanoid.subject import Subject


class ProportionedBody:
    """A subject whose proportions can vary: bodies at given scales, and derivatives of landmarks.

    Translations of joints and landmarks are linear in the scales, rotations do not depend on them; the slopes are
    read off subjects scaled by one proportion each.

    names (P): the proportions, by joint. mean, std, low, high (P,): prior and hard range (CSS 3.2.1, 3.2.3).
    """

    def __init__(self, subject: Subject) -> None:
        proportions = subject.proportions
        self.names = tuple(p.joint for p in proportions)
        self.mean = np.array([p.mean for p in proportions])
        self.std = np.array([p.std for p in proportions])
        self.low = np.array([p.scale_min for p in proportions])
        self.high = np.array([p.scale_max for p in proportions])
        self._base = Body(subject)
        self._joints = _joint_translations(self._base.model)
        self._joint_slope = np.zeros((len(proportions), self._base.njoints, 3))
        self._landmark_slope = np.zeros((len(proportions), len(self._base.landmark_names), 3))
        for k, p in enumerate(proportions):
            step = p.scale_max - 1.0
            other = Body(subject.scaled({p.joint: p.scale_max}))
            self._joint_slope[k] = (_joint_translations(other.model) - self._joints) / step
            self._landmark_slope[k] = (other.landmark_local - self._base.landmark_local) / step
        self._carried = _path_to_root(self._base)

    def at(self, scales: np.ndarray) -> Body:
        """The body at scales (P,); its solids stay those of the subject."""
        change = np.asarray(scales) - 1.0
        model = pin.Model(self._base.model)
        translations = self._joints + np.einsum("p,pjk->jk", change, self._joint_slope)
        for j in range(1, model.njoints):
            model.jointPlacements[j] = pin.SE3(model.jointPlacements[j].rotation, translations[j])
        body = Body(self._base.subject, model)
        body.landmark_local = self._base.landmark_local + np.einsum("p,plk->lk", change, self._landmark_slope)
        return body

    def landmark_derivatives(self, posed: PosedBody) -> np.ndarray:
        """Derivative of every landmark in the world [m] with respect to every scale, (L, 3, P)."""
        base = self._base
        parent_rotations = posed.rotations[base.tree.joint_parent]
        moved = np.einsum("jab,pjb->pja", parent_rotations, self._joint_slope)
        along = np.einsum("lj,pja->lap", self._carried[base.landmark_joint].astype(float), moved)
        own = np.einsum("lab,plb->lap", posed.rotations[base.landmark_joint], self._landmark_slope)
        return along + own

    def scales(self, values: np.ndarray) -> dict[str, float]:
        """Scales (P,) by the proportions' joints, for `Subject.scaled`."""
        return {name: float(v) for name, v in zip(self.names, values, strict=True)}


def _joint_translations(model: pin.Model) -> np.ndarray:
    return np.array([model.jointPlacements[j].translation for j in range(model.njoints)])


def _path_to_root(body: Body) -> np.ndarray:
    """(njoints, njoints) bool: row j marks j and the joints above it."""
    carried = np.eye(body.njoints, dtype=bool)
    for j in range(1, body.njoints):
        carried[j] |= carried[body.tree.joint_parent[j]]
    return carried
