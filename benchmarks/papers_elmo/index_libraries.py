"""Searches of bits by other libraries, `faiss-cpu` and `pynndescent`, each on one core; those that are not installed
are left out."""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib.util import find_spec
from typing import Any

import numba
import numpy as np

Search = Callable[[np.ndarray], np.ndarray]
"""From the bits of a query (M,) bool to the numbers of its neighbours."""
_PACKAGES = {"faiss": "faiss-cpu", "pynndescent": "pynndescent"}
_LISTS, _PROBED = 256, 16  # of faiss' inverted file: about sqrt(60,000); of them searched
_LINKS, _BREADTH = 32, 128  # of faiss' graph: of an example; candidates of a search
_TO_LEARN_A_LIST = 39  # examples that faiss wants to learn the middle of a list from
_FEW = 200
_SEED = 0


def missing() -> list[str]:
    """Packages that would bring more rows."""
    return [package for module, package in _PACKAGES.items() if find_spec(module) is None]


def library_searches(
    codes: np.ndarray, count: int, modules: Collection[str] = tuple(_PACKAGES)
) -> dict[str, Callable[[], Search]]:
    """The makers of each search of `count` neighbours among codes (N, W) uint64, by its name; of the modules that are
    installed."""
    known = np.ascontiguousarray(codes).view(np.uint8)
    made: dict[str, Callable[[], Search]] = {}
    here = {name for name in modules if find_spec(name) is not None}
    if "faiss" in here:
        made["faiss flat"] = lambda: _faiss_flat(known, count)
        made[f"faiss IVF, {_PROBED} of {_LISTS} lists"] = lambda: _faiss_lists(known, count)
        made[f"faiss HNSW, {_LINKS} links"] = lambda: _faiss_graph(known, count)
    if "pynndescent" in here:
        _descent(known[:_FEW], 1)  # compiles it, which takes longer than to build an index
        made["pynndescent"] = lambda: _descent(known, count)
    return made


def _faiss_flat(known: np.ndarray, count: int) -> Search:
    import faiss

    return _filled(faiss.IndexBinaryFlat(8 * known.shape[1]), known, count)


def _faiss_lists(known: np.ndarray, count: int) -> Search:
    import faiss

    bits = 8 * known.shape[1]
    middles = faiss.IndexBinaryFlat(bits)
    index = faiss.IndexBinaryIVF(middles, bits, min(_LISTS, max(1, len(known) // _TO_LEARN_A_LIST)))
    index.nprobe = _PROBED
    return _filled(index, known, count)


def _faiss_graph(known: np.ndarray, count: int) -> Search:
    import faiss

    index = faiss.IndexBinaryHNSW(8 * known.shape[1], _LINKS)
    index.hnsw.efSearch = _BREADTH
    return _filled(index, known, count)


def _filled(index: Any, known: np.ndarray, count: int) -> Search:
    import faiss

    faiss.omp_set_num_threads(1)
    if not index.is_trained:
        index.train(known)
    index.add(known)
    return lambda value: np.asarray(index.search(_bytes(value, known.shape[1])[None], count)[1][0])


def _descent(known: np.ndarray, count: int) -> Search:
    import pynndescent

    numba.set_num_threads(1)
    index = pynndescent.NNDescent(known, metric="bit_hamming", n_neighbors=count, random_state=_SEED, n_jobs=1)
    index.prepare()
    return lambda value: np.asarray(index.query(_bytes(value, known.shape[1])[None], k=count)[0][0])


def _bytes(value: np.ndarray, count: int) -> np.ndarray:
    """Bits (M,) bool in so many bytes, filled up with zeros, as codes are."""
    filled = np.zeros(count, np.uint8)
    bits = np.packbits(value)
    filled[: len(bits)] = bits
    return filled
