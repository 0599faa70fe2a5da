"""Ways to search the bits of an index, beside each other: ours, exact search, and libraries that are installed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.papers_elmo.index_libraries import Search, library_searches
from benchmarks.papers_elmo.index_pictures import Asked
from estimator.search.examples.hashing import HashTables, packed
from estimator.search.examples.index import ExampleIndex

_VALUES = 8  # that the drawn values are below, as most bins are


@dataclass(frozen=True)
class Row:
    """build_s: seconds to make it from the bits of the examples. query_ms: of a query, median. recall: of the
    neighbours, the share that are no farther in bits than the last of exact search. best [mm]: mean error of the best
    of the neighbours. The last two are None where the values are drawn."""

    name: str
    build_s: float
    query_ms: float
    recall: float | None
    best: float | None


def searched(index: ExampleIndex, queries: Asked, count: int) -> Iterator[Row]:
    """A row for each search of `count` neighbours, on one core."""
    tables = index.tables
    yield _by_values(len(tables), len(index.bits), count, len(queries.values))
    last = [tables.nearest_of_all(value, count).distance[-1] for value in queries.values]
    for name, build in _searches(tables, count).items():
        begin = time.perf_counter()
        search = build()
        build_s = time.perf_counter() - begin
        numbers, query_ms = _timed(search, queries.values)
        near = [n[n >= 0] for n in numbers]  # faiss returns -1 where it has no more
        codes = packed(queries.values)
        hits = [
            np.count_nonzero(np.bitwise_count(tables.codes[n] ^ code).sum(axis=1) <= farthest)
            for n, code, farthest in zip(near, codes, last, strict=True)
        ]
        best = [away[n].min() for away, n in zip(queries.away, near, strict=True)]
        yield Row(name, build_s, query_ms, float(np.mean(hits)) / count, float(np.mean(best)))


def _searches(tables: HashTables, count: int) -> dict[str, Callable[[], Search]]:
    """The makers of the searches, by name."""

    def all_compared() -> Search:
        return lambda value: tables.nearest_of_all(value, count).numbers

    def hashed() -> Search:
        made = HashTables(tables.codes, tables.chosen)
        return lambda value: made.nearest(value, count).numbers

    ours = f"ours, {tables.chosen.shape[0]} tables of {tables.chosen.shape[1]} bits"
    libraries = library_searches(tables.codes, count)
    return {"ours, all compared": all_compared, ours: hashed, **libraries}


def _by_values(examples: int, features: int, count: int, queries: int) -> Row:
    """Exact search by L2 over the values of the kept features: a product of a matrix (examples, features) with a query.

    An index keeps bits alone, so the values are drawn: the time is that of the true ones, the neighbours are
    meaningless.
    """
    rng = np.random.default_rng(0)
    known = np.empty((examples, features), np.float32)
    for values in known:
        values[:] = rng.integers(0, _VALUES, features)
    begin = time.perf_counter()
    squares = np.einsum("nf,nf->n", known, known)
    build_s = time.perf_counter() - begin

    def search(query: np.ndarray) -> np.ndarray:
        away = squares - 2.0 * (known @ query)
        near = np.argpartition(away, count)[:count]
        return np.asarray(near[np.argsort(away[near])])

    asked = rng.integers(0, _VALUES, (queries, features)).astype(np.float32)
    return Row("BLAS over values (drawn)", build_s, _timed(search, asked)[1], None, None)


def _timed(search: Search, queries: np.ndarray) -> tuple[list[np.ndarray], float]:
    """The result of each query, and the median time of one [ms]."""
    search(queries[0])  # whatever is compiled is compiled now
    numbers, seconds = [], []
    for query in queries:
        begin = time.perf_counter()
        numbers.append(search(query))
        seconds.append(time.perf_counter() - begin)
    return numbers, 1e3 * float(np.median(seconds))
