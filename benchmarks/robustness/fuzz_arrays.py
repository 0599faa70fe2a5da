"""Damage done inside of containers: arrays of an .npz, and rows of a run file whose checksums stay right."""

from __future__ import annotations

import io
import sqlite3
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from benchmarks.robustness.fuzz_mutations import NUMBERS, TEXTS, mutated
from estimator.data.formats.packing import pack, unpack

_TABLES = ("header", "frame", "state", "observation", "smoothed", "finished")
_PACKED = ("frame", "state", "observation", "smoothed")
_VALUES = (0.0, -1.0, -0.0, np.nan, np.inf, -np.inf, 1e308, 1e-308, 1e11, 0.5)
_CELLS: tuple[Any, ...] = (None, 0, -1, 2**62, 1.5, float("inf"), "text", b"", b"\0" * 8, b"x" * 100_000, "nan")


def mutated_npz(data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    """An .npz with damaged bytes, or with arrays of other values, types or shapes, or with a damaged header in it."""
    what = random.randrange(4)
    if what == 0:
        return mutated(data, "binary", random, others)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = random.choice(list(members))
    if what == 1:
        members[name] = mutated(members[name], random.choice(("text", "binary")), random, list(members.values()))
    else:
        members[name] = _npy(other_array(np.load(io.BytesIO(members[name])), random))
    if random.random() < 0.1:
        members[random.choice((name, "extra.npy"))] = members.pop(random.choice(list(members)))
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for key, content in members.items():
            archive.writestr(key, content)
    return file.getvalue()


def mutated_npy(data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    """An .npy with damaged bytes or head, or of other values, type or shape."""
    what = random.randrange(3)
    if what < 2:
        return mutated(data, ("text", "binary")[what], random, others)
    return _npy(other_array(np.load(io.BytesIO(data)), random))


def _npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def other_array(array: np.ndarray, random: Random) -> np.ndarray:
    """An array with another value, shape or type."""
    array = np.array(array)
    what = random.randrange(6)
    if what == 0:
        return array.reshape(-1)[: random.randrange(array.size + 1)]
    if what == 1:
        return np.stack([array] * random.choice((0, 1, 2)) or [np.zeros(0)])
    if what == 2:
        kinds = ("f4", "i8", "u1", "?", "c16", "U3", "S2", "U100000", "f8")
        with np.errstate(all="ignore"):
            try:
                return array.astype(random.choice(kinds))
            except (TypeError, ValueError):
                return np.array(random.choice(TEXTS).encode("utf-8", "ignore"))
    if what == 3 and array.size:
        return np.concatenate([array.reshape(-1)] * 2)
    if array.size and array.dtype.kind in "fiu":
        with np.errstate(all="ignore"):
            flat = array.astype(np.float64).reshape(-1)
            flat[random.randrange(array.size) if random.random() < 0.7 else slice(None)] = random.choice(_VALUES)
            changed = flat.reshape(array.shape)
            return changed if random.random() < 0.5 else np.nan_to_num(changed).astype(array.dtype)
    if array.size and array.dtype.kind == "U":
        texts = array.astype(object).reshape(-1)
        texts[random.randrange(array.size)] = random.choice(TEXTS).replace("\ud800", "?")
        return texts.astype(str).reshape(array.shape)
    return np.zeros(0)


def mutated_run(data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    """A run file with damaged bytes, or with rows changed as a program with a fault would write them."""
    what = random.randrange(10)
    if what == 0:
        return mutated(data, "binary", random, others)
    with tempfile.TemporaryDirectory(prefix="kinemode-fuzz-") as folder:
        path = Path(folder) / "a.run"
        path.write_bytes(data)
        connection = sqlite3.connect(path, isolation_level=None)
        try:
            _change_row(connection, what, random)
        except sqlite3.IntegrityError:
            connection.execute("DELETE FROM header")
        finally:
            connection.close()
        return path.read_bytes()


def _change_row(connection: sqlite3.Connection, what: int, random: Random) -> None:
    filled = [t for t in _TABLES if connection.execute(f"SELECT count(*) FROM {t}").fetchone()[0]]
    table = random.choice(filled if what < 3 else [t for t in filled if t in _PACKED])
    if what == 1 and random.random() < 0.5:
        connection.execute(random.choice((f"DROP TABLE {table}", f"ALTER TABLE {table} RENAME TO x")))
        return
    if what == 1:
        connection.execute(f"DELETE FROM {table} WHERE rowid = (SELECT min(rowid) FROM {table})")
        return
    if what in (3, 4):
        (text,) = connection.execute("SELECT json FROM header").fetchone()
        changed = mutated(text.encode(), "json", random, [text.encode()]).decode("utf-8", "replace")
        connection.execute("UPDATE header SET json = ?", (changed.replace("\ud800", "?"),))
        return
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    rows = [row[0] for row in connection.execute(f"SELECT rowid FROM {table}")]
    row = random.choice(rows)
    if what == 2:
        column = random.choice(columns)
        connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (random.choice(_CELLS), row))
        return
    (blob,) = connection.execute(f"SELECT data FROM {table} WHERE rowid = ?", (row,)).fetchone()
    changed_blob = _other_index(blob, random) if what == 9 else _other_content(blob, random)
    connection.execute(f"UPDATE {table} SET data = ? WHERE rowid = ?", (changed_blob, row))


def _other_content(blob: bytes, random: Random) -> bytes:
    arrays = dict(unpack(blob))
    name = random.choice(list(arrays))
    if random.random() < 0.15:
        arrays[random.choice((name, "other"))] = arrays.pop(name)
        arrays.pop(random.choice(list(arrays)))
    else:
        arrays[name] = other_array(arrays[name], random)
    return pack(arrays)


def _other_index(blob: bytes, random: Random) -> bytes:
    """The packed arrays with a changed index and a checksum that fits."""
    length, _ = struct.unpack_from("<II", blob)
    index = mutated(blob[8 : 8 + length], "json", random, [NUMBERS[0].encode()])
    body = index + blob[8 + length :]
    claimed = random.choice((len(index), len(index), 0, 2**32 - 1))
    return struct.pack("<II", claimed, zlib.crc32(body)) + body
