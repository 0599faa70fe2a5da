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
    # [k, 0]: of the inverse, at row t and column t + k; [k, i]: the same of row t + i, which are all that row t needs
    within = np.zeros((1 + reach, 1 + reach, n, n))
    for t in range(count - 1, -1, -1):
        within[:, 1:] = within[:, :-1].copy()
        within[:, 0] = 0.0
        for k in range(1, reach + 1):
            for j in range(1, reach + 1):
                entry = within[k - j, j] if k >= j else within[j - k, k].T
                within[k, 0] -= factors[j - 1, t].T @ entry
        within[0, 0] = inverse[t] - sum(factors[k - 1, t].T @ within[k, 0].T for k in range(1, reach + 1))
        within[0, 0] = 0.5 * (within[0, 0] + within[0, 0].T)
        inverse[t] = within[0, 0]
    return inverse


def _factors(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (T, n, n) of the blocks of D, and blocks (B, T, n, n) of L below these: [k, t] at row t + k + 1, column
    t."""
    reach, count, n = len(blocks) - 1, *blocks.shape[1:3]
    factors, inverse = np.zeros((reach, count, n, n)), np.zeros((count, n, n))
    left = blocks[:, : 1 + reach].copy()  # what is left of the columns from t on, as far as column t reaches
    for t in range(count):
        inverse[t] = cho_solve(cho_factor(left[0, 0], lower=True), np.eye(n))
        for k in range(1, min(reach, count - 1 - t) + 1):
            factors[k - 1, t] = left[k, 0].T @ inverse[t]
            for j in range(k, min(reach, count - 1 - t) + 1):
                left[j - k, k] -= factors[k - 1, t] @ left[j, 0]
        left[:, :-1] = left[:, 1:].copy()
        if t + 1 + reach < count:
            left[:, -1] = blocks[:, t + 1 + reach]
    return inverse, factors
