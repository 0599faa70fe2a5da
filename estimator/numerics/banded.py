"""Symmetric matrices of blocks in which a block meets the two after it alone, as poses that accelerations tie."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve


def inverse_diagonal(blocks: np.ndarray) -> np.ndarray:
    """The diagonal blocks (T, n, n) of the inverse of a positive definite matrix of T x T blocks.

    blocks (3, T, n, n): block k of row t is at column t + k; those beyond the last column do not count. The block
    Cholesky factors forwards, then the entries of the inverse within the band backwards, without any others
    (K. Takahashi, J. Fagan, M.-S. Chin, Formation of a sparse bus impedance matrix, PICA 1973).

    Raises
    ------
    numpy.linalg.LinAlgError: it is not positive definite.
    """
    inverse, near, far = _factors(blocks)
    count, n = inverse.shape[:2]
    own = np.zeros((count + 2, n, n))  # Z[t, t], and two beyond the end
    beside = np.zeros((count + 2, n, n))  # Z[t, t + 1]
    for t in range(count - 1, -1, -1):
        beside[t] = -(near[t].T @ own[t + 1] + far[t].T @ beside[t + 1].T)
        beyond = -(near[t].T @ beside[t + 1] + far[t].T @ own[t + 2])
        own[t] = inverse[t] - near[t].T @ beside[t].T - far[t].T @ beyond.T
        own[t] = 0.5 * (own[t] + own[t].T)
    return own[:count]


def _factors(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverses (T, n, n) of the diagonal blocks of D, and L[t + 1, t] and L[t + 2, t], of the matrix L D L'."""
    _, count, n, _ = blocks.shape
    inverse, near, far = (np.zeros((count, n, n)) for _ in range(3))
    left, coupled = blocks[0].copy(), blocks[1].copy()  # what is left of H[t, t] and H[t, t + 1]
    for t in range(count):
        inverse[t] = cho_solve(cho_factor(left[t], lower=True), np.eye(n))
        if t + 1 < count:
            near[t] = coupled[t].T @ inverse[t]
            left[t + 1] -= near[t] @ coupled[t]
        if t + 2 < count:
            far[t] = blocks[2, t].T @ inverse[t]
            coupled[t + 1] -= near[t] @ blocks[2, t]
            left[t + 2] -= far[t] @ blocks[2, t]
    return inverse, near, far
