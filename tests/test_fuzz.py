"""Damaged files, and what other programs would call nonsense: a result or one line that says what is wrong."""

from __future__ import annotations

import json
import pickle
import re
import sqlite3
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinemode as km
from benchmarks import fuzz, fuzz_commands
from benchmarks.fuzz_cases import Case as Damaged
from benchmarks.fuzz_corpus import SIZE, Files, corpus, facing, npz
from benchmarks.fuzz_judge import judge, judged_message, prepare, write
from benchmarks.fuzz_readers import CORPUS_OF, READERS
from benchmarks.fuzz_texts import ARM, ARM_LANDMARKS, ARM_MESHES, BVH_CMU, BVH_PLAIN
from benchmarks.fuzz_workers import verdicts
from estimator.formats.packing import pack, unpack
from estimator.formats.run_file import RunWriter
from estimator.imaging.cues import ImageCues
from estimator.imaging.foreground import silhouette_of
from estimator.search.mode_search import ModeSearch
from estimator.trackers.registry import make_tracker
from humanoid.body import Body
from humanoid.errors import LONGEST, InputError, shown
from humanoid.solids import solids_of
from humanoid.subject import load_subject
from kinemode.energy_parts import Case, energy_parts
from tests.builders import body_of, observe
from tests.fuzz_faults import judge as faulty

_SLICE = 300  # damaged files in the test, of the 100,000 of the measure


@pytest.fixture(scope="module")
def files() -> Mapping[str, list[Files]]:
    return corpus(("arm8",))


# --- what is said ---


def test_a_message_is_one_short_line_with_both_ends_of_what_it_quotes() -> None:
    name = "first" + 100_000 * "x" + "last"
    error = InputError("a.json", f"the name {name!r} is used twice", place=name, remedy=f"one of {name}, b")
    assert len(str(error)) <= LONGEST
    assert str(error).startswith("a.json: first")
    assert "last' is used twice (one of first" in str(error)
    assert error.place == name  # nothing is lost to a program
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert "\x1b" not in str(InputError("a", "b\n\x1b[31mc\u202e"))
    assert str(InputError("a", "b\n\x1b[31mc")) == "a: b\\n\\x1b[31mc"
    whole = InputError("a.json", "p" * 300, remedy="r" * 150)
    assert "p" * 300 in str(whole)
    assert "r" * 150 in str(whole)


@pytest.mark.parametrize("lengths", [(1, 1, 1, 9999), (9999, 0, 9999, 0), (600, 600, 600, 600), (0, 499, 0, 0)])
def test_every_part_of_a_long_message_has_its_share(lengths: tuple[int, ...]) -> None:
    source, place, problem, remedy = (letter * n for letter, n in zip("abcd", lengths, strict=True))
    told = str(InputError(source, problem, place=place, remedy=remedy))
    assert len(told) <= LONGEST
    assert all(letter in told for letter, n in zip("abcd", lengths, strict=True) if n)
    assert max(lengths) < 500 or len(told) > LONGEST - 10  # no more is left out than has to be


def test_what_cannot_be_shown_is_described() -> None:
    assert shown(10**5000) == "a number of thousands of digits"
    assert len(shown("x" * 1000)) == 60
    nested: list[Any] = []
    for _ in range(100_000):
        nested = [nested]
    assert shown(nested) == "a list"


# --- what the measure would call a fault, and that it does ---


def test_bad_messages_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    assert judged_message(f"{path}: is empty", path)[0] == "refused"
    assert judged_message(f"{path}: is damaged: {path}: is empty", path)[0] == "wrapped twice"
    assert judged_message("x" * 501, path)[0] == "long message"
    assert judged_message("two\nlines", path)[0] == "message of several lines"
    judged = fuzz_commands.judged_output
    assert judged(0, "note: all is well\n")[0] == "read"
    assert judged(2, "tracking: 1/3\nerror: a: is empty\n")[0] == "refused"
    assert judged(2, "error: a\nerror: b\n")[0] == "not one line"
    assert judged(2, "error: " + "x" * 501)[0] == "long message"
    assert judged(1, "internal error: KeyError: 'q'")[0] == "exit code 1"
    assert judged(0, "note: " + "x" * 600)[0] == "long message"
    assert judged(0, "note: overflow encountered in multiply")[0] == "warned"


