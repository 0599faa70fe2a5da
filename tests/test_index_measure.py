"""The measure of an index is right: exact search is exact, all examples contain the nearest, and more of them never
make the best worse."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.papers_elmo import index_searches
from benchmarks.papers_elmo.index import check
from benchmarks.papers_elmo.index_curves import Curves, Made
from benchmarks.papers_elmo.index_libraries import library_searches
from benchmarks.papers_elmo.index_pictures import Asked
from benchmarks.papers_elmo.index_searches import Search, searched
from estimator.search.examples.hashing import Bits, HashTables, packed, random_keys
from estimator.search.examples.index import ExampleIndex, IndexRecipe
from humanoid.support.errors import InputError

N, M, TABLES, KEY_BITS = 600, 100, 8, 6
WHOLE = Made(N, KEY_BITS, TABLES, 20)


@pytest.fixture(scope="module")
def index() -> ExampleIndex:
    rng = np.random.default_rng(0)
    tables = HashTables(packed(rng.random((N, M)) < 0.5), random_keys(M, rng, TABLES, KEY_BITS))
    bits = Bits(np.arange(M, dtype=np.int32), np.ones(M, np.uint16), np.ones(M), np.zeros(M))
    return ExampleIndex(IndexRecipe(N), ("q",), 2.0, np.zeros((N, 1)), bits, tables)


@pytest.fixture(scope="module")
def queries() -> Asked:
    rng = np.random.default_rng(1)
    return Asked(rng.random((5, M)) < 0.5, rng.uniform(10.0, 500.0, (5, N)))


def test_comparing_all_equals_exact_search(
    index: ExampleIndex, queries: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    def farthest(codes: np.ndarray, count: int) -> dict[str, object]:
        tables = HashTables(codes, index.tables.chosen)
        search: Search = lambda value: np.append(tables.nearest_of_all(~value, count - 1).numbers, -1)  # noqa: E731
        return {"farthest": lambda: search}

    monkeypatch.setattr(index_searches, "library_searches", farthest)
    drawn, exact, ours, opposite = searched(index, queries, 20)
    assert drawn.recall is None
    assert exact.recall == 1.0
    assert opposite.recall == 0.0
    assert ours.recall is not None
    assert 0.0 < ours.recall < 1.0
    assert exact.best == pytest.approx(Curves(index, queries, 20).row(WHOLE).exact)


def test_faiss_compares_the_same_bits(index: ExampleIndex, queries: Asked) -> None:
    pytest.importorskip("faiss")
    flat = library_searches(index.tables.codes, 20, ("faiss",))["faiss flat"]()
    for value in queries.values:
        near = index.tables.nearest_of_all(value, 20)
        distance = np.bitwise_count(index.tables.codes[flat(value)] ^ packed(value[None])).sum(axis=1)
        np.testing.assert_array_equal(distance, near.distance)


def test_all_examples_hold_the_nearest_and_more_are_never_worse(index: ExampleIndex, queries: Asked) -> None:
    curves = Curves(index, queries, N)
    rows = [curves.row(WHOLE._replace(neighbours=k)) for k in (1, 20, 100, N)]
    for name in ("exact", "hashed"):
        errors = [getattr(row, name) for row in rows]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] == pytest.approx(rows[-1].nearest)
    assert rows[-1].fell_back == 1.0
    few = curves.row(WHOLE._replace(examples=100))
    assert few.nearest > rows[0].nearest
    shares = [curves.row(WHOLE._replace(tables=tables)).looked_at for tables in (4, TABLES, 16)]
    assert shares == sorted(shares)
    assert shares[0] < shares[-1] < 1.0


def test_invalid_requests_are_refused() -> None:
    for name, value, option in (
        ("examples", 10, "--sizes"), ("key_bits", 0, "--key-bits"), ("key_bits", M + 1, "--key-bits"),
        ("tables", -1, "--tables"), ("neighbours", N + 1, "--counts"),
    ):  # fmt: skip
        changed = {field: [WHOLE] for field in Made._fields} | {name: [WHOLE._replace(**{name: value})]}
        with pytest.raises(InputError, match=option):
            check(changed, 5, M)
    with pytest.raises(InputError, match="--queries"):
        check({}, 0, M)
