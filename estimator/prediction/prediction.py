"""What a camera should see of a posed body: nodes with their visibility, and occluding contours (CSS 2, 3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.cameras.camera import Camera
from estimator.prediction.seeing import see_nodes, see_points
from estimator.prediction.visibility import (
    VISIBLE,
    classify_contours,
    classify_nodes,
    contour_points,
    fill_buffer,
    frame_buffer,
)
from humanoid.kinematics.body import PosedBody
from humanoid.shape.surface import Surface

GAP = 0.02  # m; a node this much behind another part's front is hidden
JOINED = 0.05  # m; a part this little behind a contour continues the surface: no edge is seen there
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

    pixels (N, 2), depth (N,) [m], state (N,): of the nodes, see `estimator.prediction.visibility`.
    back_facing, occluded: how many nodes are. contours: see `Contours`.
    buffer (rows, columns): 1 / depth [1/m], zero where there is no body; owner: part, or -1. frame: pixel of the
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


class Predictor:
    """Predicts one camera's view of a surface; `fineness` is the number of cells of the depth buffer."""

    def __init__(self, surface: Surface, camera: Camera, fineness: int = FINENESS) -> None:
        self.surface, self.camera = surface, camera
        self._fineness = float(fineness)
        self._intrinsics, self._distortion, self._R, self._t = camera.arrays
        self._edges = mesh_edges(surface.faces)
        self._capacity = max(64, len(self._edges) // 3)

    def predict(self, posed: PosedBody) -> Prediction:
        """The view of a posed body; every array of the result is its own."""
        s = self.surface
        width, height = self.camera.image_size
        pixels, depth, facing = self._see_nodes(posed)
        frame = np.empty(3)
        rows, columns = frame_buffer(pixels, depth, self._fineness, frame)
        nearness, owner = np.empty((rows, columns)), np.empty((rows, columns), dtype=np.int32)
        fill_buffer(pixels, depth, s.part, s.faces, frame, nearness, owner)
        state = np.empty(len(depth), dtype=np.int8)
        back, hidden = classify_nodes(
            pixels, depth, facing, s.part, s.convex, frame, nearness, owner, width, height, GAP, state
        )
        contours = self._contours(posed, depth, facing, frame, nearness, owner)
        return Prediction(pixels, depth, state, back, hidden, contours, nearness, owner, frame)

    def _contours(
        self,
        posed: PosedBody,
        depth: np.ndarray,
        facing: np.ndarray,
        frame: np.ndarray,
        nearness: np.ndarray,
        owner: np.ndarray,
    ) -> Contours:
        s = self.surface
        width, height = self.camera.image_size
        size = self._capacity
        local, normal = np.empty((size, 3)), np.empty((size, 3))
        nodes, share = np.empty((size, 2), dtype=np.int64), np.empty(size)
        count = contour_points(self._edges, s.local, s.normal, depth, facing, local, normal, nodes, share)
        nodes, local = nodes[:count], local[:count]
        joint, part = s.joint[nodes[:, 0]], s.part[nodes[:, 0]]
        pixels, there, _, image_normals = self._see(posed, joint, local, normal[:count])
        state = np.empty(count, dtype=np.int8)
        classify_contours(pixels, there, image_normals, part, frame, nearness, owner, width, height, GAP, JOINED, state)
        return Contours(joint, local, pixels, image_normals, state, nodes, share[:count])

    def _see_nodes(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pixels (N, 2), depth (N,) and facing (N,) of the surface's nodes."""
        s, count = self.surface, len(self.surface.joint)
        pixels, depth, facing = np.empty((count, 2)), np.empty(count), np.empty(count)
        see_nodes(
            posed.placements, s.joint, s.local, s.normal, self._intrinsics, self._distortion, self._R, self._t, pixels,
            depth, facing,
        )  # fmt: skip
        return pixels, depth, facing

    def _see(
        self, posed: PosedBody, joint: np.ndarray, local: np.ndarray, normal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Pixels (N, 2), depth (N,), facing (N,) and image normals (N, 2) of points on joints."""
        count = len(joint)
        world, pixels, image_normals = np.empty((count, 3)), np.empty((count, 2)), np.empty((count, 2))
        depth, facing = np.empty(count), np.empty(count)
        see_points(
            posed.placements, joint, local, normal, self._intrinsics, self._distortion, self._R, self._t, world, pixels,
            depth, facing, image_normals,
        )  # fmt: skip
        return pixels, depth, facing, image_normals


def mesh_edges(faces: np.ndarray) -> np.ndarray:
    """Every edge of a triangle mesh once, (E, 2) int."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)
