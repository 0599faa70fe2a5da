"""Pictures by a rig's cameras of a body anywhere in their common volume: random size, clothes, light, heading and
pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.synthesis.clothing import Clothes, dressed_at_random, periodic_noise
from estimator.synthesis.pictures import Variant
from estimator.synthesis.poses import PoseSampler
from estimator.synthesis.raster import paint_cloth
from estimator.vision.patches import PatchView, patch_view
from estimator.vision.resolution import scaled_camera
from humanoid.kinematics.body import ROOT_Q, PosedBody, directions_in_world, points_in_world
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.shape.surface import Surface

_WIDEST = 320  # px of the pictures that are painted: patches are not finer
_PLACES = 60  # tried for a pose, until one is seen by all
_LIGHT = 0.3, 0.75  # ambient
_NOISE = 1.0, 4.0  # grey values
_BLUR = 0.3, 1.0  # px
_SPECKS = 4  # wrong blobs of a foreground, at most


class RigExample(NamedTuple):
    """A pose as the rig sees it: its views, the limbs' placements t (L, 3) [m], R (L, 3, 3), and which of them have
    their middles in all pictures (L,) bool."""

    views: tuple[PatchView, ...]
    t: np.ndarray
    R: np.ndarray
    seen: np.ndarray


class RigPainter:
    """Paints poses of bodies as all cameras of a rig see them at one instant.

    graph: the limbs whose placements are given. variants: the bodies in the pictures. box (2, 3) [m]: where the middle
    of the limbs may be; a body with a fixed root stays where it is.
    """

    def __init__(
        self, poses: PoseSampler, graph: LimbGraph, cameras: Sequence[Camera], variants: Sequence[Variant],
        box: np.ndarray,
    ) -> None:  # fmt: skip
        self._poses, self._graph, self._variants, self._box = poses, graph, variants, box
        self._cameras = [scaled_camera(c, min(1.0, _WIDEST / max(c.image_size))) for c in cameras]
        self._grain = periodic_noise(np.random.default_rng(0))
        self._along = np.array([0.5 * limb.length for limb in graph.limbs])

    def example(self, rng: np.random.Generator) -> RigExample:
        """A pose in a place, drawn from `rng`."""
        body, surface = self._variants[int(rng.integers(len(self._variants)))]
        q = self._poses.draw(rng)
        t, R = limb_placements(self._graph, body, q)
        shift, seen = self._placed(self._middles(t, R), rng, body.has_free_root)
        if body.has_free_root:
            q = q.copy()
            q[ROOT_Q.start : ROOT_Q.start + 3] += shift
        posed, clothes = body.at(q), dressed_at_random(surface, self._grain, rng)
        sun = np.array([*rng.standard_normal(2), rng.uniform(0.3, 2.0)])
        sun, ambient = sun / np.linalg.norm(sun), rng.uniform(*_LIGHT)
        views = tuple(self._view(c, posed, surface, clothes, (sun, ambient), rng) for c in self._cameras)
        return RigExample(views, t + shift, R, seen)

    def _middles(self, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        return np.asarray(t + self._along[:, None] * R[:, :, 2])

    def _placed(self, middles: np.ndarray, rng: np.random.Generator, free: bool) -> tuple[np.ndarray, np.ndarray]:
        """Translation (3,) of limbs with these middles (L, 3), and which of them (L,) all cameras then see."""
        best = np.zeros(3), np.zeros(len(middles), bool)
        for _ in range(_PLACES if free else 1):
            shift = rng.uniform(*self._box) - middles.mean(axis=0) if free else np.zeros(3)
            seen = np.ones(len(middles), bool)
            for camera in self._cameras:
                at = camera.project(middles + shift)
                seen &= ((at > -0.5) & (at < np.array(camera.image_size) - 0.5)).all(axis=1)
            if seen.sum() > best[1].sum():
                best = shift, seen
            if seen.all():
                break
        return best

    def _view(
        self, camera: Camera, posed: PosedBody, surface: Surface, clothes: Clothes, light: tuple[np.ndarray, float],
        rng: np.random.Generator,
    ) -> PatchView:  # fmt: skip
        sun, ambient = light
        places = points_in_world(posed, surface.joint, surface.local)
        normals = directions_in_world(posed, surface.joint, surface.normal)
        shade = ambient + (1.1 - ambient) * np.clip(normals @ sun, 0.0, 1.0)
        width, height = camera.image_size
        image = np.full((height, width, 3), rng.uniform(20.0, 230.0), np.float32)
        nearness = np.zeros((height, width))
        depth = places @ camera.R_camera_world[2] + camera.t_camera_world[2]
        paint_cloth(
            image, nearness, camera.project(places), depth, surface.local, clothes.colour, shade, surface.faces,
            surface.part[surface.faces[:, 0]], clothes.pattern, clothes.grain,
        )  # fmt: skip
        grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (0, 0), rng.uniform(*_BLUR))
        grey = grey + np.float32(rng.uniform(*_NOISE)) * rng.standard_normal(grey.shape, dtype=np.float32)
        return patch_view(camera, grey, _with_background_errors(nearness > 0.0, rng))


def _with_background_errors(mask: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A mask (H, W) bool as if from a background: the outline moved by up to a pixel, with pieces missing or added."""
    noisy = mask.astype(np.uint8)
    block = np.ones((1 + int(rng.integers(2)), 1 + int(rng.integers(2))), np.uint8)
    noisy = np.asarray(cv2.dilate(noisy, block) if rng.random() < 0.5 else cv2.erode(noisy, block), np.uint8)
    rows, columns = np.nonzero(mask)
    for _ in range(int(rng.integers(_SPECKS + 1)) if len(rows) else 0):
        k = int(rng.integers(len(rows)))
        centre = int(columns[k] + rng.integers(-6, 7)), int(rows[k] + rng.integers(-6, 7))
        cv2.circle(noisy, centre, int(rng.integers(1, 4)), int(rng.integers(2)), -1)
    return np.asarray(noisy > 0)
