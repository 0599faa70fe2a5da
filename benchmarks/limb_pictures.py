"""Pictures of limbs whose poses are known, and poses at which there are none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.cues.silhouette.foreground import Background, SilhouetteSettings, foreground_mask
from estimator.limbs.likelihood import LimbView, limb_view
from estimator.limbs.volume import common_box
from estimator.synthesis import Renderer, SceneSettings, ViewSettings, framing_cameras
from estimator.synthesis.clothing import Clothes, dressed_at_random, periodic_noise
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.plate import place_of
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import Surface, surface_of

_STEP = 1.0 / 15.0  # s between the frames that a captured motion is followed by
_SPREAD = 2.0  # grey values of the picture of the empty scene
_SEED = 1404  # of rooms and clothes; no clip of another measure has them


@dataclass(frozen=True)
class Cone:
    """A limb as the likelihood takes it (`estimator.limbs.features.LimbShape`), and where it is fixed: R_link_limb
    (3, 3), t_link_limb (3,) [m] in the frame of a link."""

    name: str
    link: str
    t_link_limb: np.ndarray
    R_link_limb: np.ndarray
    start: float
    end: float
    proximal: tuple[float, float]
    distal: tuple[float, float]


class Shown(NamedTuple):
    """An instant: its views, and the limbs' true poses t (L, 3), R (L, 3, 3)."""

    views: list[LimbView]
    t: np.ndarray
    R: np.ndarray


def cones_of(body: Body) -> list[Cone]:
    """The ten limbs of a person, by hand."""
    up, down = np.eye(3), np.diag([1.0, -1.0, -1.0])
    made = [
        Cone("torso", "torso", np.zeros(3), up, -0.24, 0.42, (0.118, 0.15), (0.105, 0.15)),
        Cone("head", "head", np.array([0.01, 0.0, -0.1]), up, 0.0, 0.22, (0.085, 0.068), (0.08, 0.065)),
    ]
    sizes = {
        "upper_arm": (0.0, 0.27, (0.052, 0.05), (0.043, 0.041)), "forearm": (0.0, 0.25, (0.043, 0.043), (0.031, 0.031)),
        "thigh": (0.0, 0.40, (0.098, 0.09), (0.062, 0.058)), "shank": (0.0, 0.38, (0.057, 0.055), (0.04, 0.04)),
    }  # fmt: skip
    for side in ("left", "right"):
        made += [Cone(f"{side}_{n}", f"{side}_{n}", np.zeros(3), down, *size) for n, size in sizes.items()]
    return made


def placements(body: Body, limbs: Sequence[Cone], q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses t (L, 3), R (L, 3, 3) of the limbs of a body at a configuration (nq,)."""
    posed, places = body.at(q), []
    for limb in limbs:
        frame = body.model.frames[body.model.getFrameId(limb.link)]
        R_world, t_world = posed.rotations[frame.parentJoint], posed.translations[frame.parentJoint]
        t = R_world @ (frame.placement.rotation @ limb.t_link_limb + frame.placement.translation) + t_world
        places.append((t, R_world @ frame.placement.rotation @ limb.R_link_limb))
    t, R = zip(*places, strict=True)
    return np.array(t), np.array(R)


def shown_clip(
    body: Body, limbs: Sequence[Cone], path: Path, frames: int, seed: int, cameras: int = 4
) -> Iterator[Shown]:
    """Some frames of a captured motion, spread evenly, in a room, light and clothes drawn from `seed`.

    One in three clips has something before its first camera; the foreground is told from a picture of the empty scene.
    """
    rng = np.random.default_rng((_SEED, seed))
    mocap = load_mocap(path)
    q = retarget(body, mocap, np.arange(0.0, mocap.seconds, _STEP)).q
    q = q[np.linspace(0, len(q) - 1, frames).astype(int)]
    surface = surface_of(body, nodes=500)
    points = np.array([points_in_world(body.at(pose), surface.joint, surface.local) for pose in q])
    view = ViewSettings(cameras, float(rng.uniform(-180, 180)), float(rng.uniform(0, 20)), float(rng.uniform(0.5, 0.8)))
    seen_by, place = framing_cameras(points, view), place_of(points, 0.0)
    scene = SceneSettings(
        "room", float(rng.uniform(-180, 180)), float(rng.uniform(30, 80)), ambient=float(rng.uniform(0.3, 0.7)),
        lens_blur=float(rng.uniform(0, 1.2)), noise=float(rng.uniform(1, 4)),
        occluder=("none", "none", "post", "box")[int(rng.integers(4))],
    )  # fmt: skip

    def dress(surface: Surface, rng: np.random.Generator) -> Clothes:
        return dressed_at_random(surface, periodic_noise(rng), rng)

    renderer = Renderer(body, seen_by, rng, scene, place, dress)
    plates = [renderer.plate(c).astype(np.float32) for c in range(len(seen_by))]
    scenes = [Background(p, np.full_like(p, _SPREAD), np.ones(p.shape[:2], bool)) for p in plates]
    for pose in q:
        views = []
        for c, camera in enumerate(seen_by):
            picture = renderer.frame(body.at(pose), c, rng)
            views.append(limb_view(camera, picture, foreground_mask(picture, scenes[c], SilhouetteSettings())))
        yield Shown(views, *placements(body, limbs, pose))


def jittered(
    rng: np.random.Generator, t: np.ndarray, R: np.ndarray, metres: float, radians: float
) -> tuple[np.ndarray, np.ndarray]:
    """Poses t (N, 3), R (N, 3, 3) moved and turned by normal deviates."""
    turned = R @ Rotation.from_rotvec(radians * rng.standard_normal((len(t), 3))).as_matrix()
    return t + metres * rng.standard_normal((len(t), 3)), turned


def moved_away(rng: np.random.Generator, t: np.ndarray, count: int, near: float, far: float) -> np.ndarray:
    """Places (N, 3) in all directions from t (3,), evenly many at each distance from near to far [m]."""
    way = rng.standard_normal((count, 3))
    return np.asarray(t + rng.uniform(near, far, (count, 1)) * way / np.linalg.norm(way, axis=1, keepdims=True))


def turned_away(rng: np.random.Generator, R: np.ndarray, count: int, least: float) -> np.ndarray:
    """Rotations (N, 3, 3) whose z axis is turned from that of R (3, 3) by `least` [rad] to half a turn."""
    about = rng.uniform(0.0, 2.0 * np.pi, count)
    angle = rng.uniform(least, np.pi, count)
    axis = np.stack([np.cos(about), np.sin(about), np.zeros(count)], axis=1)
    return np.asarray(R @ Rotation.from_rotvec(angle[:, None] * axis).as_matrix())


def nowhere(
    rng: np.random.Generator, shown: Shown, count: int, near: float, far: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which limb (N,), at which poses t (N, 3), R (N, 3, 3) where it is not: a third by other limbs' places about the
    person as they lie, a third turned at random, a third anywhere in the cameras' common volume."""
    limb = rng.integers(len(shown.t), size=count)
    t = np.array([moved_away(rng, shown.t[i], 1, near, far)[0] for i in limb])
    R = shown.R[limb]
    low, high = common_box([v.camera for v in shown.views], 12.0, 0.0)
    anywhere, turned = np.arange(count) % 3 == 2, np.arange(count) % 3 > 0
    t[anywhere] = rng.uniform(low, high, (int(anywhere.sum()), 3))
    R[turned] = Rotation.random(int(turned.sum()), random_state=rng).as_matrix()
    return limb, t, R
