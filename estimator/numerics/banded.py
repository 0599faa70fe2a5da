"""Symmetric matrices of blocks in which a block meets some after it alone, as poses that accelerations tie."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve


def inverse_diagonal(blocks: np.ndarray) -> np.ndarray:
    """The diagonal blocks (T, n, n) of the inverse of a positive definite matrix of T x T blocks.

    blocks (1 + B, T, n, n): block k of row t is at column t + k; those beyond the last column do not count. The block
    factors L D L' forwards, then the entries of the inverse within the band backwards, without any others (K.
    Takahashi, J. Fagan, M.-S. Chin, Formation of a sparse bus impedance matrix, PICA 1973).

    Raises
    ------
    numpy.linalg.LinAlgError: it is not positive definite.
    """
    inverse, factors = _factors(blocks)
    reach, count, n = len(blocks) - 1, *blocks.shape[1:3]
    within = np.zeros((1 + reach, count + reach, n, n))  # [k, t]: of the inverse, at row t and column t + k
    for t in range(count - 1, -1, -1):
        for k in range(1, reach + 1):
            for j in range(1, reach + 1):
                entry = within[k - j, t + j] if k >= j else within[j - k, t + k].T
                within[k, t] -= factors[j, t].T @ entry
        within[0, t] = inverse[t] - sum(factors[k, t].T @ within[k, t].T for k in range(1, reach + 1))
        within[0, t] = 0.5 * (within[0, t] + within[0, t].T)
    return np.asarray(within[0, :count])


def _factors(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (T, n, n) of the blocks of D, and the blocks (1 + B, T, n, n) of L: [k, t] is at row t + k, column t."""
    reach, count, n = len(blocks) - 1, *blocks.shape[1:3]
    left, factors, inverse = blocks.copy(), np.zeros_like(blocks), np.zeros((count, n, n))
    for t in range(count):
        inverse[t] = cho_solve(cho_factor(left[0, t], lower=True), np.eye(n))
        for k in range(1, min(reach, count - 1 - t) + 1):
            factors[k, t] = left[k, t].T @ inverse[t]
            for j in range(k, min(reach, count - 1 - t) + 1):
                left[j - k, t + k] -= factors[k, t] @ left[j, t]
    return inverse, factors
