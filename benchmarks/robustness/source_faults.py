"""Faults of motions that a person or a robot is to follow: landmarks with names, and joints in SMPL's order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import kinemode as km
from benchmarks.robustness.fault_verdicts import Result, Trial
from benchmarks.robustness.floor_scenes import FPS
from benchmarks.robustness.place_faults import (
    Fault,
    Places,
    elsewhere_at_first,
    frozen,
    gap_filled,
    labels_permuted,
    legs_missing,
    pictures_twice,
    sides_exchanged,
    turned_over,
    with_fault,
    zeros,
)
from benchmarks.robustness.point_faults import millimetres, noisy_points
from estimator.retargeting.correspondence import PERSON_LIMBS
from estimator.retargeting.joint_orders import ORDERS, SMPL
from estimator.retargeting.likeness import limb_angles
from estimator.retargeting.source import SourceMotion
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body

SUBJECTS = ("human34", "example-robot-data:g1")
_SAME = {"head": "head_top"}  # what the person has for a joint of SMPL
_LIMBS = (("elbow", "wrist"), ("knee", "ankle", "heel", "toe"))


def mirrored(rng: np.random.Generator, places: Places) -> None:
    """By axes that are left-handed."""
    places.at[..., int(rng.integers(2))] *= -1.0


def limb_leaps(rng: np.random.Generator, places: Places) -> None:
    """A forearm or a leg is elsewhere for some frames."""
    side, parts = ("left_", "right_")[int(rng.integers(2))], _LIMBS[int(rng.integers(2))]
    limb = [i for i, name in enumerate(places.names) if name.startswith(side) and name.endswith(parts)]
    first = int(rng.integers(2, len(places.at) - 6))
    away = rng.normal(size=3)
    frames = np.arange(first, first + int(rng.integers(1, 6)))
    places.at[frames[:, None], limb] += away / np.linalg.norm(away) * rng.uniform(0.5, 1.5)


FAULTS: tuple[Fault, ...] = (
    zeros,
    gap_filled,
    elsewhere_at_first,
    pictures_twice,
    frozen,
    mirrored,
    sides_exchanged,
    labels_permuted,
    legs_missing,
    millimetres,
    turned_over,
    limb_leaps,
)


def trial(body: Body, q: np.ndarray, fault: Fault, rng: np.random.Generator) -> Trial:
    """One fault of the landmarks of q (T, nq), or of joints in SMPL's order, which a person or a robot follows."""
    places, subject = noisy_points(body, q, rng), SUBJECTS[int(rng.integers(2))]
    places = places if rng.random() < 0.5 else _smpl(places)
    wrong, up = with_fault(places, fault, rng), None if fault is turned_over else "z"
    return Trial(
        f"{'joints' if '' in places.names else 'landmarks'} for {subject.split(':')[-1]}",
        lambda folder: _followed(subject, places, places, "z", folder),
        lambda folder: _followed(subject, places, wrong, up, folder),
    )


def _followed(subject: str, truth: Places, places: Places, up: str | None, folder: Path) -> Result:
    """Options as a user would give them, with the up axis unless that is the fault; angles are those of limbs."""
    path = folder / "source.npz"
    if "" in places.names:
        np.savez(path, joints=places.at, fps=FPS)
    else:
        np.savez(path, points=places.at, names=np.array(places.names), fps=FPS, unit="m")
    run = km.retarget(path, subject, up=up)
    landmarks = run.landmarks if up is not None else _facing(run, _motion(truth))
    angles, given = (limb_angles(run.body, landmarks, _motion(p), PERSON_LIMBS) for p in (truth, places))
    return Result.of(run, angles, np.isfinite(given).any(axis=0), len(truth.at))


def _facing(run: Run, truth: SourceMotion) -> np.ndarray:
    """The run's landmarks (T, L, 3) turned about z to face as the truth does: a turned file does not declare it."""
    names = [name for name in run.body.landmark_names if name in truth.names]
    own = run.landmarks[:, [run.body.landmark_names.index(name) for name in names], :2]
    other = np.stack([truth.landmark(name) for name in names], axis=1)[..., :2]
    own, other = (points - points.mean(axis=1, keepdims=True) for points in (own, other))
    angle = np.arctan2(np.nansum(own[..., 0] * other[..., 1] - own[..., 1] * other[..., 0]), np.nansum(own * other))
    return np.asarray(run.landmarks @ Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix().T)


def _motion(places: Places) -> SourceMotion:
    """Those that are landmarks."""
    kept = [i for i, name in enumerate(places.names) if name]
    names = tuple(_SAME.get(places.names[i], places.names[i]) for i in kept)
    return SourceMotion(names, places.at[:, kept], np.arange(len(places.at)) / FPS, "source.npz")


def _smpl(places: Places) -> Places:
    """In SMPL's order; joints that the person has not are at the middle of the hips."""
    at = dict(zip(places.names, places.at.swapaxes(0, 1), strict=True))
    at[""] = 0.5 * (at["left_hip"] + at["right_hip"])
    names = tuple(name or "" for name in ORDERS[SMPL])
    return Places(np.stack([at[_SAME.get(name, name)] for name in names], axis=1), names)
