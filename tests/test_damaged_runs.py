"""Run files with right checksums but impossible content."""

from __future__ import annotations

import json
import re
import sqlite3
import struct
import zlib
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinemode as km
from benchmarks.robustness import fuzz_judge
from benchmarks.robustness.fuzz_corpus import Files
from benchmarks.robustness.fuzz_readers import CORPUS_OF
from estimator.data.formats.packing import pack, unpack
from estimator.runs.run_file import RunWriter
from humanoid.support.errors import InputError
from tests.changed_json import changed

judge = partial(fuzz_judge.judge, most_seconds=inf)


def altered(run: bytes, folder: Path, *statements: str, **rows: Callable[[dict[str, np.ndarray]], Any]) -> Path:
    """A run file after SQL statements, and with the arrays of the second row of some tables changed."""
    path = folder / "a.run"
    path.write_bytes(run)
    connection = sqlite3.connect(path, isolation_level=None)
    for statement in statements:
        connection.execute(statement)
    for table, change in rows.items():
        row = connection.execute(f"SELECT rowid, data FROM {table} ORDER BY rowid DESC LIMIT 1").fetchone()
        arrays = {name: array.copy() for name, array in unpack(row[1]).items()}
        change(arrays)
        connection.execute(f"UPDATE {table} SET data = ? WHERE rowid = ?", (pack(arrays), row[0]))
    connection.close()
    return path


def _set(name: str, value: Any) -> Callable[[dict[str, np.ndarray]], None]:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays[name] = value(arrays[name]) if callable(value) else np.asarray(value)

    return change


ROWS: dict[str, tuple[str, Callable[[dict[str, np.ndarray]], Any], str]] = {
    "no q": ("frame", lambda a: a.pop("q"), "frame 2: is damaged: q is missing"),
    "q too short": ("frame", _set("q", lambda q: q[:, :-1]), "q has the shape"),
    "q of texts": ("frame", _set("q", lambda q: q.astype(str)), "q has the shape .* and type <U"),
    "q is not finite": ("frame", _set("q", lambda q: q * np.nan), "q has numbers that are not finite"),
    "velocities of another body": ("frame", _set("velocity", lambda v: v[:, :-1]), "velocity has the shape"),
    "no price": ("frame", lambda a: a.pop("origin_price"), "origin_price is missing"),
    "families of numbers": ("frame", _set("origin_family", lambda f: np.zeros(len(f))), "origin_family has the shape"),
    "unknown families": ("frame", _set("origin_family", lambda f: np.full(len(f), "x")), "origin_family: 'x'"),
    "payments of two": ("frame", _set("origin_paid", lambda p: np.stack([p, p], 1)), "origin_paid has the shape"),
    "an impossible past": (
        "frame",
        _set("origin_q_previous", lambda q: q + np.inf),
        "origin_q_previous is not a config",
    ),
    "extra with an invalid name": (
        "frame",
        lambda a: a.update({"extra_No Name": np.zeros(2)}),
        "'No Name' is not called by",
    ),
    "extra of many axes": ("frame", lambda a: a.update(extra_x=np.zeros((1,) * 5)), "extra array x has the shape"),
    "extra of bytes": ("frame", lambda a: a.update(extra_x=np.array(b"x")), r"extra array x has the .* type \|S1"),
    "extra that is not text": (
        "frame",
        lambda a: a.update(extra_x=np.full(1, 0x7FFFFFFF, "<u4").view("<U1")),
        "extra_x has invalid characters",
    ),
    "too many extras": ("frame", lambda a: a.update({f"extra_x{i}": np.zeros(1) for i in range(99)}), "at most 64"),
    "extra of another kind": ("frame", _set("extra_searches", np.zeros((2, 2))), "array searches: is of different"),
    "no weight": ("frame", _set("weight", lambda w: 0.0 * w), "weight has negative numbers, or none above zero"),
    "a parent that does not exist": ("frame", _set("parent", lambda p: p + 90), "parent 9. is not a hypothesis"),
    "a frame beyond": ("frame", _set("index", 10**9), "index 1000000000 of 3 frames"),
    "covariance": ("frame", _set("covariance", lambda c: c + np.inf), "covariance has numbers that are not finite"),
    "an invalid text": (
        "frame",
        _set("status", np.full(1, 0x7FFFFFFF, "<u4").view("<U1")[0:1].reshape(())),
        "status",
    ),
    "pixels of another camera": (
        "observation",
        _set("pixels", lambda p: p[:, :-1]),
        "keypoints of frame 2.*pixels has",
    ),
    "confidence": ("observation", _set("confidence", lambda c: c + 5.0), "confidence is not between 0 and 1"),
    "half of an estimate": (
        "observation",
        lambda a: a.update(estimate_q=np.zeros(8)),
        "keypoints of frame 2.*estimate_covariance is missing",
    ),
    "an estimate without spread": (
        "observation",
        lambda a: a.update(estimate_q=np.zeros(8), estimate_covariance=-np.eye(8)),
        "covariance is not symmetric and positive",
    ),
    "half of a lifted pose": ("observation", lambda a: a.update(lifted_share=np.array(0.5)), "lifted is missing"),
    "a lifted pose of two shares": (
        "observation",
        lambda a: a.update(lifted=np.zeros((a["pixels"].shape[1], 3)), lifted_share=np.array(2.0)),
        "lifted has invalid numbers",
    ),
    "smoothed": ("smoothed", _set("q", lambda q: q + np.inf), "smoothed trajectory.*not a configuration"),
    "a smoothed covariance": ("smoothed", _set("covariance", lambda c: 1e38 * c), "covariance has invalid numbers"),
    "smoothed weights": ("smoothed", _set("weight", lambda w: w + 1e308), "weight has invalid numbers"),
    "state": ("state", _set("q", lambda q: q[:, :3]), "state: is damaged: q has the shape"),
    "state without a covariance": (
        "state",
        _set("covariance", lambda c: -c),
        "covariance is not symmetric and positive",
    ),
    "state of little covariance": ("state", _set("covariance", lambda c: 1e-300 * c), "covariance is not symmetric"),
    "state of another root": (
        "state",
        _set("last_root", lambda q: q[:, :3]),
        "state: is damaged: last_root has the shape",
    ),
    "state without a last time": ("state", lambda a: a.pop("last_time"), "state: is damaged: last_time is missing"),
    "state without weights": ("state", lambda a: a.pop("weights"), "state: is damaged: weights is missing"),
}


