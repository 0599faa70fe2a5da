"""Pictures of limbs whose poses are known, and poses at which there are none."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.synthesis.clothing import Clothes, dressed_at_random, periodic_noise
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.pictures import variants
from estimator.synthesis.plate import place_of
from estimator.synthesis.render import Renderer
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.trackers.loose_limbed.limbs.likelihood import LimbView, common_box, limb_view
from estimator.vision.cues.foreground import Background, SilhouetteSettings, foreground_mask
from humanoid.kinematics.body import Body, points_in_world
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import Limb, LimbGraph, limb_placements
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import Subject

_STEP = 1.0 / 15.0  # s between the frames that a captured motion is followed by
_SPREAD = 2.0  # grey values of the picture of the empty scene
_SEED = 1404  # of rooms and clothes; no clip of another measure has them


class Shown(NamedTuple):
    """An instant: its views, the limbs (L) of the people in them, their true poses t (L, 3), R (L, 3, 3), the body and
    its pose q (nq,), and the pictures (H, W, 3) uint8 BGR of the views."""

    views: list[LimbView]
    limbs: tuple[Limb, ...]
    t: np.ndarray
    R: np.ndarray
    body: Body
    q: np.ndarray
    pictures: list[np.ndarray]


def all_limbs(subject: Subject) -> LimbGraph:
    """The ten limbs of the paper, and of the finer graph those that differ from them; the edges are the paper's."""
    graph, finer = limb_graph(subject, "paper"), limb_graph(subject, "fine")
    known = {(limb.name, limb.start, limb.end) for limb in graph.limbs}
    more = [k for k, limb in enumerate(finer.limbs) if (limb.name, limb.start, limb.end) not in known]
    mirror = [len(graph.limbs) + more.index(finer.mirror[k]) for k in more]
    return LimbGraph((*graph.limbs, *(finer.limbs[k] for k in more)), graph.edges, (*graph.mirror, *mirror))


def shown_clip(subject: Subject, path: Path, frames: int, seed: int, cameras: int = 4) -> Iterator[Shown]:
    """Some frames of a captured motion, spread evenly, of a person of random lengths and girth, in a room, light and
    clothes drawn from `seed`.

    Half of the clips have a post or a box before their first camera, and limbs hide each other; the foreground is given
    from a picture of the empty scene.
    """
    rng = np.random.default_rng((_SEED, seed))
    body = variants(subject, 1, rng)[0].body
    graph, mocap = all_limbs(body.subject), load_mocap(path)
    q = retarget(body, mocap, np.arange(0.0, mocap.seconds, _STEP)).q
    q = q[np.linspace(0, len(q) - 1, frames).astype(int)]
    surface = surface_of(body, nodes=500)
    points = np.array([points_in_world(body.at(pose), surface.joint, surface.local) for pose in q])
    view = ViewSettings(cameras, float(rng.uniform(-180, 180)), float(rng.uniform(0, 20)), float(rng.uniform(0.5, 0.8)))
    seen_by, place = framing_cameras(points, view), place_of(points)
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
        views, pictures = [], []
        for c, camera in enumerate(seen_by):
            picture = renderer.frame(body.at(pose), c, rng)
            pictures.append(picture)
            views.append(limb_view(camera, picture, foreground_mask(picture, scenes[c], SilhouetteSettings())))
        yield Shown(views, graph.limbs, *limb_placements(graph, body, pose), body, pose, pictures)


def jittered(
    rng: np.random.Generator, t: np.ndarray, R: np.ndarray, count: int, metres: float, radians: float
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, 3), (N, 3, 3) that differ from t (3,), R (3, 3) by normal deviates."""
    turned = R @ Rotation.from_rotvec(radians * rng.standard_normal((count, 3))).as_matrix()
    return t + metres * rng.standard_normal((count, 3)), turned


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
    person in place, a third turned at random, a third anywhere in the cameras' common volume."""
    limb = rng.integers(len(shown.t), size=count)
    t = np.array([moved_away(rng, shown.t[i], 1, near, far)[0] for i in limb])
    R = shown.R[limb]
    low, high = common_box([v.camera for v in shown.views], 12.0, 0.0)
    anywhere, turned = np.arange(count) % 3 == 2, np.arange(count) % 3 > 0
    t[anywhere] = rng.uniform(low, high, (int(anywhere.sum()), 3))
    R[turned] = Rotation.random(int(turned.sum()), random_state=rng).as_matrix()
    return limb, t, R
