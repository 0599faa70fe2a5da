"""Potentials between two nodes of a graph: mixtures of relative placements (Sigal et al. 2004, eqs. 1 to 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.inference.beliefs.mixture import Density, KernelMixture, log_shares
from estimator.inference.beliefs.shapes import shapes_of
from estimator.inference.beliefs.space import Space, placements_of
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class Potential:
    """psi_ij(X_i, X_j) as a density of X_j (eq. 1): kernels at X_i X_ij,m and an outlier process that ignores X_i.

    relative: the M kernels of X_ij = X_i^-1 X_j (eq. 3). Their covariances are in the frame of X_j's mean, so that they
    are those of X_j too, wherever X_i is. outlier, share: the outlier process and lambda0; None and 0 without.
    """

    relative: KernelMixture
    outlier: Density | None = None
    share: float = 0.0

    @property
    def space(self) -> Space:
        """The space of both nodes."""
        return self.relative.space

    def placed(self, points: np.ndarray) -> np.ndarray:
        """F_ijm(X_i), (N, M, size), of points X_i (N, size)."""
        return self.space.composed(points, self.relative.mean)

    def message(self, points: np.ndarray, log_weight: np.ndarray) -> KernelMixture:
        """The message of weighted points X_i (N, size) about X_j: N M kernels and the outlier process.

        log_weight (N,): their exponentials sum to 1. An outlier process of kernels joins them, first; any other is the
        mixture's background.
        """
        count, relative = len(points), self.relative
        mean = self.placed(points).reshape(-1, self.space.size)
        weight = (log_weight[:, None] + relative.log_weight).ravel()
        shape, shapes = np.tile(relative.shape, count), relative.shapes
        if not isinstance(self.outlier, KernelMixture):
            return KernelMixture(weight, mean, shape, shapes, self.outlier, self.share)
        behind = self.outlier
        return KernelMixture(
            np.concatenate([behind.log_weight + math.log(self.share), weight + math.log1p(-self.share)]),
            np.concatenate([behind.mean, mean]),
            np.concatenate([behind.shape + len(shapes), shape]),
            shapes.with_more(behind.shapes),
        )

    def log_value(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of psi_ij at pairs of X_i and X_j, each (N, size)."""
        back = self.space.inverse(first)
        value = self.relative.log_density(
            np.concatenate([self.space.composed(b[None], s[None])[0] for b, s in zip(back, second, strict=True)])
        )
        if self.outlier is None:
            return value
        outlying: np.ndarray = self.outlier.log_density(second) + math.log(self.share)
        return np.logaddexp(value + math.log1p(-self.share), outlying)

    def inverse(self, outlier: Density | None = None) -> Potential:
        """The potential of the other direction, as a density of X_i, its covariances carried over to first order.

        In R^n it is the same function of both. outlier: of X_i.
        """
        space, relative = self.space, self.relative
        mean = space.inverse(relative.mean)
        covariance = relative.shapes.covariance[relative.shape]
        J = -np.tile(np.eye(space.dims), (len(mean), 1, 1))
        if space.turns:
            R = placements_of(np.pad(relative.mean, ((0, 0), (max(0, 3 - space.n), 0)))[:, -7:])[1]
            J[:, space.n :, space.n :] = -R
            if space.n == 3:
                x, y, z = -mean[:, :3].T  # the first one's place in the second's frame
                zero = np.zeros_like(x)
                cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
                J[:, :3, :3], J[:, :3, 3:] = -R, -R @ cross
        shapes = shapes_of(space, J @ covariance @ J.transpose(0, 2, 1))
        turned = KernelMixture(relative.log_weight, mean, np.arange(len(mean)), shapes)
        return Potential(turned, outlier, 0.0 if outlier is None else self.share)


def potential_of(
    space: Space,
    mean: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray | None = None,
    *,
    in_first: bool = False,
    outlier: Density | None = None,
    share: float = 0.01,
) -> Potential:
    """A potential from the mixture of relative placements X_ij.

    Parameters
    ----------
    mean (M, size): placements of j in i's frame; quaternions are made of length 1.
    covariance (M, dims, dims), or variances (M, dims): in the tangent at the mean.
    weight (M,): delta_ijm, even without.
    in_first: the covariances' translation is along the axes of i, not of the mean's own frame; rotation vectors are in
        the mean's own frame in any case.
    outlier, share: the outlier process in the world and lambda0, which counts nothing without it.

    Raises
    ------
    InputError: sizes differ, a covariance is not positive definite, weights or lambda0 are not shares.
    """
    mean = np.array(mean, dtype=float, ndmin=2)
    if mean.shape[1] != space.size:
        raise InputError("means of a potential", f"are {mean.shape}", remedy=f"(M, {space.size})")
    if not 0.0 < share < 1.0 and outlier is not None:
        raise InputError("lambda0", f"is {share}", remedy="between 0 and 1")
    if space.turns:
        mean[:, space.n :] /= np.linalg.norm(mean[:, space.n :], axis=1, keepdims=True)
    shapes = shapes_of(space, covariance)
    if len(shapes) != len(mean):
        raise InputError("covariance", f"{len(shapes)} for {len(mean)} kernels")
    if in_first and space.turns and space.n == 3:
        T = np.tile(np.eye(6), (len(mean), 1, 1))
        T[:, :3, :3] = placements_of(mean)[1].transpose(0, 2, 1)
        shapes = shapes_of(space, T @ shapes.covariance @ T.transpose(0, 2, 1))
    logarithm = log_shares(np.ones(len(mean)) if weight is None else weight, len(mean))
    relative = KernelMixture(logarithm, mean, np.arange(len(mean)), shapes)
    return Potential(relative, outlier, 0.0 if outlier is None else share)
