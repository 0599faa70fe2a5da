"""A pose prior from captured motion: poses of a body, thinned, and a mixture of mirrored Gaussians fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import logsumexp

from benchmarks.support.pose_prior_clips import subject_of
from benchmarks.training.captured_legs import Legs, corrected
from estimator.energy.pose_prior import PoseMixture, joint_axes
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body

FPS = 30.0
POINT_STD = 0.02  # [m] of a captured landmark about the body's own
# [m]; skeletons do not agree where these are, and are off by the same in every frame
VAGUE_STD = {"shoulder": 0.05, "toe": 0.05, "top": 0.05}
ROOT_PRECISION = 1e-3  # the captured landmarks place the root; this only keeps the matrix regular
ZERO_STD = 0.07  # [rad] of a joint's zero: by so much two skeletons, or two models, of one person differ
POOR_FIT = 0.1  # [m] of a landmark from its target: the body cannot take this pose, as a limit or a wrong start has it
FIRST_STD = 0.2  # [rad] of every component in every joint before the first iteration: poses go to the nearest seed
ITERATIONS = 60
LEFT_OUT = ("lumbar_flexion",)
"""Joints whose angles are not kept: captured skeletons have their own way to share a bend between back and hips, and no
landmark determines the pelvis' tilt."""


@dataclass(frozen=True)
class LearnSettings:
    """Settings of learning a mixture.

    pairs: Gaussians, each with its mirror image. person_poses: so many poses of a person at most, drawn at random, so
    so that people with much data do not dominate. spacing [rad]: poses of a clip nearer to each other
    than this, root mean square over the joints, count once, so that standing still weighs no more than moving.
    prior_count: as many poses with the covariance of all are added to each Gaussian. background: share of poses that
    none explains. starts: random starts, the best likelihood wins.
    """

    pairs: int = 8
    person_poses: int = 150
    spacing: float = 0.07
    prior_count: float = 100.0
    background: float = 0.2
    starts: int = 1


@dataclass(frozen=True)
class Poses:
    """Joint angles (N, D) [rad] and their uncertainty (N, D, D), what the captured landmarks leave open."""

    angles: np.ndarray
    uncertainty: np.ndarray


def joints_of(body: Body) -> tuple[str, ...]:
    """Its joints with one angle, in q's order."""
    model = body.model
    return tuple(model.names[j] for j in range(1, body.njoints) if model.nqs[j] == 1)


