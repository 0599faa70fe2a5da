"""A captured motion on a subject: configurations whose landmarks follow it, within the joints' limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import CompiledSeeker
from estimator.energy.descent.seek import SeekSettings
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.point_targets import PointTargets
from estimator.energy.priors import Stabilisers, Transition
from estimator.energy.term import Term
from estimator.numerics.alignment import similarity_onto
from estimator.search.cost_model import per_dof
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.mocap import Mocap
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_Q, Body
from humanoid.support.errors import InputError

_SIGMA = {"hip": 0.015, "toe": 0.03, "shoulder": 0.03, "top": 0.03}  # [m] of a landmark from its target
_SIGMA_ELSE = 0.015
_STABILISERS = 0.1  # weight of the rest positions: they decide what the landmarks leave open
_SMOOTHING = 0.02  # [s] standard deviation of the filter along time
_CLEARANCE_SCALE = 0.005  # [m], see `Interpenetration`
_LIMBS = (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"), ("shoulder", "elbow"), ("elbow", "wrist"))
_TRUNK = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")
_TOE = {"left_toe": "left_big_toe", "right_toe": "right_big_toe"}  # the subject's landmark where the names differ


class Retargeted(NamedTuple):
    """q (T, nq); names (L), targets (T, L, 3) [m] and residual (T, L) [m] of the subject's landmarks from them."""

    q: np.ndarray
    names: tuple[str, ...]
    targets: np.ndarray
    residual: np.ndarray


def retarget(body: Body, mocap: Mocap, times: np.ndarray) -> Retargeted:
    """Configurations (T, nq) of a free body that follow a captured motion at `times` (T,) [s], evenly spaced.

    The targets are the captured landmarks rebuilt with the subject's own lengths: the hips' path is scaled by the
    ratio of the legs, limbs keep their directions. Each frame is a minimum of the squared distances to them with the
    stabilisers, the repulsion of parts and a pull to the frame before; the result is smoothed along time.

    Raises
    ------
    InputError: the body's base is fixed, or it lacks one of the landmarks.
    """
    names = tuple(name for name in mocap.names if name != "head_base")
    index = _landmark_index(body, names)
    rest = body.landmarks(body.at(body.neutral))[index]
    targets = _targets(dict(zip(names, rest, strict=True)), mocap, times)
    points = np.stack([targets[name] for name in names], axis=1)
    dt = float(times[1] - times[0]) if len(times) > 1 else 1.0
    q = _smoothed(body, _followed(body, index, names, points, dt), dt)
    reached = np.array([body.landmarks(body.at(pose))[index] for pose in q])
    return Retargeted(q, names, points, np.linalg.norm(reached - points, axis=2))


def _landmark_index(body: Body, names: tuple[str, ...]) -> list[int]:
    wanted = [_TOE.get(name, name) for name in names]
    missing = [name for name in wanted if name not in body.landmark_names]
    if missing or not body.has_free_root:
        problem = f"has no landmark {', '.join(missing)}" if missing else "has a fixed base"
        raise InputError(body.subject.source, problem, remedy="captured motions need a whole person, such as human34")
    return [body.landmark_names.index(name) for name in wanted]


def _targets(rest: dict[str, np.ndarray], mocap: Mocap, times: np.ndarray) -> dict[str, np.ndarray]:
    """Targets (T, 3) [m] by landmark; rest: the subject's landmarks (3,) standing."""
    own = dict(zip(mocap.names, mocap.at(times).transpose(1, 0, 2), strict=True))
    legs = (("hip", "knee"), ("knee", "ankle"))
    scale = _length(rest, legs) / _length(own, legs)
    hips, shoulders = (_middle(own, name) for name in ("hip", "shoulder"))
    root = scale * hips
    chest = root + (shoulders - hips) * _ratio(_middle(rest, "shoulder") - _middle(rest, "hip"), shoulders - hips)
    placed = {}
    for name, middle, place in (("hip", hips, root), ("shoulder", shoulders, chest)):
        width = np.linalg.norm(rest[f"left_{name}"] - rest[f"right_{name}"])
        width /= np.linalg.norm(own[f"left_{name}"] - own[f"right_{name}"], axis=-1).mean()
        for side in ("left_", "right_"):
            placed[side + name] = place + width * (own[side + name] - middle)
    for above, below in _LIMBS:
        for side in ("left_", "right_"):
            bone = own[side + below] - own[side + above]
            length = np.linalg.norm(rest[side + below] - rest[side + above])
            placed[side + below] = placed[side + above] + length * bone / np.linalg.norm(bone, axis=-1, keepdims=True)
    head = own["head_top"] - shoulders
    placed["head_top"] = chest + head * _ratio(rest["head_top"] - _middle(rest, "shoulder"), head)
    return placed


