"""A person's picture, cut out so that it depends neither on where they stand nor on how far away: what they are looked
up by."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread
from estimator.vision.edge_histogram import SIDE, edge_histogram


@dataclass(frozen=True)
class ViewFrame:
    """A frame at a person, turned to the camera.

    origin (3,): the middle of the surface that is seen, in the world [m]. R_world_view (3, 3): its axes x away from the
    camera, level; y to the left; z up.
    """

    origin: np.ndarray
    R_world_view: np.ndarray

    @staticmethod
    def at(places: np.ndarray, camera: Camera, up: np.ndarray) -> ViewFrame:
        """Frame of the places (N, 3) in the world [m] of a person's surface that a camera sees, one or more; up (3,).

        Their median is where most of the person is, whatever one arm does.
        """
        origin = np.median(places, axis=0)
        away = origin - camera.centre_world
        forward = away - (away @ up) * up
        length = float(np.linalg.norm(forward))
        if length < 1e-6 * np.linalg.norm(away):  # seen from right above: any heading will do
            forward, length = camera.R_camera_world[1] - (camera.R_camera_world[1] @ up) * up, 1.0
        forward = forward / length
        return ViewFrame(origin, np.stack([forward, np.cross(up, forward), up], axis=1))

    def elevation(self, camera: Camera) -> float:
        """Angle by which the camera looks down on the person [degrees]."""
        towards = self.R_world_view.T @ (camera.centre_world - self.origin)
        return float(np.degrees(np.arctan2(towards[2], -towards[0])))


def described(
    grey: np.ndarray, mask: np.ndarray, camera: Camera, frame: ViewFrame, side: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The edge direction histogram (bins,) of a person, the cut-out (200, 200) uint8 that it is of, and where it shows
    them, (200, 200) bool.

    grey (H, W) uint8, mask (H, W) bool of the person: of the camera. side [m]: of the square, at the person's depth.
    """
    square, where = cut_out(grey, mask, camera, frame, side)
    return edge_histogram(square, where), square, where


def square_transform(camera: Camera, frame: ViewFrame, side: float) -> np.ndarray:
    """Transform (2, 3) from pixels of the camera's picture to those of the square around a person: scaled, then
    moved."""
    u, v = camera.project(frame.origin)
    depth = float(camera.R_camera_world[2] @ frame.origin + camera.t_camera_world[2])
    scale = SIDE / (side * camera.K[0, 0] / depth)
    middle = 0.5 * (SIDE - 1)
    return np.array([[scale, 0.0, middle - scale * u], [0.0, scale, middle - scale * v]])


@one_thread()
def cut_out(
    grey: np.ndarray, mask: np.ndarray, camera: Camera, frame: ViewFrame, side: float
) -> tuple[np.ndarray, np.ndarray]:
    """The grey square (200, 200) uint8 around a person, and where it shows them, (200, 200) bool."""
    to_square = square_transform(camera, frame, side)
    scale = to_square[0, 0]
    if scale < 1.0:  # pixels that fall together are averaged
        grey = cv2.GaussianBlur(grey, (0, 0), 0.5 / scale)
    square = cv2.warpAffine(grey, to_square, (SIDE, SIDE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    shown = cv2.warpAffine(mask.astype(np.uint8), to_square, (SIDE, SIDE), flags=cv2.INTER_NEAREST)
    return np.asarray(square), shown > 0