@pytest.mark.parametrize("name", ROWS)
def test_invalid_rows_of_a_run(name: str, valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    table, change, message = ROWS[name]
    reader = "state" if table == "state" else "run"
    run = valid[CORPUS_OF.get(reader, reader)][0]["arm8.run"]
    verdict = judge(reader, altered(run, tmp_path, **{table: change}))
    assert verdict.outcome == "refused", verdict
    assert re.search(message, verdict.message), verdict.message


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("DELETE FROM header", "it has no header"),
        ("UPDATE header SET json = 3", "header"),
        ("UPDATE header SET json = '[1]'", "header: an object"),
        ("DELETE FROM frame WHERE position = 1", "."),
        ("UPDATE frame SET position = 7 WHERE position = 1", "1 of its frames are missing"),
        ("INSERT INTO frame VALUES (3, x'00')", "it has 4 frames of 3"),
        ("UPDATE frame SET data = 'text' WHERE position = 1", "frame 1: is damaged: too short"),
        ("DROP TABLE observation", "no such table"),
    ],
)
def test_invalid_tables_of_a_run(
    statement: str, message: str, valid: Mapping[str, list[Files]], tmp_path: Path
) -> None:
    verdict = judge("run", altered(valid["run"][0]["arm8.run"], tmp_path, statement))
    assert verdict.outcome == "refused", verdict
    assert re.search(message, verdict.message), verdict.message


HEADERS = {
    "cameras": ([], "cameras of different names are needed"),
    "cameras.0.K": ([[1, 2], [3]], "cameras\\[0\\].K"),
    "image sizes": (3, "image sizes: an object"),
    "frame times": ([0.0, 0.0, 1.0], "frame times: is damaged: rising times"),
    "seed": (1.5, "seed: is damaged"),
    "base": ("flying", "base: is damaged.*free, fixed"),
    "notes": ([3], "notes: is damaged"),
    "clips": ({"k": 3}, "clips: is damaged"),
    "subject": (None, "subject: is damaged"),
    "settings": ([], "settings: an object"),
}


@pytest.mark.parametrize("place", HEADERS)
def test_invalid_headers(place: str, valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    new, message = HEADERS[place]
    path = altered(valid["run"][0]["arm8.run"], tmp_path)
    connection = sqlite3.connect(path, isolation_level=None)
    header = json.loads(connection.execute("SELECT json FROM header").fetchone()[0])
    connection.execute("UPDATE header SET json = ?", (changed(header, place, new).decode(),))
    connection.close()
    with pytest.raises(InputError, match=message) as caught:
        km.open_run(path)
    assert str(caught.value).count("a.run: ") == 1


@pytest.mark.parametrize(
    "index",
    [
        "3", "[3]", '[["a", "f8", 3]]', '[["a", "O", [1]]]', '[["a", "f8", [-1]]]', '[["a", "f8,f8", [1]]]',
        '[["a", "<f8", [4294967296, 4294967296]]]', '[["a", "U0", [1000000, 1000000]]]',
        '[["a", "f8", [0, 9000000000000000000]]]', "[" * 100_000,
    ],
)  # fmt: skip
def test_packed_arrays_with_an_invalid_index(index: str) -> None:
    body = index.encode() + bytes(64)
    with pytest.raises(ValueError, match=r"array 'a'|its index|Expecting"):
        unpack(struct.pack("<II", len(index), zlib.crc32(body)) + body)


def test_a_state_of_another_frame_is_not_resumed(valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    path = altered(valid["unfinished run"][0]["arm8.run"], tmp_path, "UPDATE state SET next = 1")
    with pytest.raises(InputError, match="state: is damaged: it is not of the last of 2 frames"):
        RunWriter.resume(path, km.open_run(path).header)
