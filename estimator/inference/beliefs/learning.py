"""Mixtures of relative placements learned from samples by expectation maximisation (Sigal et al. 2004, section 2.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.special import logsumexp

from estimator.inference.beliefs.mixture import Density, mixture_of
from estimator.inference.beliefs.potential import Potential, potential_of
from estimator.inference.beliefs.shapes import Shapes, shapes_of
from estimator.inference.beliefs.space import PLACEMENTS, Space
from humanoid.support.errors import InputError

TURNS = Space(0, True)
_SMALLEST_W = 0.1  # of a turned quaternion, in size: 1 / w has no bound, and w = 0 is half a turn away from the others
_LEAST = 1e-9  # samples, of which a kernel keeps what it was: none are left to it
_MIRRORED = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # tangents of frames whose y axes are turned round


@dataclass(frozen=True)
class LearnSettings:
    """Settings of the learning of a mixture.

    kernels: M. full: whole covariances, else diagonal ones, as the paper's. floor [m], floor_turn [rad]: standard
    deviations below which no covariance goes: rigid links have none. Rotations' covariances are those of
    rotation vectors, which densities are of (`quaternion_covariance` is eq. 5). iterations: at most; it ends where the
    log likelihood gains less than `enough` nats a sample. starts: of K-means; the best likelihood wins.
    """

    kernels: int = 3
    full: bool = False
    floor: float = 0.005
    floor_turn: float = 0.005
    iterations: int = 100
    enough: float = 5e-4
    starts: int = 1

    @property
    def floors(self) -> np.ndarray:
        """Floors of the six numbers of a tangent."""
        return np.array([self.floor] * 3 + [self.floor_turn] * 3)


@dataclass(frozen=True)
class RelativePlacements:
    """A mixture of M normal densities of a placement in another's frame, X_ij = X_i^-1 X_j.

    weight (M,): their sum is 1. mean (M, 7): t [m], quaternion x, y, z, w. covariance (M, 6, 6): of the translation
    along the axes of i [m] and of the rotation vector in the mean's own frame [rad].
    """

    weight: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def log_parts(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N, M) of the densities of the kernels, each times its weight, at points (N, 7)."""
        shapes = shapes_of(PLACEMENTS, self.covariance)
        with np.errstate(divide="ignore"):
            log_weight = np.log(self.weight)
        parts = [_log_normal(tangents(m, points), shapes, k) for k, m in enumerate(self.mean)]
        return np.asarray(np.stack(parts, axis=1) + log_weight)

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of the density at points (N, 7), in the measure of `TURNS_VOLUME`."""
        return np.asarray(logsumexp(self.log_parts(points), axis=1))

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, 7)."""
        potential = self.potential().relative
        return mixture_of(PLACEMENTS, potential.mean, potential.shapes.covariance, self.weight).sample(rng, count)

    def mirrored(self) -> RelativePlacements:
        """The same for two limbs on the other side of the body, see `mirrored_points`."""
        covariance = self.covariance * np.outer(_MIRRORED, _MIRRORED)
        return RelativePlacements(self.weight, mirrored_points(self.mean), covariance)

    def potential(self, outlier: Density | None = None, share: float = 0.01) -> Potential:
        """psi_ij of the engine, with the outlier process and lambda0 of eq. 1."""
        return potential_of(
            PLACEMENTS, self.mean, self.covariance, self.weight, in_first=True, outlier=outlier, share=share
        )


def tangents(mean: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Tangents (N, 6) at a mean (7,) that lead to points (N, 7): the translation along the axes of the frame that all
    are given in [m], the rotation vector in the mean's own frame [rad]."""
    turn = TURNS.differences(mean[3:], points[:, 3:])
    return np.concatenate([points[:, :3] - mean[:3], turn], axis=1)


def mirrored_points(points: np.ndarray) -> np.ndarray:
    """Relative placements (N, 7) of the limbs on the other side of a mirrored body.

    Mirrored in the plane S = diag(1, -1, 1), a limb's frame R becomes S R D, D = diag(1, -1, 1), since y turns round to
    keep it right-handed. So X_ij = (t, R) becomes (D t, D R D): S cancels.
    """
    return points * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])


