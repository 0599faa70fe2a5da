"""Templates of limbs for a rig, by painting what its cameras see of a body (Sigal et al., CVPR 2004, section 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.inference.beliefs.space import points_of
from estimator.synthesis.pictures import variants
from estimator.synthesis.poses import PoseSampler
from estimator.synthesis.rig_pictures import RigExample, RigPainter
from estimator.trackers.loose_limbed.limbs.likelihood import LimbSettings, common_box
from estimator.trackers.loose_limbed.part_detectors.templates import LimbTemplate, LimbTemplates
from estimator.vision.eigen_templates import SHARE, eigen_space
from estimator.vision.patches import patches_at, ray_places
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError

SIZE = 2.0
"""Side of a patch by the limb's length, or half the length of the body's longest limb where that is more: the
surroundings of a short limb distinguish it from others."""
SIDE = 8  # samples along it
CONTRAST = 0.45  # of the grey values beside the share of the person: clothes are less informative than outlines
FEWEST = 20  # poses

_VARIANTS = 16
_JITTER = 0.02  # m, standard deviation: examined places are never exactly the middle of a limb
_BACKGROUND, _SPACING = 6, 0.06  # other places of the person for each pose, drawn from a grid of this spacing [m]
_AWAY = 0.12  # m from the middle of a limb: beyond what counts as found
_REACH = 0.4  # m about the limbs' joints
_POSES, _BODIES = range(2)  # what random numbers are for
Report = Callable[[int, int], None]


@dataclass
class _Gathered:
    """The data of a limb and the other side's: indices, side of a patch [m], and training patches."""

    limbs: tuple[int, ...]
    metres: float
    patches: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    elsewhere: list[np.ndarray] = field(default_factory=list)


def train_templates(
    subject: Subject,
    cameras: Sequence[Camera],
    *,
    poses: int = 1500,
    limbs: Sequence[str] = (),
    seed: int = 0,
    progress: Report | None = None,
) -> LimbTemplates:
    """Templates of a subject's limbs for a rig; equal arguments give equal templates.

    limbs: names of those that get one, and the other side's with them; by default all. poses: number of painted poses.
    progress: called with the number of finished ones and of all.

    Raises
    ------
    InputError: nothing of the subject can be painted, an unknown limb, too few poses, cameras that see no place in
    common, or a limb that too few poses show to all of them.
    """
    if poses < FEWEST:
        raise InputError("poses", f"{poses} are too few", remedy=f"{FEWEST} or more")
    graph, body = limb_graph(subject), Body(subject)
    kinds = _kinds(graph, limbs)
    box = common_box(cameras, LimbSettings().farthest, 0.0)
    bodies = variants(subject, _VARIANTS, np.random.default_rng((seed, _BODIES)))
    painter = RigPainter(PoseSampler(body, legs=True), graph, cameras, bodies, box)
    for k in range(poses):
        rng = np.random.default_rng((seed, _POSES, k))
        _gather(painter.example(rng), graph, kinds, rng)
        if progress is not None:
            progress(k + 1, poses)
    learned = tuple(_learned(kind, graph) for kind in kinds)
    centre, R = np.array([c.centre_world for c in cameras]), np.array([c.R_camera_world for c in cameras])
    margin = LimbSettings().margin
    wider = np.stack([box[0] - margin, box[1] + margin])
    return LimbTemplates(tuple(c.name for c in cameras), centre, R, wider, SIDE, CONTRAST, learned)


def _kinds(graph: LimbGraph, names: Sequence[str]) -> list[_Gathered]:
    """Limbs with those of the other side, each pair once."""
    wanted = {graph.index(name) for name in names} or set(range(len(graph.limbs)))
    pairs = sorted({tuple(sorted({k, graph.mirror[k]})) for k in wanted})
    least = 0.5 * max(limb.length for limb in graph.limbs)
    return [_Gathered(pair, SIZE * max(least, *(graph.limbs[k].length for k in pair))) for pair in pairs]


def _gather(example: RigExample, graph: LimbGraph, kinds: Sequence[_Gathered], rng: np.random.Generator) -> None:
    """Add the patches of an example: at its limbs, and at other places of the person."""
    middles = np.array([middle_of(limb, *at) for limb, *at in zip(graph.limbs, example.t, example.R, strict=True)])
    reach = np.stack([example.t.min(axis=0) - _REACH, example.t.max(axis=0) + _REACH])
    others = ray_places(example.views, reach, _SPACING)
    others = others[rng.permutation(len(others))[:_BACKGROUND]]
    for kind in kinds:
        shown = [k for k in kind.limbs if example.seen[k]]
        places = middles[shown] + _JITTER * rng.standard_normal((len(shown), 3))
        kind.patches.append(patches_at(example.views, places, kind.metres, SIDE, CONTRAST))
        kind.points.append(points_of(example.t[shown] - places, example.R[shown]))
        away = np.linalg.norm(others[:, None] - middles[list(kind.limbs)], axis=2).min(axis=1)
        kind.elsewhere.append(patches_at(example.views, others[away > _AWAY], kind.metres, SIDE, CONTRAST))


def middle_of(limb: Limb, t: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Middle (3,) [m] of a limb at t (3,), R (3, 3)."""
    return np.asarray(t + 0.5 * limb.length * R[:, 2])


def _learned(kind: _Gathered, graph: LimbGraph) -> LimbTemplate:
    names = tuple(graph.names[k] for k in kind.limbs)
    patches, points, other = (np.concatenate(part) for part in (kind.patches, kind.points, kind.elsewhere))
    if min(len(patches), len(other)) < FEWEST:
        problem = f"{names[0]} is seen by all of them in {len(patches)} poses"
        raise InputError("cameras", problem, remedy="more poses, limbs without it, or cameras that see more in common")
    space, elsewhere = eigen_space(patches, SHARE), eigen_space(other, SHARE)
    ratio = space.log_density(patches) - elsewhere.log_density(patches)
    deviation = np.maximum([ratio.std(), space.residual(patches).std()], 1e-3)
    return LimbTemplate(
        names, kind.metres, space, elsewhere, deviation, space.coefficients(patches), points[:, :3], points[:, 3:]
    )
