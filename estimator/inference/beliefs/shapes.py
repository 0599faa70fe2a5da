"""Covariances of kernels, with what evaluating and drawing from them takes: made once, shared by many kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from estimator.inference.beliefs.space import Space
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

_NARROW = 0.5  # rad: so narrow a normal density of rotation vectors has less than 1e-7 beyond pi
_ELEVATIONS, _AZIMUTHS = 24, 48


@dataclass(frozen=True)
class Shapes:
    """C covariances of kernels in the tangent space at their own mean.

    covariance, factor (C, dims, dims): the lower Cholesky factor. whitener (C, dims, dims): the inverse of the factor,
    lower triangular, so that its first n rows concern the translation alone. constant (C,): logarithm of the density at
    the mean. reach (C,): one over the largest variance of the translation.
    """

    space: Space
    covariance: np.ndarray
    factor: np.ndarray
    whitener: np.ndarray
    constant: np.ndarray
    reach: np.ndarray

    def __len__(self) -> int:
        return len(self.constant)

    def with_more(self, other: Shapes) -> Shapes:
        """These and then the others."""
        names = ("covariance", "factor", "whitener", "constant", "reach")
        return Shapes(self.space, *(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


def shapes_of(space: Space, covariance: np.ndarray) -> Shapes:
    """Shapes of covariances (C, dims, dims), or of variances (C, dims).

    Rotation vectors of pi and more would name a rotation twice: a kernel is the normal density of shorter ones, made to
    integrate to 1 over all rotations.

    Raises
    ------
    InputError: they have another size or are not positive definite.
    """
    covariance = np.asarray(covariance, dtype=float)
    if covariance.ndim == 2:
        covariance = covariance[:, :, None] * np.eye(space.dims)
    if covariance.ndim != 3 or covariance.shape[1:] != (space.dims, space.dims):
        raise InputError("covariance", f"is {covariance.shape}", remedy=f"(C, {space.dims}, {space.dims})")
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise InputError("covariance", "is not positive definite") from None
    if not np.all(np.isfinite(factor)):
        raise InputError("covariance", "is not finite")
    whitener = np.linalg.inv(factor)
    whitener *= np.tri(space.dims)
    diagonal = np.einsum("cii->ci", factor)
    constant = -np.log(diagonal).sum(axis=1) - 0.5 * space.dims * math.log(2.0 * math.pi)
    if space.turns:
        constant -= np.log(_share_of_turns(covariance[:, space.n :, space.n :]))
    reach = np.zeros(len(covariance))
    if space.n:
        reach = 1.0 / np.linalg.eigvalsh(covariance[:, : space.n, : space.n])[:, -1]
    return Shapes(space, covariance, factor, whitener, constant, reach)


def _share_of_turns(covariance: np.ndarray) -> np.ndarray:
    """The share (C,) of rotation vectors of covariances (C, 3, 3) [rad^2] that is shorter than pi."""
    share = np.ones(len(covariance))
    variance = np.linalg.eigvalsh(covariance)
    wide = np.flatnonzero(variance[:, -1] > _NARROW**2)
    if len(wide) == 0:
        return share
    square, weights = _directions()
    for c in wide:
        precision = square @ (1.0 / variance[c])
        density = (2.0 * np.pi) ** -1.5 / math.sqrt(float(np.prod(variance[c])))
        share[c] = density * _within(precision, weights)
    return np.minimum(share, 1.0)


@cache
def _directions() -> tuple[np.ndarray, np.ndarray]:
    """Squares (D, 3) of unit vectors in all directions and their weights (D,), the solid angles: Gauss and Legendre
    along the last axis, evenly around it."""
    height, weight = np.polynomial.legendre.leggauss(_ELEVATIONS)
    around = 2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    flat = np.sqrt(1.0 - height**2)
    directions = np.stack(
        [np.outer(flat, np.cos(around)), np.outer(flat, np.sin(around)), np.outer(height, np.ones(_AZIMUTHS))], axis=-1
    ).reshape(-1, 3)
    return np.square(directions), np.repeat(weight * 2.0 * np.pi / _AZIMUTHS, _AZIMUTHS)


@jit
def _within(precision, weights):  # type: ignore[no-untyped-def]
    """The integral of exp(-p r^2 / 2) r^2 over r from 0 to pi, p the precision (N,) in a direction, summed with the
    weights (N,) of the directions."""
    total = 0.0
    for i in range(len(precision)):
        p = precision[i]
        whole = math.sqrt(0.5 * math.pi) * math.erf(math.pi * math.sqrt(0.5 * p)) / (p * math.sqrt(p))
        total += weights[i] * (whole - math.pi * math.exp(-0.5 * p * math.pi * math.pi) / p)
    return total
