"""Prediction of a camera's view of a posed body: nodes with their visibility, and occluding contours (CSS 2, 3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.view import view_of_contours, view_of_nodes
from estimator.vision.visibility import VISIBLE
from humanoid.kinematics.body import PosedBody
from humanoid.shape.surface import Surface

FINENESS = 6000  # cells of the depth buffer


class Contours(NamedTuple):
    """Points on the body's occluding contours.

    joint (M,), local (M, 3): fixed to these joints for as long as the pose is near the one predicted from [m].
    pixels (M, 2). normals (M, 2): unit, outward, in the image. state (M,): OUTER, INNER or HIDDEN. nodes (M, 2), share
    (M,): the nodes between which each point lies, and how far on the way.
    """

    joint: np.ndarray
    local: np.ndarray
    pixels: np.ndarray
    normals: np.ndarray
    state: np.ndarray
    nodes: np.ndarray
    share: np.ndarray


class Prediction(NamedTuple):
    """One camera's view of the surface at one configuration.

    pixels (N, 2), depth (N,) [m], state (N,): of the nodes, see `estimator.vision.visibility`.
    back_facing, occluded: how many nodes are. contours: see `Contours`.
    buffer (rows, columns): 1 / depth [1/m], or `estimator.data.cameras.projection.nearness` for a parallel camera,
    whose depths count from far before its plane; zero where there is no body. owner: part, or -1. frame: pixel of the
    buffer's first cell and size of a cell, (left, top, size).
    """

    pixels: np.ndarray
    depth: np.ndarray
    state: np.ndarray
    back_facing: int
    occluded: int
    contours: Contours
    buffer: np.ndarray
    owner: np.ndarray
    frame: np.ndarray

    @property
    def visible(self) -> np.ndarray:
        """Nodes that face the camera, are in the image and hidden by nothing, (N,) bool."""
        return self.state == VISIBLE

    def cells(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Column and row (N, 2) of the buffer's cells at pixels (N, 2), and which are inside it, (N,) bool."""
        cells = np.nan_to_num((pixels - self.frame[:2]) / self.frame[2] + 0.5, nan=-1.0).astype(int)
        return cells, ((cells >= 0) & (cells < self.buffer.shape[::-1])).all(axis=1)


class Predictor:
    """Predicts one camera's view of a surface; `fineness` is the number of cells of the depth buffer."""

    def __init__(self, surface: Surface, camera: Camera, fineness: int = FINENESS) -> None:
        self.surface, self.camera = surface, camera
        self._fineness = float(fineness)
        self._camera = camera.arrays
        self._edges = mesh_edges(surface.faces)
        self._capacity = max(64, len(self._edges) // 3)

    def predict(self, posed: PosedBody, every: int = 1) -> Prediction:
        """The view of a posed body; every array of the result is its own. Of its contours' points one in `every`."""
        s, camera, size = self.surface, self._camera, self.camera.image_size
        pixels, depth, facing, state, back, hidden, nearness, owner, frame = view_of_nodes(
            posed.placements, s.joint, s.local, s.normal, s.part, s.convex, s.faces, *camera, *size, self._fineness
        )
        contours = view_of_contours(
            posed.placements, self._edges, s.joint, s.local, s.normal, s.part, depth, facing, frame, nearness, owner,
            *camera, *size, self._capacity, every,
        )  # fmt: skip
        return Prediction(pixels, depth, state, back, hidden, Contours(*contours), nearness, owner, frame)


def mesh_edges(faces: np.ndarray) -> np.ndarray:
    """Every edge of a triangle mesh once, (E, 2) int."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)