def test_workers_outlive_what_damaged_files_do_to_them() -> None:
    cases = [Damaged(name, 0, i) for i, name in enumerate(("good", "crash", "good", "print", "hang", "good"))]
    found = {case.number: verdict for case, verdict in verdicts(faulty, "corpus", cases, 1, batch=6, patience=0.5)}
    outcomes = [found[i].outcome for i in range(len(cases))]
    assert outcomes == ["read", "crash", "read", "printed", "hang", "read"]
    assert found[0].said == "corpus"
    assert "3" in found[1].said
    assert "libfoo" in found[3].said


def test_equal_seeds_make_equal_damage(files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    for name in READERS:
        contents = []
        for folder in ("a", "b"):
            prepare(Damaged(name, 5, 3), files, tmp_path / folder)
            contents.append({p.name: p.read_bytes() for p in (tmp_path / folder).iterdir()})
        assert contents[0] == contents[1]


def test_valid_files_are_read(files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    """Or the damage would be found in what was damaged before."""
    for name in READERS:
        for seed in files[CORPUS_OF.get(name, name)]:
            write(seed, tmp_path / "valid")
            verdict = judge(name, tmp_path / "valid" / next(iter(seed)))
            assert verdict.outcome == "read", (name, verdict)


def test_damaged_files_give_a_result_or_one_line(files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    noisy = ("mesh", "film", "pictures", "background")  # their libraries print, or end a process: left to the workers
    names = [name for name in READERS if name not in noisy]
    faults = []
    for case in fuzz.cases(_SLICE, 7, names):
        verdict = judge(case.reader, prepare(case, files, tmp_path / "case"))
        if not verdict.good and verdict.outcome != "memory":  # of the whole test process
            faults.append((str(case), verdict))
    assert not faults


# --- each finding ---


def refused(reader: str, name: str, content: bytes, folder: Path, **others: bytes) -> str:
    """What a reader says of a file it has to refuse."""
    path = folder / name
    path.write_bytes(content)
    for other, data in others.items():
        (folder / other.replace("__", ".")).write_bytes(data)
    verdict = judge(reader, path)
    assert verdict.outcome == "refused", verdict
    return verdict.said


def changed(value: Any, place: str, new: Any) -> bytes:
    """JSON of nested values with one of them replaced; `place` has dots between keys and indices."""
    value = json.loads(json.dumps(value))
    *path, last = [int(key) if key.isdecimal() else key for key in place.split(".")]
    inner = value
    for key in path:
        inner = inner[key]
    inner[last] = new
    return json.dumps(value).encode()


KEYPOINTS = {
    "no names": ("names", [], "names: a list of names is needed, one for each keypoint"),
    "an empty name": ("names.0", "", "names: a list of names is needed"),
    "huge integer": ("frames.0.keypoints.0.0", 10**400, "frame 0.*beyond all measure.*below 1e\\+07"),
    "far pixel": ("frames.0.keypoints.0.0", 1e11, "keypoint 0.*beyond all measure.*below 1e\\+07"),
    "image size": ("image_size", [20_000, 480], "image_size.*1 to 16384"),
    "frame rate": ("fps", 1e5, "fps: 100000 cannot be .*0.5 to 2000"),
    "slow": ("fps", 1e-300, "fps: 1e-300 cannot be .*0.5 to 2000"),
}
CAMERAS = {
    "focal length": ("cameras.0.K.0.0", 9e6, "K: a focal length of 9e\\+06 pixels cannot be .*1 to 1e\\+06"),
    "short focal length": ("cameras.0.K.1.1", 1e-5, "a focal length of 1e-05 pixels cannot be"),
    "huge focal length": ("cameras.0.K.0.0", 1e11, "beyond all measure"),
    "huge integer": ("cameras.0.K.0.0", 10**400, "K: has a number.*beyond all measure .numbers are finite"),
    "image size": ("cameras.1.image_size", [10**6, 10**6], "image_size.*1 to 16384"),
    "distortion": ("cameras.1.distortion.0", 1e6, "distortion: has a coefficient beyond all measure .up to 10000"),
    "far away": ("cameras.1.t.0", 1e8, "t: .*beyond all measure"),
}


@pytest.mark.parametrize("name", KEYPOINTS)
def test_keypoints_that_cannot_be(name: str, files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    place, new, told = KEYPOINTS[name]
    named = json.loads(next(f["keypoints.json"] for f in files["keypoints"] if b'"detector"' in f["keypoints.json"]))
    assert re.search(told, refused("keypoints", "k.json", changed(named, place, new), tmp_path))


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_that_cannot_be(name: str, files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    place, new, told = CAMERAS[name]
    value = json.loads(files["cameras"][0]["cameras.json"])
    assert re.search(told, refused("cameras", "c.json", changed(value, place, new), tmp_path))


@pytest.mark.parametrize("number", ["9" * 5000, 400_000])
def test_frame_numbers_that_cannot_be(number: int | str, files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    """They would fill the memory with frames that nobody has."""
    value = json.loads(next(f["keypoints.json"] for f in files["keypoints"] if b"image_id" in f["keypoints.json"]))
    said = refused("keypoints", "k.json", changed(value, "3.image_id", f"{number}.jpg"), tmp_path)
    assert re.search("no likely frame number|number the frames from the clip's first", said)


_DEEP = "".join(f"JOINT a{i}\n{{\nOFFSET 0 0 0\nCHANNELS 0\n" for i in range(300))
BVH = {
    "no Spine1": (BVH_CMU, "Spine1", "Spine9", ""),
    "far away": (BVH_PLAIN, "1 17 2", "1 17e9 2", "line .*beyond all measure .*below 1e\\+07"),
    "leaves": (BVH_PLAIN, "1 17 2", "999999 17 2", "over 10000 m from where the motion began"),
    "fast": (
        BVH_PLAIN,
        "Frame Time: 0.02",
        "Frame Time: 1e-300",
        "1e-300 s from frame to frame cannot be .0.0005 to 2",
    ),
    "no shank": (BVH_PLAIN, "0 -7 0", "0 0 0", "left_knee and left_ankle are at the same place"),
    "deep": (BVH_PLAIN, "End Site", _DEEP, "nested over 200 deep"),
}


@pytest.mark.parametrize("name", BVH)
def test_motion_capture_that_cannot_be(name: str, tmp_path: Path) -> None:
    text, old, new, told = BVH[name]
    assert old in text
    path = tmp_path / "a.bvh"
    path.write_text(text.replace(old, new, 1))
    verdict = judge("bvh", path)
    assert verdict.outcome == ("refused" if told else "read"), verdict
    assert re.search(told, verdict.said)


SETTINGS = {
    "huge": ("[cost]\nnu = 1e308", "\\[cost\\] nu: 1e\\+308 cannot work .*at most 1e\\+09"),
    "tiny": ("[cost]\nnu = 1e-308", "1e-308 cannot work"),
    "tiny that may be zero": ("[css]\nflip_penalty = 1e-308", "1e-308 cannot work .*0 or more"),
    "infinite": ("[cost]\nnu = inf", "inf cannot work"),
    "many": ("[css]\nsamples = 1000000000", "1000000000 cannot work .*at most 100000"),
    "thousands of digits": ("[css]\nsamples = " + 5000 * "9", "is not TOML"),
    "in hexadecimal": ("[css]\nsamples = 0x" + 5000 * "f", "a number of thousands of digits cannot work"),
    "long value": (f"[css]\nshape = 3\n[cost]\npotential = '{100_000 * 'x'}'", "xxx \\.\\.\\. xxx|3 is no text"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_that_cannot_be(name: str, tmp_path: Path) -> None:
    text, told = SETTINGS[name]
    assert re.search(told, refused("settings", "s.toml", text.encode(), tmp_path))


_POINTS = np.zeros((3, 2, 3))
REFERENCES: dict[str, tuple[dict[str, Any], str]] = {
    "infinite": ({"points": np.full((3, 2, 3), np.inf)}, "infinite, or beyond all measure .metres below"),
    "far": ({"points": np.full((3, 2, 3), 1e8)}, "beyond all measure"),
    "texts": ({"points": np.full((3, 2, 3), "1")}, "points: numbers are needed"),
    "complex": ({"points": _POINTS + 1j}, "points: numbers are needed"),
    "nothing": ({"points": np.zeros((0, 2, 3))}, "has no points"),
    "numbers for names": ({"names": np.zeros(2)}, "names: a list of names is needed"),
    "rates": ({"fps": np.array([30.0, 60.0])}, "fps: one number is needed"),
    "frame rate": ({"fps": np.array(1e9)}, "fps: .*cannot be.*0.5 to 2000"),
    "no character": (
        {"names": np.array([0x7FFFFFFF, 0], np.uint32).view("<U1")},
        "names: has characters that are none",
    ),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_references_that_cannot_be(name: str, tmp_path: Path) -> None:
    arrays = {"points": _POINTS, "names": np.array(["a", "b"]), "fps": np.array(30.0)}
    new, told = REFERENCES[name]
    assert re.search(told, refused("reference", "r.npz", npz(arrays | new), tmp_path))


def test_damaged_references(files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    good = bytearray(files["reference"][0]["reference.npz"])
    place = good.index(b"PK\x01\x02") + 6  # the version of zip that is needed
    good[place : place + 2] = b"\xff\xff"
    assert "cannot be read" in refused("reference", "r.npz", bytes(good), tmp_path)
    trc = files["trc"][0]["reference.trc"].decode()
    head, row = trc.split("\n6\t")[0].splitlines()[:5], trc.splitlines()[6]
    for lines, told in (
        ([*head[:3], "Frame#\tTime", "", row], "line 4: has no markers"),
        ([*head, row, row, row], "time: the times do not rise"),
        ([*head, row.replace(row.split("\t")[3], "1e300")], "line 6: has a number beyond all measure"),
        ([*head], "has no points|is no TRC file"),
    ):
        assert re.search(told, refused("trc", "r.trc", "\n".join(lines).encode(), tmp_path))


def test_landmark_files_of_endless_joints_load(tmp_path: Path) -> None:
    """A limit made for a joint that had none needs what URDF parsers ask of limits."""
    (tmp_path / "arm.urdf").write_text(ARM_MESHES[""])
    (tmp_path / "arm.landmarks.toml").write_text(ARM_LANDMARKS)
    body = Body(load_subject(tmp_path / "arm.urdf"))
    assert solids_of(body, "visual")
    assert body.bounded_q.size == 2
    numbers = "[limits]\nelbow = [0x" + 5000 * "f" + ", 1]"
    said = refused("landmark file", "arm.landmarks.toml", numbers.encode(), tmp_path)
    assert "not [lower, upper]" in said


def test_every_shape_that_is_offered_loads(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    box = '<box size="1 1 1"/>'
    said = refused("urdf", path.name, ARM.replace(box, "<capsule radius='1' length='1'/>").encode(), tmp_path)
    offered = said.partition("shapes: ")[2].partition(")")[0].split(", ")
    assert {"box", "cylinder", "mesh"} < set(offered)
    assert "capsule" not in offered
    for shape in sorted(set(offered) - {"mesh"}):
        path.write_text(ARM.replace(box, f'<{shape} size="1 1 1" radius="1" length="1"/>'))
        assert judge("urdf", path).outcome == "read", shape


# --- run files whose checksums are right ---


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
    "no weight": ("frame", _set("weight", lambda w: 0.0 * w), "weight has negative numbers, or none above zero"),
    "a parent nobody is": ("frame", _set("parent", lambda p: p + 90), "parent 9. is no hypothesis"),
    "a frame beyond": ("frame", _set("index", 10**9), "index 1000000000 of 3 frames"),
    "covariance": ("frame", _set("covariance", lambda c: c + np.inf), "covariance has numbers that are not finite"),
    "a text that is none": (
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
    "smoothed": ("smoothed", _set("q", lambda q: q + np.inf), "smoothed trajectory.*no configuration"),
    "state": ("state", _set("q", lambda q: q[:, :3]), "state: is damaged: q has the shape"),
    "state without weights": ("state", lambda a: a.pop("weights"), "state: is damaged: weights is missing"),
}


@pytest.mark.parametrize("name", ROWS)
def test_rows_of_a_run_that_cannot_be(name: str, files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    table, change, told = ROWS[name]
    reader = "state" if table == "state" else "run"
    run = files[CORPUS_OF.get(reader, reader)][0]["arm8.run"]
    verdict = judge(reader, altered(run, tmp_path, **{table: change}))
    assert verdict.outcome == "refused", verdict
    assert re.search(told, verdict.said), verdict.said


@pytest.mark.parametrize(
    ("statement", "told"),
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
def test_tables_of_a_run_that_cannot_be(
    statement: str, told: str, files: Mapping[str, list[Files]], tmp_path: Path
) -> None:
    verdict = judge("run", altered(files["run"][0]["arm8.run"], tmp_path, statement))
    assert verdict.outcome == "refused", verdict
    assert re.search(told, verdict.said), verdict.said


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
def test_headers_that_cannot_be(place: str, files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    new, told = HEADERS[place]
    path = altered(files["run"][0]["arm8.run"], tmp_path)
    connection = sqlite3.connect(path, isolation_level=None)
    header = json.loads(connection.execute("SELECT json FROM header").fetchone()[0])
    connection.execute("UPDATE header SET json = ?", (changed(header, place, new).decode(),))
    connection.close()
    with pytest.raises(InputError, match=told) as caught:
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
def test_packed_arrays_with_an_index_that_cannot_be(index: str) -> None:
    body = index.encode() + bytes(64)
    with pytest.raises(ValueError, match=r"array 'a'|its index|Expecting"):
        unpack(struct.pack("<II", len(index), zlib.crc32(body)) + body)


def test_a_state_of_another_frame_is_not_resumed(files: Mapping[str, list[Files]], tmp_path: Path) -> None:
    path = altered(files["unfinished run"][0]["arm8.run"], tmp_path, "UPDATE state SET next = 1")
    with pytest.raises(InputError, match="state: is damaged: it is not of the last of 2 frames"):
        RunWriter.resume(path, km.open_run(path).header)


# --- the front door ---


ARGUMENTS: dict[str, tuple[dict[str, Any], str]] = {
    "a model": ({"subject": "MODEL"}, "subject: cannot be of type pinocchio.Model .give a subject from load_subject"),
    "no subject": ({"subject": None}, "subject: cannot be None"),
    "frames": ({"clips": np.zeros((2, 4, 4, 3))}, "clips: cannot be of type numpy.ndarray .give a path"),
    "keypoints": ({"keypoints": np.zeros((2, 17, 3))}, "keypoints: cannot be of type numpy.ndarray"),
    "a number among files": ({"keypoints": ["a.json", 3]}, "keypoints: cannot be of type list"),
    "numbers by name": ({"masks": {"a": 1.5}}, "masks: cannot be of type dict"),
    "intrinsics": ({"cameras": np.eye(3)}, "cameras: cannot be of type numpy.ndarray .give the path of a camera file"),
    "settings": ({"settings": 7}, "settings: cannot be of type int .7. .give a nested mapping"),
    "a text of modes": ({"modes": "7"}, "modes: cannot be of type str .'7'. .give a whole number"),
    "modes": ({"modes": 10**9}, "modes: 1000000000 hypotheses cannot be kept"),
    "seed": ({"seed": 0.5}, "seed: cannot be of type float .0.5. .give a whole number"),
    "negative seed": ({"seed": -1}, "seed: -1 is negative .0 or more"),
    "workers": ({"workers": None}, "workers: cannot be None"),
    "cues": ({"cues": 3}, "cues: cannot be of type int"),
    "fit": ({"fit": np.zeros(2)}, "fit: cannot be of type numpy.ndarray"),
    "person": ({"person": 1.5}, "person: cannot be of type float"),
    "out": ({"out": 3}, "out: cannot be of type int"),
    "resume": ({"resume": "no"}, "resume: cannot be of type str"),
    "progress": ({"progress": 3}, "progress: cannot be of type int"),
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_arguments_in_the_wrong_place(name: str, tmp_path: Path) -> None:
    given, told = ARGUMENTS[name]
    how: dict[str, Any] = {
        "subject": "arm8",
        "clips": None,
        "keypoints": "none.json",
        "out": tmp_path / "a.run",
    } | given
    if how["subject"] == "MODEL":
        how["subject"] = load_subject("arm8").model
    with pytest.raises(InputError, match=told):
        km.track(**how)
    if next(iter(given)) not in ("settings", "modes", "workers", "fit", "resume", "progress"):
        with pytest.raises(InputError, match=told):
            km.fit(**how)
    with pytest.raises(InputError, match=told):
        km.compare(trackers="css", **(how | {"out": given.get("out", tmp_path / "all")}))


@pytest.mark.parametrize("function", [km.open_run, km.load_subject])
@pytest.mark.parametrize("value", [None, 3, np.zeros(3), b"arm8", ["arm8"]])
def test_what_is_opened_is_a_path(function: Callable[[Any], Any], value: Any) -> None:
    with pytest.raises(InputError, match=r"cannot be .*give .*path of"):
        function(value)


# --- tracking ---


def test_a_body_behind_the_camera_has_an_energy_all_the_same() -> None:
    """Nothing of it has a place in the image, so that its extent there is not known."""
    body, camera = body_of("arm8"), facing("k")
    search: ModeSearch = make_tracker("css", body).search
    seen = observe(body, body.clamp(body.neutral), [camera])
    mask = np.zeros(SIZE[::-1], bool)
    mask[10:30, 20:40] = True
    silhouette, q = silhouette_of(mask), body.clamp(body.neutral)
    for depth in (0.0, -3.0):
        moved = replace(camera, t_camera_world=np.array([0.0, 0.0, depth]))
        cues = (ImageCues(moved, None, None, silhouette),)
        observation = replace(seen, cameras=(moved,), cues=cues)
        evidence = search.evidence(observation, q)
        parts = energy_parts(Case(search, observation, "as_detected", body.at(q), None, 0.0, None, evidence))
        assert np.isfinite([part.energy for part in parts]).all()
