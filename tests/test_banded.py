"""Entries of the inverse of banded matrices against the whole inverse."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.tracking.smoothing.chain import inverse_diagonal


@pytest.mark.parametrize("count", [1, 2, 3, 9])
@pytest.mark.parametrize("reach", [1, 2, 3])
def test_diagonal_blocks_are_those_of_the_whole_inverse(count: int, reach: int) -> None:
    rng, n = np.random.default_rng(count), 4
    rows = np.zeros((count * n, (count + reach) * n))  # every block of columns has consecutive blocks of rows
    for t in range(count):
        rows[t * n : (t + 1) * n, t * n : (t + 1 + reach) * n] = rng.normal(size=(n, (1 + reach) * n))
    whole = rows @ rows.T + 0.1 * np.eye(count * n)
    cut = whole.reshape(count, n, count, n).transpose(0, 2, 1, 3)
    blocks = rng.normal(size=(1 + reach, count, n, n))  # what lies beyond the end does not count
    for k in range(1 + reach):
        for t in range(max(0, count - k)):
            blocks[k, t] = cut[t, t + k]
    inverse = np.linalg.inv(whole).reshape(count, n, count, n).transpose(0, 2, 1, 3)
    expected = np.array([inverse[t, t] for t in range(count)])
    np.testing.assert_allclose(inverse_diagonal(blocks), expected, rtol=1e-8, atol=1e-10)


def test_what_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse_diagonal(np.stack([-np.eye(2)[None], np.zeros((1, 2, 2)), np.zeros((1, 2, 2))]))
