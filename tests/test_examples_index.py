"""Edge direction histograms, the bits learned from them, and the examples found by these bits."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.search.examples.hashing import Bits, HashTables, learned_bits, packed, random_keys, unpacked
from estimator.vision.person_view import DIRECTIONS, SIDE, WINDOWS, bin_count, edge_histogram, edges_by_direction


def hashed(values: np.ndarray, seed: int = 0) -> HashTables:
    return HashTables(packed(values), random_keys(values.shape[1], np.random.default_rng(seed)))


def stripes(angle: float, period: float = 16.0) -> np.ndarray:
    """A picture of bars whose normal has this angle [degrees], x to y."""
    y, x = np.mgrid[:SIDE, :SIDE]
    across = x * np.cos(np.radians(angle)) + y * np.sin(np.radians(angle))
    return np.where(across % period < 0.5 * period, 60, 180).astype(np.uint8)


def test_the_bins_are_those_of_the_paper() -> None:
    assert bin_count() == 13076
    assert edge_histogram(np.zeros((SIDE, SIDE), np.uint8)).shape == (13076,)


@pytest.mark.parametrize("direction", range(DIRECTIONS))
def test_edges_count_in_their_own_direction(direction: int) -> None:
    by_direction = edge_histogram(stripes(45.0 * direction)).reshape(-1, DIRECTIONS).sum(axis=0)
    assert by_direction[direction] > 0.9 * by_direction.sum() > 0.0


def test_a_direction_has_no_sign() -> None:
    picture = stripes(10.0)
    np.testing.assert_array_equal(edge_histogram(picture), edge_histogram(255 - picture))


def test_windows_count_the_pixels_in_them() -> None:
    """Larger windows against the smallest, of which every second covers the picture once; those at the border end
    there."""
    picture = np.kron(np.random.default_rng(0).integers(0, 256, (10, 10)), np.ones((20, 20))).astype(np.uint8)
    ends = np.cumsum([(SIDE // (w // 2)) ** 2 * DIRECTIONS for w in WINDOWS])[:-1]
    by_size = [bins.reshape(-1, DIRECTIONS) for bins in np.split(edge_histogram(picture), ends)]
    smallest = by_size[0].reshape(50, 50, DIRECTIONS)[::2, ::2].astype(int)
    assert smallest.sum() > 1000
    for size, bins in zip(WINDOWS[1:], by_size[1:], strict=True):
        step, n = size // 16, SIDE // (size // 2)  # in windows of 8 px; a window is two steps
        for i, j in ((0, 0), (3, n - 1), (n - 1, 5), (n - 1, n - 1)):
            covered = smallest[i * step : (i + 2) * step, j * step : (j + 2) * step]
            np.testing.assert_array_equal(bins.reshape(n, n, DIRECTIONS)[i, j], covered.sum(axis=(0, 1)))


def test_the_outline_counts_where_person_and_background_are_alike() -> None:
    where = np.zeros((SIDE, SIDE), bool)
    where[60:140, 80:120] = True
    even = np.full((SIDE, SIDE), 128, np.uint8)
    assert edge_histogram(even).sum() == 0
    horizontal, falling, vertical, rising = edges_by_direction(even, where)
    rows, columns = np.nonzero(horizontal)  # normals: of the sides
    assert set(columns) <= {79, 80, 119, 120}
    assert 140 <= len(rows) <= 180
    rows, columns = np.nonzero(vertical)
    assert set(rows) <= {59, 60, 139, 140}
    assert falling.sum() + rising.sum() < 20  # the corners


def test_edges_finer_than_limbs_do_not_count() -> None:
    assert edge_histogram(stripes(0.0, period=4.0)).sum() == 0
    assert edge_histogram(stripes(0.0, period=24.0)).sum() > 0


def test_edges_beside_the_person_do_not_count() -> None:
    where = np.zeros((SIDE, SIDE), bool)
    where[:, :100] = True
    of_all, of_person = (np.any(edges_by_direction(stripes(0.0, 24.0), w), axis=0) for w in (None, where))
    assert of_all[:, 110:].any()
    assert not of_person[:, 102:].any()
    np.testing.assert_array_equal(of_person[:, :90], of_all[:, :90])


def test_a_picture_of_another_kind_is_refused() -> None:
    with pytest.raises(ValueError, match=r"float64 \(200, 200\)"):
        edge_histogram(np.zeros((SIDE, SIDE)))
    with pytest.raises(ValueError, match=r"\(100, 100\)"):
        edge_histogram(np.zeros((100, 100), np.uint8))


def pairs(rng: np.random.Generator, count: int) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Similar and dissimilar pairs of descriptions: the first feature distinguishes them, the second is uninformative,
    the third always differs between similar ones."""
    first = rng.integers(0, 40, (4, count))
    informative = [first[0], np.clip(first[0] + rng.integers(-2, 3, count), 0, 60), first[1], first[2]]
    noise = rng.integers(0, 40, (4, count))
    opposite = [np.zeros(count, int), np.full(count, 9), noise[0], noise[0]]
    columns = [np.stack([informative[k], noise[k], opposite[k]], axis=1).astype(np.uint16) for k in range(4)]
    return (columns[0], columns[1]), (columns[2], columns[3])


