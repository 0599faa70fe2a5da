"""The cameras of the browser preview: a mark, the pictures as a rectangle in the world, and where to look from.

Pictures beyond PICTURES over all cameras are left out; each instant then shows the last picture at or before it. They
are reduced to PICTURE_LONGEST px, freed of lens distortion and JPEG-compressed.
"""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import cv2
import meshcat
import meshcat.geometry as g
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.stereo import undistortion_maps
from viz import palette
from viz.preview.recorder import TexturedPlane, line_segments
from viz.scene import Scene, evenly

PICTURES = 240
PICTURES_PER_CAMERA = 120
PICTURE_LONGEST = 640
_QUALITY = 72
_MARK_DEPTH = 0.25  # size of the little pyramid that stands for a camera [m]
_BEFORE = 2.0  # of the nearest body: where the view of a parallel camera looks from [m]


def add_camera(root: meshcat.Visualizer, scene: Scene, c: int, rows: list[int], points: np.ndarray) -> dict[str, Any]:
    """One camera's mark, picture and frustum; returns what the player needs of it.

    rows: the instants that are shown. points (N, 3): where bodies are in the world [m]; the picture stands behind them.
    """
    camera = scene.cameras[c]
    node = root["cameras"][f"camera_{c}"]
    node["mark"].set_object(line_segments(_pyramid(camera, _MARK_DEPTH), palette.TEXT))
    depths = camera.depths(points)
    far = float(depths.max()) + 0.6
    far = far if camera.parallel else max(1.0, far)
    pictures, picture_of = _pictures(scene, c, rows)
    if pictures:
        material = g.MeshBasicMaterial(color=0xFFFFFF, side=0)
        node["picture"].set_object(TexturedPlane(_corners(camera, far)), material)
        node["frustum"].set_object(line_segments(_pyramid(camera, far), palette.GRID))
    axes, centre = camera.R_camera_world, camera.origin_world
    if camera.parallel:  # from before the bodies: its own plane may be anywhere
        centre = centre + (float(depths.min()) - _BEFORE) * axes[2]
    distance = max(0.5, float(axes[2] @ (points.mean(axis=0) - centre)))
    evidence = (_corners(camera, 1.0) - centre) @ axes.T
    return {
        "name": camera.name,
        "node": f"camera_{c}",
        "eye": centre.tolist(),
        "target": (centre + distance * axes[2]).tolist(),
        "up": (-axes[1]).tolist(),
        # the view's middle is the principal point, so what is farther from it decides
        "half_width": float(np.abs(evidence[:, 0]).max()),
        "half_height": float(np.abs(evidence[:, 1]).max()),
        "parallel": camera.parallel,  # the halves are tangents of angles, or metres
        "pictures": pictures,
        "picture_of": picture_of,
    }


def _corners(camera: Camera, depth: float) -> np.ndarray:
    """Corners of the picture at a depth, clockwise from the top left, in the world [m], (4, 3)."""
    width, height = camera.image_size
    corners = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    rays = np.concatenate([corners, np.ones((4, 1))], axis=1) @ np.linalg.inv(camera.K).T
    places = rays * ([1.0, 1.0, depth] if camera.parallel else depth)
    return (places - camera.t_camera_world) @ camera.R_camera_world


def _pyramid(camera: Camera, depth: float) -> np.ndarray:
    """Ends (16, 3) [m] of the lines from a camera, or its plane, to the picture's corners at a depth, and around it."""
    corners = _corners(camera, depth)
    starts = _corners(camera, 0.0) if camera.parallel else np.tile(camera.centre_world, (4, 1))
    pairs = [p for i in range(4) for p in (starts[i], corners[i], corners[i], corners[(i + 1) % 4])]
    return np.array(pairs)


def _pictures(scene: Scene, c: int, rows: list[int]) -> tuple[list[str], list[int]]:
    """JPEG data addresses of one camera's pictures, and which of them each instant shows."""
    if scene.frames[c] is None:
        return [], []
    wanted = min(PICTURES_PER_CAMERA, max(1, PICTURES // len(scene.cameras)))
    chosen = evenly(len(rows), wanted)
    pictures: list[str] = []
    shown: list[int] = []
    for i, image in zip(chosen, scene.images(c, [rows[i] for i in chosen]), strict=True):
        if image is None:
            break
        pictures.append(data_address(image, scene.cameras[c]))
        shown.append(i)
    if not pictures:
        return [], []
    last = np.searchsorted(shown, np.arange(len(rows)), side="right") - 1
    return pictures, np.maximum(last, 0).tolist()


def data_address(image: np.ndarray, camera: Camera) -> str:
    """The picture reduced, undistorted (so that it fits the flat plane) and compressed."""
    scale = min(1.0, PICTURE_LONGEST / max(camera.image_size))
    width, height = (max(1, round(side * scale)) for side in camera.image_size)
    size = width, height
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if camera.fisheye or np.any(camera.distortion):
        K = camera.K.copy()
        K[:2, 2] = (K[:2, 2] + 0.5) * scale - 0.5
        K[0, :2] *= scale
        K[1, 1] *= scale
        maps = undistortion_maps(replace(camera, K=K, image_size=size), K, size)
        small = cv2.remap(small, *maps, cv2.INTER_LINEAR)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")
