"""Small linear systems against LAPACK; alignments against their known motions and their neighbours; the closest points
against all distances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.numerics.alignment import rotation_onto, similarity_onto
from estimator.numerics.closest import closest
from estimator.numerics.linear import eliminate, invert_definite, solve_definite


def definite(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return np.asarray(root @ root.T + 0.1 * np.eye(n))


def plain_factor(A: np.ndarray) -> np.ndarray:
    """Cholesky's factor (n, n) of A, one sum after the other."""
    L = np.zeros_like(A)
    for a in range(len(A)):
        for b in range(a + 1):
            t = A[a, b]
            for c in range(b):
                t -= L[a, c] * L[b, c]
            L[a, b] = np.sqrt(t) if a == b else t / L[b, b]
    return L


def test_definite_systems_are_solved_on_any_rows() -> None:
    rng = np.random.default_rng(1)
    for n in range(1, 16):
        A, b = definite(rng, 16), rng.normal(size=16)
        rows = np.sort(rng.permutation(16)[:n]).astype(np.int64)
        given, x = A.copy(), b.copy()
        given[np.triu_indices(16, 1)] = np.nan  # never read
        L = np.empty((16, 16))
        assert solve_definite(given, rows, n, 0.0, L, x)
        part = A[np.ix_(rows, rows)]
        assert x[:n] == pytest.approx(np.linalg.solve(part, b[:n]), rel=1e-9, abs=1e-12)
        assert np.array_equal(x[n:], b[n:])
        assert np.tril(L[:n, :n]) == pytest.approx(np.linalg.cholesky(part), rel=1e-10, abs=1e-12)
        assert np.array_equal(np.tril(L[:n, :n]), plain_factor(part))
        own = part.copy()
        again = b[:n].copy()
        assert solve_definite(own, np.arange(n), n, 0.0, own, again)  # in place
        assert np.array_equal(again, x[:n])


def test_definite_blocks_are_inverted_and_the_rest_is_left_alone() -> None:
    rng = np.random.default_rng(5)
    for n in (1, 2, 9, 16):
        A, rows = definite(rng, 16), np.sort(rng.permutation(16)[:n]).astype(np.int64)
        inverse, block = np.full((16, 16), 7.0), np.ix_(rows, rows)
        assert invert_definite(A, rows, n, *np.empty((2, 16, 16)), inverse)
        assert inverse[block] == pytest.approx(np.linalg.inv(A[block]), rel=1e-9, abs=1e-12)
        assert np.count_nonzero(inverse == 7.0) == 256 - n * n
        assert np.array_equal(inverse, inverse.T)
    assert not invert_definite(-A, rows, 16, *np.empty((2, 16, 16)), inverse)


def test_pivots_below_the_floor() -> None:
    A, x = np.diag([4.0, 0.0, -1.0]), np.array([1.0, 2.0, 3.0])
    y = x.copy()
    assert not solve_definite(A, np.arange(3), 3, 0.0, np.empty((3, 3)), y)
    assert np.array_equal(y, x)
    assert solve_definite(A, np.arange(3), 3, 0.25, np.empty((3, 3)), y)
    assert y == pytest.approx(x / [4.0, 0.25, 0.25])


def test_elimination() -> None:
    rng = np.random.default_rng(2)
    for n in range(1, 8):
        K, b = rng.normal(size=(n, n)), rng.normal(size=n)
        K[0, 0] = 0.0 if n > 1 else K[0, 0]  # needs a pivot
        x = b.copy()
        assert eliminate(K.copy(), x)
        assert K @ x == pytest.approx(b, abs=1e-9)
    assert not eliminate(np.ones((2, 2)), np.ones(2))


