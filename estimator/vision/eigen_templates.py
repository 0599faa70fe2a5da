"""Eigenspaces of pictures: what a thing looks like, and how far a picture is from that (Moghaddam and Pentland, PAMI
1997)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHARE = 0.8
"""Share of the variance that an eigenspace keeps (Sigal et al., CVPR 2004, section 5)."""

_LEAST = 1e-6  # of the variance of a direction: a constant direction is not evidence against a small difference


@dataclass(frozen=True, eq=False)
class EigenSpace:
    """Principal components of pictures.

    mean (D,). basis (K, D): orthonormal rows, by falling variance. variance (K,): of pictures along each. rest: mean
    variance along each of the D - K directions that are left out.
    """

    mean: np.ndarray
    basis: np.ndarray
    variance: np.ndarray
    rest: float

    def coefficients(self, pictures: np.ndarray) -> np.ndarray:
        """Coefficients (N, K) of pictures (N, D) along the components."""
        return self._both(pictures)[0]

    def residual(self, pictures: np.ndarray) -> np.ndarray:
        """Squared distance (N,) of pictures (N, D) from the space: what the components do not explain of them."""
        return self._both(pictures)[1]

    def log_density(self, pictures: np.ndarray) -> np.ndarray:
        """Log-density (N,) of pictures (N, D) [nats]: normal along the components and, with `rest`, across them
        (Moghaddam and Pentland, eq. 9)."""
        along, residual = self._both(pictures)
        left_out = len(self.mean) - len(self.variance)
        size = np.log(self.variance).sum() + left_out * np.log(self.rest) + len(self.mean) * np.log(2.0 * np.pi)
        return np.asarray(-0.5 * ((along**2 / self.variance).sum(axis=1) + residual / self.rest + size))

    def _both(self, pictures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        away = pictures - self.mean
        along = away @ self.basis.T
        explained = np.einsum("nk,nk->n", along, along)
        return along, np.maximum(np.einsum("nd,nd->n", away, away) - explained, 0.0)


def eigen_space(pictures: np.ndarray, share: float = SHARE) -> EigenSpace:
    """The space of as few components as hold a share of the variance of pictures (N, D).

    Raises
    ------
    ValueError: fewer than two pictures, or a share that is not above 0 and below 1.
    """
    if len(pictures) < 2 or not 0.0 < share < 1.0:
        raise ValueError(f"{len(pictures)} pictures, a share of {share:g}")
    mean = pictures.mean(axis=0)
    away = pictures - mean
    size = away.shape[1]
    variance, vectors = np.linalg.eigh((away.T @ away).astype(float) / (len(pictures) - 1))
    variance, vectors = np.maximum(variance[::-1], 0.0), vectors[:, ::-1]
    total = variance.sum()
    count = min(int(np.searchsorted(np.cumsum(variance), share * total)) + 1, size - 1)
    rest = max(float(variance[count:].sum() / (size - count)), _LEAST)
    basis = np.ascontiguousarray(vectors[:, :count].T, dtype=pictures.dtype)
    return EigenSpace(mean, basis, np.maximum(variance[:count], _LEAST), rest)