def test_discriminative_bits_are_kept_with_their_best_threshold() -> None:
    similar, dissimilar = pairs(np.random.default_rng(1), 4000)
    bits = learned_bits(similar, dissimilar)
    assert bits.feature.tolist() == [0]

    def rates(threshold: int) -> tuple[float, float]:
        same = [np.mean((a[:, 0] >= threshold) == (b[:, 0] >= threshold)) for a, b in (similar, dissimilar)]
        return float(same[0]), float(same[1])

    every = {t: rates(t) for t in range(45)}
    best = max((t for t in every if every[t][0] >= 0.65), key=lambda t: every[t][0] - every[t][1])
    assert bits.threshold[0] == best
    np.testing.assert_allclose((bits.true_rate[0], bits.false_rate[0]), every[best])


def test_bits_need_pairs_of_both_kinds() -> None:
    similar, _ = pairs(np.random.default_rng(1), 4)
    with pytest.raises(ValueError, match="4 similar and 0 dissimilar"):
        learned_bits(similar, (similar[0][:0], similar[1][:0]))


def test_a_bit_is_a_threshold_that_is_reached() -> None:
    bits = Bits(np.array([2, 0], np.int32), np.array([5, 1], np.uint16), np.ones(2), np.zeros(2))
    np.testing.assert_array_equal(bits.of(np.array([[0, 9, 5], [1, 9, 4]], np.uint16)), [[True, False], [False, True]])


def clustered(rng: np.random.Generator, count: int = 3000, bits: int = 300) -> np.ndarray:
    """Values (count, bits): a hundred families whose members differ in few bits."""
    families = rng.random((100, bits)) < 0.5
    return np.asarray(families[rng.integers(0, 100, count)] ^ (rng.random((count, bits)) < 0.02))


def test_the_nearest_of_a_family_are_those_of_exact_search() -> None:
    rng = np.random.default_rng(2)
    values = clustered(rng)
    tables, exact = hashed(values), 0
    for query in values[:20] ^ (rng.random((20, values.shape[1])) < 0.02):
        near = tables.nearest(query, 10)
        differing = (values ^ query).sum(axis=1)
        np.testing.assert_array_equal(near.distance, differing[near.numbers])
        assert not near.fell_back
        assert near.comparisons < 0.2 * len(values)
        exact += set(near.numbers) == set(np.lexsort((np.arange(len(values)), differing))[:10])
    assert exact >= 18


@pytest.mark.parametrize("count", [1, 10, 400])
def test_all_are_compared_and_equals_keep_their_order(count: int) -> None:
    values = np.random.default_rng(4).random((300, 12)) < 0.5  # few bits, so many ties
    tables = HashTables(packed(values), np.arange(4)[None])
    for query in values[:5] ^ True:
        near, differing = tables.nearest_of_all(query, count), (values ^ query).sum(axis=1)
        np.testing.assert_array_equal(near.numbers, np.lexsort((np.arange(300), differing))[:count])
        np.testing.assert_array_equal(near.distance, differing[near.numbers])
        assert near.comparisons == len(values)


def test_empty_buckets_fall_back_to_all_examples() -> None:
    values = clustered(np.random.default_rng(2))
    near = hashed(values).nearest(~values[0], 5)
    differing = (values ^ ~values[0]).sum(axis=1)
    assert near.fell_back
    assert near.comparisons == len(values)
    np.testing.assert_array_equal(near.numbers, np.lexsort((np.arange(len(values)), differing))[:5])


def test_the_same_seed_gives_the_same_neighbours() -> None:
    values = clustered(np.random.default_rng(2))
    a, b = (hashed(values, 7).nearest(values[5], 50) for _ in range(2))
    np.testing.assert_array_equal(a.numbers, b.numbers)
    assert a.numbers[0] == 5
    assert a.distance[0] == 0


def test_keys_need_as_many_bits() -> None:
    with pytest.raises(ValueError, match="12 bits"):
        random_keys(12, np.random.default_rng(0))


def test_packing_keeps_every_bit() -> None:
    values = np.random.default_rng(3).random((5, 130)) < 0.5
    words = packed(values)
    assert words.shape == (5, 3)
    np.testing.assert_array_equal(unpacked(words)[:, :130], values)
