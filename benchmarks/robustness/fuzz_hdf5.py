"""HDF5 files with one member of another type, shape or text than it should have, which random byte damage rarely
produces."""

from __future__ import annotations

import io
from collections.abc import Sequence
from random import Random
from typing import Any

import h5py
import numpy as np

from benchmarks.robustness.fuzz_mutations import mutated


def mutated_hdf5(data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    """Damaged bytes, or a whole file of which one to three members or attributes are damaged or left out."""
    if random.random() < 0.4:
        return mutated(data, "binary", random, others)
    content = io.BytesIO(data)
    with h5py.File(content, "r+") as file:
        for _ in range(random.choice((1, 1, 2, 3))):
            _damage(file, random)
    return content.getvalue()


def _damage(file: h5py.File, random: Random) -> None:
    paths: list[str] = []
    file.visit(paths.append)
    if not paths:
        return
    path = random.choice(paths)
    names = list(file[path].attrs)
    if names and random.random() < 0.6:
        name = random.choice(names)
        old = file[path].attrs[name]
        del file[path].attrs[name]
        if random.random() < 0.9:
            file[path].attrs[name] = _other(old, random)
        return
    old = file[path][()] if isinstance(file[path], h5py.Dataset) else None
    attributes = dict(file[path].attrs)
    del file[path]
    if random.random() < 0.9:
        file[path] = _other(old, random)
        file[path].attrs.update(attributes)


def _other(value: Any, random: Random) -> Any:
    """Something in the place of a value: damaged text, an array of another shape or type, or with other numbers."""
    if isinstance(value, (bytes, str)) and random.random() < 0.8:
        text = value if isinstance(value, bytes) else value.encode()
        damaged = mutated(text, random.choice(("text", "binary")), random, [text])[:30_000]
        return np.bytes_(damaged) if isinstance(value, bytes) else damaged.decode("utf-8", "replace").replace("\0", "?")
    array = np.asarray(0 if value is None else value)
    array = array if array.dtype.kind in "biufS" else np.arange(4)
    if array.dtype.kind in "iuf" and array.size and random.random() < 0.5:
        array = array.copy()
        worst = (np.nan, np.inf, -1e30, 1e9, 0.0) if array.dtype.kind == "f" else (0, 1, 100)
        array.flat[random.randrange(array.size)] = random.choice(worst)
        return array
    return random.choice((
        array[:0] if array.ndim else np.zeros(0), array[None], np.zeros((2, 3, 4)), np.array([b"\xff", b"a"]), 3,
        b"text", np.zeros((1, 2, 17, 3)), np.zeros(2, [("index", "<i8"), ("x", "<f4")]), h5py.Empty("f4"),
        array.T if array.ndim > 1 else np.ones(2, bool),
    ))  # fmt: skip
