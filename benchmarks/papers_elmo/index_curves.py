"""The quality of an index's neighbours by its make: examples, bits of a key, tables, neighbours."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.papers_elmo.index_pictures import Asked
from estimator.search.examples.hashing import HashTables, random_keys
from estimator.search.examples.index import ExampleIndex

_KEYS = 54321  # of the keys that are drawn again


class Made(NamedTuple):
    """A lookup: numbers of examples, bits of a key, tables, and neighbours."""

    examples: int
    key_bits: int
    tables: int
    neighbours: int


@dataclass(frozen=True)
class Row:
    """A row for one make: mean error of the best of the neighbours [mm] over all queries, by who chose them, the index
    by its buckets (`hashed`), exact search by all bits, or chance; `nearest`: of all examples; looked_at: share of the
    examples that a query was compared with; fell_back: share of the queries whose buckets had too few; milliseconds of
    a query, median."""

    made: Made
    nearest: float
    exact: float
    hashed: float
    chance: float
    looked_at: float
    fell_back: float
    query_ms: float


class Curves:
    """Rows of an index for some queries; exact search, the same whatever the keys, is done once for each size."""

    def __init__(self, index: ExampleIndex, queries: Asked, most: int) -> None:
        self._index, self._asked, self._most = index, queries, most
        self._exact: dict[int, np.ndarray] = {}

    def row(self, made: Made) -> Row:
        """The row of an index made so, the chosen examples being its first; made.neighbours at most `most`."""
        tables = self._made(made)
        rng = np.random.default_rng(tuple(made))
        seconds, neighbours, drawn = [], [], []
        for value in self._asked.values:
            begin = time.perf_counter()
            neighbours.append(tables.nearest(value, made.neighbours))
            seconds.append(time.perf_counter() - begin)
            drawn.append(rng.choice(made.examples, made.neighbours, replace=False))
        return Row(
            made,
            nearest=float(self._asked.away[:, : made.examples].min(axis=1).mean()),
            exact=float(self._exact_best(tables)[:, made.neighbours - 1].mean()),
            hashed=self._best([near.numbers for near in neighbours]),
            chance=self._best(drawn),
            looked_at=float(np.mean([near.comparisons for near in neighbours])) / made.examples,
            fell_back=float(np.mean([near.fell_back for near in neighbours])),
            query_ms=1e3 * float(np.median(seconds)),
        )

    def _best(self, chosen: list[np.ndarray]) -> float:
        """Mean error of the best of those chosen for each query [mm]."""
        return float(np.mean([away[numbers].min() for away, numbers in zip(self._asked.away, chosen, strict=True)]))

    def _made(self, made: Made) -> HashTables:
        """Tables with the keys of the index, where it has as many, otherwise with newly drawn ones."""
        codes, chosen = self._index.tables.codes[: made.examples], self._index.tables.chosen
        if chosen.shape != (made.tables, made.key_bits):
            chosen = random_keys(len(self._index.bits), np.random.default_rng(_KEYS), made.tables, made.key_bits)
        elif len(codes) == len(self._index.q):
            return self._index.tables
        return HashTables(codes, chosen)

    def _exact_best(self, tables: HashTables) -> np.ndarray:
        """The best of the first 1, 2, ... `most` of exact search by all bits, (Q, most) [mm]."""
        if len(tables) not in self._exact:
            near = [tables.nearest_of_all(value, self._most).numbers for value in self._asked.values]
            of_near = [away[numbers] for away, numbers in zip(self._asked.away, near, strict=True)]
            self._exact[len(tables)] = np.minimum.accumulate(of_near, axis=1)
        return self._exact[len(tables)]
