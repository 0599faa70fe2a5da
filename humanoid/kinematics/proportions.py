"""Segment lengths as parameters of the kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body, PosedBody, points_on_links
from humanoid.subject.subject import Subject


class ProportionedBody:
    """A subject whose proportions can vary: bodies at given scales, and derivatives of landmarks.

    Translations of joints and landmarks are linear in the scales, rotations do not depend on them; the slopes are
    read off subjects scaled by one proportion each.

    base: the body at scales of 1. names (P): the proportions, by joint. mean, std, low, high (P,):
    prior and hard range (CSS 3.2.1, 3.2.3). landmark_slope (P, L, 3), marker_slope (P, M, 3): how landmarks and markers
    move in the frames of their joints [m] with each scale. part_slope (P, B, 3): how the frames of the parts' links
    move in those of their joints [m].
    """

    def __init__(self, subject: Subject) -> None:
        proportions = subject.proportions
        self.names = tuple(p.joint for p in proportions)
        self.mean = np.array([p.mean for p in proportions])
        self.std = np.array([p.std for p in proportions])
        self.low = np.array([p.scale_min for p in proportions])
        self.high = np.array([p.scale_max for p in proportions])
        self.base = Body(subject)
        self._joints = _joint_translations(self.base.model)
        self._joint_slope = np.zeros((len(proportions), self.base.njoints, 3))
        self.landmark_slope = np.zeros((len(proportions), len(self.base.landmark_names), 3))
        self.marker_slope = np.zeros((len(proportions), len(self.base.marker_names), 3))
        links = [(flesh.link, (0.0, 0.0, 0.0)) for flesh in subject.flesh]
        at_rest = points_on_links(self.base.model, links)[1]
        self.part_slope = np.zeros((len(proportions), len(links), 3))
        for k, p in enumerate(proportions):
            step = p.scale_max - 1.0
            other = Body(subject.scaled({p.joint: p.scale_max}))
            self._joint_slope[k] = (_joint_translations(other.model) - self._joints) / step
            self.landmark_slope[k] = (other.landmark_local - self.base.landmark_local) / step
            self.marker_slope[k] = (other.marker_local - self.base.marker_local) / step
            self.part_slope[k] = (points_on_links(other.model, links)[1] - at_rest) / step
        self._carried = _path_to_root(self.base)

    def at(self, scales: np.ndarray) -> Body:
        """The body at scales (P,); its solids stay those of the subject."""
        change = np.asarray(scales) - 1.0
        model = pin.Model(self.base.model)
        translations = self._joints + np.einsum("p,pjk->jk", change, self._joint_slope)
        for j in range(1, model.njoints):
            model.jointPlacements[j] = pin.SE3(model.jointPlacements[j].rotation, translations[j])
        body = Body(self.base.subject, model)
        moved = np.einsum("p,plk->lk", change, self.landmark_slope)
        body.landmark_local = self.base.landmark_local + moved
        body.keypoint_local = self.base.keypoint_local + moved
        body.extent = self.base.extent  # the uncertainty of keypoints does not depend on the person's size
        body.marker_local = self.base.marker_local + np.einsum("p,pmk->mk", change, self.marker_slope)
        return body

    def landmark_derivatives(self, posed: PosedBody) -> np.ndarray:
        """Derivative of every landmark in the world [m] with respect to every scale, (L, 3, P)."""
        return self.point_derivatives(posed, self.base.landmark_joint, self.landmark_slope)

    def point_derivatives(self, posed: PosedBody, joint: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Derivative of points on joints (N,) in the world [m] with respect to every scale, (N, 3, P).

        slope (P, N, 3): that of the points in the frames of their joints [m].
        """
        parent_rotations = posed.rotations[self.base.tree.joint_parent]
        moved = np.einsum("jab,pjb->pja", parent_rotations, self._joint_slope)
        along = np.einsum("ij,pja->iap", self._carried.astype(float), moved)[joint]
        return along + np.einsum("nab,pnb->nap", posed.rotations[joint], slope)

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