def _middle(points: dict[str, np.ndarray], name: str) -> np.ndarray:
    return 0.5 * (points[f"left_{name}"] + points[f"right_{name}"])


def _length(points: dict[str, np.ndarray], bones: tuple[tuple[str, str], ...]) -> float:
    """Mean length of a chain of bones, both sides and all times together."""
    sides = [sum(np.linalg.norm(points[s + a] - points[s + b], axis=-1) for a, b in bones) for s in ("left_", "right_")]
    return float(np.mean(sides))


def _ratio(rest: np.ndarray, moving: np.ndarray) -> float:
    """Length of a straight trunk or neck over the moving one's when it is straight, too."""
    return float(np.linalg.norm(rest) / np.percentile(np.linalg.norm(moving, axis=-1), 90.0))


def _followed(body: Body, index: list[int], names: tuple[str, ...], points: np.ndarray, dt: float) -> np.ndarray:
    """Configurations (T, nq), each searched from the one before."""
    sigma = np.array([_SIGMA.get(name.split("_")[-1], _SIGMA_ELSE) for name in names])
    precision = np.eye(3) / np.square(sigma)[:, None, None]
    joint, local = body.landmark_joint[index], body.landmark_local[index]
    settings = CostSettings()
    std = dt * per_dof(body, settings.turn_speed, settings.root_turn_speed, settings.root_slide_speed)
    self_collision = SelfCollision(body)
    always: list[Term] = [Stabilisers(body, _STABILISERS)]
    if self_collision.pairs:
        always.append(Interpenetration(self_collision, _CLEARANCE_SCALE))
    seeker = CompiledSeeker(body, SeekSettings(decrease_tolerance=1e-4))
    trunk = [names.index(name) for name in _TRUNK]
    q = _aligned(body, [index[i] for i in trunk], points[0, trunk])
    poses = []
    for t, targets in enumerate(points):
        terms: list[Term] = [PointTargets(body, joint, local, targets, precision), *always]
        if t > 0:
            terms.append(Transition(body, q, std))
        q = seeker.seek(Cost(body, terms), q).q
        poses.append(q)
    return np.array(poses)


def _aligned(body: Body, index: list[int], targets: np.ndarray) -> np.ndarray:
    """The neutral pose with its root placed so that some landmarks (K) fit their targets (K, 3) [m]."""
    q = body.neutral.copy()
    own = body.landmarks(body.at(q))[index]
    moved = similarity_onto(own, targets)
    T_world_root = pin.SE3(moved.R, moved.t) * pin.XYZQUATToSE3(q[ROOT_Q])
    q[ROOT_Q] = pin.SE3ToXYZQUAT(T_world_root)
    return q


def _smoothed(body: Body, q: np.ndarray, dt: float) -> np.ndarray:
    """A Gaussian average along time in the tangent space of each frame, inside the limits."""
    reach = int(np.ceil(3.0 * _SMOOTHING / dt))
    weight = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) * dt / _SMOOTHING))
    smooth = []
    for t, pose in enumerate(q):
        step, total = np.zeros(body.nv), 0.0
        for k, w in zip(range(t - reach, t + reach + 1), weight, strict=True):
            if 0 <= k < len(q):
                step, total = step + w * body.difference(pose, q[k]), total + w
        smooth.append(body.integrate(pose, step / total))
    return np.array(smooth)
