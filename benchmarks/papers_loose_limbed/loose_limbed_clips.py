"""Captured motion before four cameras, in memory: what the loose-limbed tracker is measured on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.synthesis.clothing import Clothes, Garment, dressed
from estimator.synthesis.detector import keypoints
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.plate import place_of
from estimator.synthesis.render import Renderer
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.vision.cues.foreground import Background, SilhouetteSettings, foreground_mask, silhouette_of
from humanoid.kinematics.body import Body, points_in_world
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import load_subject

FPS = 30.0
_SPREAD = 2.0  # grey values of the picture of the empty scene
_CLOTHED = ("pelvis", "thigh", "shank", "torso", "upper_arm", "forearm", "")
"""Endings of the links that are dressed in the wall's colour where contrast is low."""


@dataclass(frozen=True)
class LimbClip:
    """human34 in a captured motion, rendered as requested.

    motion: BVH file; None for a person who reaches and turns. seed: of room, clothes and noise. low_contrast: shirt
    and trousers are of the wall's colour. count: of cameras, all around. begin, end: frames that are used, of those at
    `FPS`.
    """

    motion: Path | None
    seed: int
    begin: int
    end: int
    low_contrast: bool = False
    count: int = 4

    @cached_property
    def body(self) -> Body:
        """Who is in the pictures, and is tracked."""
        return Body(load_subject("human34"))

    @cached_property
    def graph(self) -> LimbGraph:
        """Its ten limbs."""
        return limb_graph(self.body)

    @cached_property
    def q(self) -> np.ndarray:
        """The true poses of all frames (T, nq)."""
        if self.motion is None:
            return authored_motion(self.body, np.arange(self.end) / FPS)
        mocap = load_mocap(self.motion)
        return retarget(self.body, mocap, np.arange(0.0, min(mocap.seconds, self.end / FPS), 1.0 / FPS)).q

    @cached_property
    def renderer(self) -> Renderer:
        """Room and person."""
        surface = surface_of(self.body, nodes=500)
        points = np.array(
            [points_in_world(self.body.at(q), surface.joint, surface.local) for q in self.q[self.begin :]]
        )
        cameras, place = framing_cameras(points, ViewSettings(self.count)), place_of(points)
        scene = SceneSettings("room")
        made = Renderer(self.body, cameras, np.random.default_rng((self.seed, 1)), scene, place)
        if not self.low_contrast:
            return made
        wall = np.median(np.concatenate([made.plate(c).reshape(-1, 3) for c in range(len(cameras))]), axis=0)
        garment = Garment((float(wall[0]), float(wall[1]), float(wall[2])), 0.05, 0.04)

        def like_the_wall(surface: Surface, rng: np.random.Generator) -> Clothes:
            return dressed(surface, rng, dict.fromkeys(_CLOTHED, garment))

        return Renderer(self.body, cameras, np.random.default_rng((self.seed, 1)), scene, place, like_the_wall)

    @cached_property
    def _scenes(self) -> list[Background]:
        plates = [self.renderer.plate(c).astype(np.float32) for c in range(self.count)]
        return [Background(p, np.full_like(p, _SPREAD), np.ones(p.shape[:2], dtype=bool)) for p in plates]

    @cached_property
    def _tracks(self) -> list[np.ndarray]:
        """Keypoints by camera (T, L, 2), as a detector would give them."""
        rng = np.random.default_rng((self.seed, 2))
        names = self.body.landmark_names
        arrays = []
        for track in keypoints(self.body, self.q, self.renderer.cameras, rng, fps=FPS):
            pixels = np.full((len(self.q), len(names), 2), np.nan)
            for k, name in enumerate(track.names):
                if name in names:
                    pixels[:, names.index(name)] = track.pixels[:, k]
            arrays.append(pixels)
        return arrays

    def observation(self, frame: int, *, blank: bool = False, detected: bool = False) -> Observation:
        """A frame with its pictures. blank: without the person. detected: with keypoints."""
        cues = tuple(self._cues(frame, c, blank) for c in range(self.count))
        pixels = np.full((self.count, len(self.body.landmark_names), 2), np.nan)
        if detected and not blank:
            pixels = np.stack([track[frame] for track in self._tracks])
        confidence = np.isfinite(pixels).all(axis=2).astype(float)
        return Observation(frame, frame / FPS, tuple(self.renderer.cameras), pixels, confidence, cues=cues)

    def _cues(self, frame: int, camera: int, blank: bool) -> ImageCues:
        rng = np.random.default_rng((self.seed, 3, frame, camera))
        if blank:
            picture = self.renderer.plate(camera)
        else:
            picture = self.renderer.frame(self.body.at(self.q[frame]), camera, rng)
        scene = self._scenes[camera]
        mask = foreground_mask(picture, scene, SilhouetteSettings())
        silhouette = silhouette_of(mask, scene.known)
        return ImageCues(self.renderer.cameras[camera], {"silhouette": silhouette}, picture)


@dataclass(frozen=True, eq=False)
class Markers:
    """Where limbs join and end: proximal joints (L), then the ends of limbs that nothing follows; 15 of ten limbs.

    limb (M,) int: whose they are. along (M,): how far along its axis [m].
    """

    limb: np.ndarray
    along: np.ndarray

    @staticmethod
    def of(graph: LimbGraph) -> Markers:
        """The markers of a graph."""
        size = len(graph.limbs)
        ends = [k for k in range(size) if sum(k in edge for edge in graph.edges) == 1]
        along = [0.0] * size + [graph.limbs[k].length for k in ends]
        return Markers(np.array([*range(size), *ends]), np.array(along))

    def places(self, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Places (..., M, 3) [m] of limbs at t (..., L, 3), R (..., L, 3, 3)."""
        return np.asarray(t[..., self.limb, :] + self.along[:, None] * R[..., 2][..., self.limb, :])

    def of_poses(self, graph: LimbGraph, body: Body, q: np.ndarray) -> np.ndarray:
        """Places (..., M, 3) [m] in poses q (nq,) or (N, nq)."""
        return self.places(*limb_placements(graph, body, q))

    def expected_error(self, true: np.ndarray, t: np.ndarray, R: np.ndarray, weight: np.ndarray) -> float:
        """Expected absolute distance [mm], mean of the markers (section 6 of Sigal et al. 2004): true (M, 3); samples t
        (N, L, 3), R (N, L, 3, 3) with weights (N, L) of each limb."""
        away = np.linalg.norm(self.places(t, R) - true, axis=2)
        return float(1e3 * (weight[:, self.limb] * away).sum(axis=0).mean())
