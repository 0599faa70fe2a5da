"""Contour points with image features assigned, as functions of pose, proportions and shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.cues.assigned import Assignments
from estimator.vision.cues.assigned_loads import assigned_loads
from estimator.vision.prediction import Contours
from humanoid.kinematics.body import PosedBody


class PointLoads(NamedTuple):
    """Energy of some points, and its gradient and Gauss-Newton Hessian by each point's place.

    value. points (N, 3): in the world [m]. force (N, 3) [1/m]. load (N, 3, 3) [1/m^2].
    """

    value: float
    points: np.ndarray
    force: np.ndarray
    load: np.ndarray


class ContourPoints:
    """Points of one camera's contours, each between two nodes of the surface, and the features assigned to them.

    A point keeps its share of the way between its nodes and its rise over their chord, so that it moves as they do.

    joint (N,) int, nodes (N, 2) int, share (N,): see `estimator.vision.prediction.Contours`.

    Parameters
    ----------
    node_places (., 3): all nodes in the frames of their joints [m], as they were when the contours were predicted.
    groups: features assigned to the contours' points.
    """

    def __init__(
        self, camera: Camera, contours: Contours, node_places: np.ndarray, groups: Sequence[Assignments]
    ) -> None:
        point, *features = (np.concatenate(columns) for columns in zip(*groups, strict=True))
        used, inverse = np.unique(point, return_inverse=True)
        order = np.argsort(inverse, kind="stable")
        self._first = np.searchsorted(inverse[order], np.arange(len(used) + 1))
        self._features = tuple(np.ascontiguousarray(feature[order]) for feature in features)
        self._view = camera.arrays
        self.joint, self.nodes, self.share = contours.joint[used], contours.nodes[used], contours.share[used]
        self._rise = contours.local[used] - self.between(node_places)

    def between(self, of_nodes: np.ndarray) -> np.ndarray:
        """Something of all nodes (., ...) at the points, (N, ...)."""
        share = self.share.reshape(-1, *([1] * (of_nodes.ndim - 1)))
        return np.asarray((1.0 - share) * of_nodes[self.nodes[:, 0]] + share * of_nodes[self.nodes[:, 1]])

    def loads(self, posed: PosedBody, node_places: np.ndarray) -> PointLoads:
        """Energy of the assigned features with the nodes at `node_places` (., 3) in the frames of their joints [m]."""
        local = np.ascontiguousarray(self.between(node_places) + self._rise)
        target, precision, weight, potential, nu = self._features
        intrinsics, distortion, R, t = self._view
        points, force, load = (np.empty((len(local), *size)) for size in ((3,), (3,), (3, 3)))
        value = assigned_loads(
            posed.placements, self.joint, local, intrinsics, distortion, R, t, self._first, target,
            precision, weight, potential, nu, False, points, force, load,
        )  # fmt: skip
        return PointLoads(float(value), points, force, load)