def quaternion_mean(quaternions: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Mean (4,) of unit quaternions (N, 4) of weights (N,): eq. 4, made of length 1.

    Before, the set is turned so that the squares of w are as large as they can be on average: by the principal axis of
    the quaternions' scatter, which does not depend on signs (Markley et al. 2007). The paper minimises the largest w,
    which can only be meant the other way: x / w needs a w far from 0.
    """
    share = weight / weight.sum()
    axis = np.linalg.eigh((share[:, None] * quaternions).T @ quaternions)[1][:, -1]
    mean = np.append(share @ _half_tangents(axis, quaternions), 1.0)
    mean /= np.linalg.norm(mean)
    return np.asarray(TURNS.composed(axis[None], mean[None])[0, 0])


def quaternion_covariance(quaternions: np.ndarray, mean: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) [rad^2] of unit quaternions (N, 4) of weights (N,) about a mean (4,), in its own frame: eq. 5
    times 4, since (x, y, z) / w is the tangent of half the angle."""
    away = _half_tangents(mean, quaternions)
    return np.asarray(4.0 * (weight[:, None] * away).T @ away / weight.sum())


def _half_tangents(centre: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """(x, y, z) / w (N, 3) of quaternions (N, 4) seen from another (4,)."""
    turned = TURNS.composed(TURNS.inverse(centre[None]), quaternions)[0]
    w = turned[:, 3:]
    return np.asarray(turned[:, :3] / np.where(np.abs(w) < _SMALLEST_W, np.copysign(_SMALLEST_W, w), w))


def learned_mixture(
    points: np.ndarray, settings: LearnSettings, rng: np.random.Generator
) -> tuple[RelativePlacements, np.ndarray]:
    """The mixture of relative placements (N, 7), and the mean log likelihood [nats a sample] after each iteration.

    Expectation maximisation from K-means. The mean of eq. 4 is not quite where the likelihood is largest; a kernel
    takes it only if that gains, else it keeps the old one and takes the covariance about it: the likelihood never falls
    (generalised EM, Dempster, Laird and Rubin 1977).

    Raises
    ------
    InputError: fewer samples than kernels.
    """
    if len(points) < max(settings.kernels, 1) or settings.kernels < 1:
        problem = f"{len(points)} samples for {settings.kernels} kernels"
        raise InputError("a mixture of placements", problem, remedy="as many samples as kernels, and a kernel or more")
    learned = [_from_clusters(points, settings, rng) for _ in range(settings.starts)]
    return max(learned, key=lambda pair: float(pair[1][-1]))


def _from_clusters(
    points: np.ndarray, settings: LearnSettings, rng: np.random.Generator
) -> tuple[RelativePlacements, np.ndarray]:
    """`learned_mixture` of one start."""
    share = np.eye(settings.kernels)[_clusters(points, settings, rng)]
    mixture = _maximised(points, share, None, settings)
    likelihood = []
    for _ in range(settings.iterations):
        parts = mixture.log_parts(points)
        total = logsumexp(parts, axis=1)
        likelihood.append(float(total.mean()))
        if len(likelihood) > 1 and abs(likelihood[-1] - likelihood[-2]) < settings.enough:
            break
        mixture = _maximised(points, np.exp(parts - total[:, None]), (mixture, parts), settings)
    return mixture, np.array(likelihood)


def _clusters(points: np.ndarray, settings: LearnSettings, rng: np.random.Generator) -> np.ndarray:
    """Cluster (N,) of each point (N, 7) by K-means, metres and radians alike.

    What lies nearer than the floors is one place; so much noise makes it several, lest K-means stand before equals.
    """
    even = np.ones(len(points))
    centre = np.append(points[:, :3].mean(axis=0), quaternion_mean(points[:, 3:], even))
    e = tangents(centre, points) + settings.floors * rng.standard_normal((len(points), 6))
    if settings.kernels == 1:
        return np.zeros(len(points), dtype=np.int64)
    label: np.ndarray = kmeans2(e, settings.kernels, iter=30, minit="++", missing="raise", rng=rng)[1]
    return label


def _maximised(
    points: np.ndarray,
    share: np.ndarray,
    before: tuple[RelativePlacements, np.ndarray] | None,
    settings: LearnSettings,
) -> RelativePlacements:
    """The kernels of points (N, 7) that belong to them by shares (N, M). before: the mixture, and its `log_parts`."""
    mass = share.sum(axis=0)
    kernels = []
    for k, own in enumerate(share.T):
        old = None if before is None else (before[0].mean[k], before[0].covariance[k])
        if old is not None and mass[k] < _LEAST:
            kernels.append(old)
            continue
        mean = np.append(own @ points[:, :3] / mass[k], quaternion_mean(points[:, 3:], own))
        new, fit = _kernel(points, mean, own, settings)
        if before is not None and old is not None:
            least = float(own @ before[1][:, k] - mass[k] * np.log(before[0].weight[k]))
            if fit < least:
                new, fit = _kernel(points, old[0], own, settings)
                new = new if fit >= least else old
        kernels.append(new)
    return RelativePlacements(mass / mass.sum(), np.array([m for m, _ in kernels]), np.array([c for _, c in kernels]))


def _kernel(
    points: np.ndarray, mean: np.ndarray, own: np.ndarray, settings: LearnSettings
) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """A mean (7,) with the covariance (6, 6) about it of points (N, 7) that belong to a kernel by shares (N,); and
    their expected log likelihood."""
    e = tangents(mean, points)
    covariance = (own[:, None] * e).T @ e / own.sum()
    covariance = _above(settings, covariance)
    return (mean, covariance), float(own @ _log_normal(e, shapes_of(PLACEMENTS, covariance[None]), 0))


def _log_normal(e: np.ndarray, shapes: Shapes, k: int) -> np.ndarray:
    """Logarithms (N,) of a kernel's density where tangents (N, 6) lead; see `kernel_exponent` of the rotations'
    measure."""
    r = np.sqrt(np.square(e[:, 3:]).sum(axis=1))
    measure = 2.0 * np.log(np.sinc(r / (2.0 * np.pi)))
    return np.asarray(shapes.constant[k] - 0.5 * np.square(e @ shapes.whitener[k].T).sum(axis=1) - measure)


def _above(settings: LearnSettings, covariance: np.ndarray) -> np.ndarray:
    """The most likely covariance (6, 6) that is nowhere below the floors, of samples that have this one."""
    floors = settings.floors
    if not settings.full:
        return np.diag(np.maximum(np.diag(covariance), floors**2))
    value, vector = np.linalg.eigh(covariance / np.outer(floors, floors))
    root = floors[:, None] * vector * np.sqrt(np.maximum(value, 1.0))
    return np.asarray(root @ root.T)