def mirror_of(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """The other side's joint (D,) and the sign (D,) of its angle, see `PoseMixture`.

    Equal angles left and right mirror each other. Of the middle joints an axis across the body turns the mirror image
    the same way, the others turn it back.
    """
    names = joints_of(body)
    swap = {"left_": "right_", "right_": "left_"}
    other = np.array([
        names.index(next((swap[s] + n.removeprefix(s) for s in swap if n.startswith(s)), n)) for n in names
    ])  # fmt: skip
    across = np.abs(joint_axes(body, names)[:, 1]) > 0.5
    return other, np.where((other != np.arange(len(names))) | across, 1.0, -1.0)


def captured_motion(body: Body, path: Path, fps: float) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of a captured motion's landmarks, and the motion on the body, (T, nq), without the poses that it cannot
    take."""
    mocap = load_mocap(path)
    followed = retarget(body, mocap, np.arange(0.0, mocap.seconds, 1.0 / fps))
    firm = [i for i, name in enumerate(followed.names) if name.split("_")[-1] not in VAGUE_STD]
    return followed.names, followed.q[followed.residual[:, firm].max(axis=1) < POOR_FIT]


def captured_poses(body: Body, path: Path, spacing: float) -> Poses:
    """A captured motion on the body with corrected legs, thinned, without the poses that it cannot take."""
    names, motion = captured_motion(body, path, FPS)
    first = body.nq - len(joints_of(body))
    poses: list[np.ndarray] = []
    for q in motion:
        if all(np.sqrt(np.mean(np.square(q[first:] - k[first:]))) > spacing for k in poses):
            poses.append(q)
    index = [body.landmark_names.index({"left_toe": "left_big_toe", "right_toe": "right_big_toe"}.get(n, n))
             for n in names]  # fmt: skip
    angles = corrected(subject_of(path.stem), np.array(poses)[:, first:], Legs.among(joints_of(body)))
    return Poses(angles, np.array([_uncertainty(body, q, index) for q in poses]))


def _uncertainty(body: Body, q: np.ndarray, index: list[int]) -> np.ndarray:
    """Covariance (D, D) of the joints given the captured landmarks and the stabilisers, and of their zeros: without it,
    joints that no landmark determines, such as the neck's turn, would seem to be still."""
    std_of = [VAGUE_STD.get(body.landmark_names[k].split("_")[-1], POINT_STD) for k in index]
    J = (body.landmark_jacobians(body.at(q))[index] / np.array(std_of)[:, None, None]).reshape(-1, body.nv)
    count = len(joints_of(body))
    std = {s.joint: s.moments[1] for s in body.subject.stabilisers}
    prior = np.full(body.nv, ROOT_PRECISION)
    prior[-count:] = [std[name] ** -2 for name in joints_of(body)]
    return np.asarray(np.linalg.inv(J.T @ J + np.diag(prior))[-count:, -count:]) + ZERO_STD**2 * np.eye(count)


def balanced(people: Sequence[Sequence[Poses]], most: int, rng: np.random.Generator) -> list[Poses]:
    """The poses of every person, from the clips of each: all, or `most` drawn without replacement."""
    of_people = []
    for clips in people:
        poses = joined(clips)
        if len(poses.angles) > most:
            drawn = rng.permutation(len(poses.angles))[:most]
            poses = Poses(poses.angles[drawn], poses.uncertainty[drawn])
        of_people.append(poses)
    return of_people


def joined(clips: Sequence[Poses]) -> Poses:
    """The poses of all clips."""
    return Poses(np.concatenate([c.angles for c in clips]), np.concatenate([c.uncertainty for c in clips]))


def learned(body: Body, clips: Sequence[Poses], settings: LearnSettings, rng: np.random.Generator) -> PoseMixture:
    """The mixture of the best likelihood among a few random starts of expectation maximisation.

    Dempster, Laird and Rubin 1977, over poses and their mirror images; a Gaussian and its mirror image share their
    numbers. Each covariance contains the poses' own uncertainty and is drawn towards that of all poses, as with an
    inverse Wishart prior: the clips are few, and poses of one clip are not independent.
    """
    other, sign = mirror_of(body)
    poses = joined(clips)
    turned = poses.uncertainty[:, other][:, :, other] * np.outer(sign, sign)
    both = Poses(
        np.concatenate([poses.angles, sign * poses.angles[:, other]]), np.concatenate([poses.uncertainty, turned])
    )
    wide = np.cov(both.angles.T) + both.uncertainty.mean(axis=0)
    best: tuple[float, PoseMixture] | None = None
    for _ in range(settings.starts):
        start = PoseMixture(
            joints_of(body), joint_axes(body, joints_of(body)), other, sign, settings.background,
            np.full(settings.pairs, 1.0 / settings.pairs),
            _seeds(both.angles, settings.pairs, other, sign, rng),
            np.repeat(FIRST_STD**2 * np.eye(len(sign))[None], settings.pairs, axis=0),
        )  # fmt: skip
        mixture = _maximised(start, both, wide, settings.prior_count)
        likelihood = float(logsumexp(gaussian_log_densities(mixture, both.angles), axis=0).sum())
        if best is None or likelihood > best[0]:
            best = likelihood, mixture
    assert best is not None
    return best[1]


def marginal(mixture: PoseMixture, without: Sequence[str]) -> PoseMixture:
    """The mixture of all joints but some, which are not one side's alone."""
    kept = [i for i, name in enumerate(mixture.joints) if name not in without]
    return replace(
        mixture,
        joints=tuple(mixture.joints[i] for i in kept),
        axes=mixture.axes[kept],
        other_side=np.array([kept.index(i) for i in mixture.other_side[kept]]),
        mirror_sign=mixture.mirror_sign[kept],
        mean=mixture.mean[:, kept],
        covariance=mixture.covariance[:, kept][:, :, kept],
    )


def _seeds(angles: np.ndarray, count: int, other: np.ndarray, sign: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Poses (K, D) far from each other and from their mirror images (Arthur and Vassilvitskii 2007)."""
    seeds = [angles[rng.integers(len(angles))]]
    nearest = np.full(len(angles), np.inf)
    while len(seeds) < count:
        for seed in (seeds[-1], sign * seeds[-1][other]):
            nearest = np.minimum(nearest, np.square(angles - seed).sum(axis=1))
        seeds.append(angles[rng.choice(len(angles), p=nearest / nearest.sum())])
    return np.array(seeds)


def _maximised(mixture: PoseMixture, poses: Poses, wide: np.ndarray, prior_count: float) -> PoseMixture:
    """Expectation maximisation; by symmetry only the first of each mirrored pair is updated."""
    count = len(mixture.weight)
    for _ in range(ITERATIONS):
        log_density = gaussian_log_densities(mixture, poses.angles)
        share = np.exp(log_density - logsumexp(log_density, axis=0))[:count]
        mass = share.sum(axis=1) + 1.0  # one pose a Gaussian beforehand: none dies out
        mean = (share @ poses.angles + mixture.mean) / mass[:, None]
        covariance = np.empty_like(mixture.covariance)
        unsure = np.tensordot(share, poses.uncertainty, 1)
        for k in range(count):
            away = poses.angles - mean[k]
            scatter = (share[k][:, None] * away).T @ away + unsure[k]
            covariance[k] = (scatter + prior_count * wide) / (mass[k] + prior_count)
        mixture = replace(mixture, weight=mass / mass.sum(), mean=mean, covariance=covariance)
    return mixture


def gaussian_log_densities(mixture: PoseMixture, angles: np.ndarray) -> np.ndarray:
    """Log of share times density of every Gaussian and mirror image (2K, N) at angles (N, D)."""
    densities = []
    for share, mean, covariance in zip(*mixture.both_sides(), strict=True):
        L = np.linalg.cholesky(covariance)
        square = np.square((angles - mean) @ np.linalg.inv(L).T).sum(axis=1)
        densities.append(np.log(share) - 0.5 * (square + len(mean) * np.log(2.0 * np.pi)) - np.log(np.diag(L)).sum())
    return np.array(densities)