def test_known_motions_come_back() -> None:
    rng = np.random.default_rng(3)
    for count in (3, 4, 20):
        points = rng.normal(size=(count, 3))
        R, t = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
        rigid = similarity_onto(points, points @ R.T + t)
        assert (rigid.R, rigid.t) == (pytest.approx(R, abs=1e-12), pytest.approx(t, abs=1e-12))
        assert rigid.scale == 1.0
        similar = similarity_onto(points, 2.5 * points @ R.T + t, scaled=True)
        assert (similar.R, similar.t, similar.scale) == (
            pytest.approx(R, abs=1e-12), pytest.approx(t, abs=1e-12), pytest.approx(2.5),
        )  # fmt: skip
        assert similar.of(points) == pytest.approx(2.5 * points @ R.T + t, abs=1e-12)
        assert rotation_onto(points, points @ R.T) == pytest.approx(R, abs=1e-12)


def test_mirror_images_are_turned_and_not_reflected() -> None:
    """The best rotation onto the mirror image of points along the axes: the shortest axis is sacrificed."""
    points = np.diag([3.0, 2.0, 1.0])
    assert rotation_onto(points, points * [1.0, 1.0, -1.0]) == pytest.approx(np.eye(3), abs=1e-12)
    assert rotation_onto(points, points * [-1.0, 1.0, 1.0]) == pytest.approx(np.diag([-1.0, 1.0, -1.0]), abs=1e-12)
    mirrored = similarity_onto(np.vstack([points, -points]), np.vstack([points, -points]) * [1, 1, -1], scaled=True)
    assert mirrored.scale == pytest.approx((9.0 + 4.0 - 1.0) / 14.0)  # Umeyama's trace, one sign flipped


def test_no_neighbour_is_better() -> None:
    rng = np.random.default_rng(4)
    points, reference = rng.normal(size=(2, 8, 3))
    best = similarity_onto(points, reference, scaled=True)

    def error(R: np.ndarray, t: np.ndarray, scale: float) -> float:
        return float(np.sum((scale * points @ R.T + t - reference) ** 2))

    least = error(*best)
    assert rotation_onto(points, reference) == pytest.approx(
        Rotation.align_vectors(reference, points)[0].as_matrix(), abs=1e-9
    )
    for _ in range(50):
        turned = Rotation.from_rotvec(0.01 * rng.normal(size=3)).as_matrix() @ best.R
        assert error(turned, best.t, best.scale) > least
        assert error(best.R, best.t + 0.01 * rng.normal(size=3), best.scale) > least
    assert min(error(best.R, best.t, best.scale * s) for s in (0.99, 1.01)) > least


def test_points_without_an_extent_are_only_moved() -> None:
    here, there = np.full((4, 3), 0.5), np.random.default_rng(5).normal(size=(4, 3))
    for scaled in (False, True):
        moved = similarity_onto(here, there, scaled=scaled)
        assert np.array_equal(moved.R, np.eye(3))
        assert moved.scale == 1.0
        assert moved.of(here) == pytest.approx(np.tile(there.mean(axis=0), (4, 1)))
    line = np.outer(np.arange(4.0), [1.0, 0.0, 0.0])
    turn = rotation_onto(line, line[:, [1, 0, 2]])
    assert turn[:, 0] == pytest.approx([0.0, 1.0, 0.0])
    assert np.linalg.det(turn) == pytest.approx(1.0)


@pytest.mark.parametrize("count", [1, 255, 256, 257, 700])
def test_the_closest_of_all(count: int) -> None:
    """By all distances, across block borders; the first of equals."""
    rng = np.random.default_rng(7)
    places, among = rng.normal(size=(count, 3)), rng.normal(size=(40, 3))
    twice = np.concatenate([among, among])
    which, squared = closest(places, twice)
    all_squared = np.square(places[:, None] - twice).sum(axis=2)
    np.testing.assert_array_equal(which, all_squared.argmin(axis=1))
    np.testing.assert_allclose(squared, all_squared.min(axis=1), rtol=1e-12)


def test_nothing_is_infinitely_far() -> None:
    assert np.isinf(closest(np.zeros((3, 3)), np.zeros((0, 3)))[1]).all()
