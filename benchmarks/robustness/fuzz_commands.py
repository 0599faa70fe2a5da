"""Damaged files through the commands: exit code 0, or 2 and one line with the error."""

from __future__ import annotations

import contextlib
import io
import json
import re
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import NamedTuple

import tomli_w

from benchmarks.robustness.fuzz_arrays import mutated_run
from benchmarks.robustness.fuzz_cases import Case, Verdict
from benchmarks.robustness.fuzz_corpus import QUICK, Files, facing
from benchmarks.robustness.fuzz_judge import timed, write
from benchmarks.robustness.fuzz_mutations import mutated
from estimator.data.formats.cameras_json import camera_to_json
from humanoid.support.errors import LONGEST
from kinemode.__main__ import BAD_INPUT, main

_PREFIX = "error: "
_NUMERIC = re.compile(r"note: .*encountered|Traceback|Warning:")


class Command(NamedTuple):
    """line: the arguments, with {} for the folder. files: what lies in it. damaged: which of them may be."""

    line: str
    files: Callable[[Mapping[str, list[Files]]], dict[str, bytes]]
    damaged: tuple[str, ...]


def _run_files(corpus: Mapping[str, list[Files]]) -> dict[str, bytes]:
    return {"a.run": corpus["run"][0]["arm8.run"]}


def _track_files(corpus: Mapping[str, list[Files]]) -> dict[str, bytes]:
    """The input files of tracking arm8, with and without pictures."""
    camera = camera_to_json(facing("k"))
    return {
        "k.json": corpus["seen"][0]["arm8.json"],
        "cameras.json": json.dumps({"cameras": [camera]}).encode(),
        "settings.toml": tomli_w.dumps(QUICK).encode(),
        "clip.mp4": corpus["film"][0]["clip.mp4"],
        "plate.png": corpus["background"][0]["plate.png"],
        "mask.mp4": corpus["film"][0]["clip.mp4"],
        "a.run": corpus["unfinished run"][0]["arm8.run"],
    }


_TRACK = "track --subject arm8 --fit off --keypoints {}/k.json --cameras {}/cameras.json --settings {}/settings.toml"
COMMANDS = {
    "track": Command(f"{_TRACK} --out {{}}/new.run", _track_files, ("k.json", "cameras.json", "settings.toml")),
    "track pictures": Command(
        f"{_TRACK} {{}}/clip.mp4 --cues edges,flow,silhouette --background {{}}/plate.png --out {{}}/new.run",
        _track_files,
        ("k.json", "clip.mp4", "plate.png"),
    ),
    "track masks": Command(
        f"{_TRACK} {{}}/clip.mp4 --cues silhouette --mask {{}}/mask.mp4 --out {{}}/new.run", _track_files, ("mask.mp4",)
    ),
    "track resume": Command(f"{_TRACK} --resume --out {{}}/a.run", _track_files, ("a.run",)),
    "export npz": Command("export {}/a.run {}/a.npz", _run_files, ("a.run",)),
    "export csv": Command("export {}/a.run {}/a.csv", _run_files, ("a.run",)),
    "export trc": Command("export {}/a.run {}/a.trc", _run_files, ("a.run",)),
    "export mot": Command("export {}/a.run {}/a.mot", _run_files, ("a.run",)),
    "export bvh": Command("export {}/a.run {}/a.bvh", _run_files, ("a.run",)),
    "export glb": Command("export {}/a.run {}/a.glb", _run_files, ("a.run",)),
    "export osim": Command("export {}/a.run {}/a.osim", _run_files, ("a.run",)),
    "export degrees": Command("export {}/a.run {}/a.csv --degrees --filter 2", _run_files, ("a.run",)),
    "plot": Command("plot {}/a.run --out {}/a.png --filter 2", _run_files, ("a.run",)),
    "view html": Command("view {}/a.run --html {}/a.html", _run_files, ("a.run",)),
    "explain": Command("explain {}/a.run --frame 1", _run_files, ("a.run",)),
    "explain pictures": Command("explain {}/a.run --frame 1 --out {}/pictures", _run_files, ("a.run",)),
}
_SHARES = {"track": 6, "view html": 4, "explain": 4, "export npz": 2, "track pictures": 2}


def cases(count: int, seed: int) -> list[Case]:
    """So many command lines, mixed."""
    names = [name for name in COMMANDS for _ in range(_SHARES.get(name, 1))]
    return [Case(names[i % len(names)], seed, i) for i in range(count)]


def damaged_files(case: Case, corpus: Mapping[str, list[Files]]) -> dict[str, bytes]:
    """The files of a command line, one of them damaged."""
    command, random = COMMANDS[case.reader], case.random
    files = command.files(corpus)
    victim = random.choice(command.damaged)
    files[victim] = _damage(files[victim], Path(victim).suffix, random)
    return files


def _damage(data: bytes, suffix: str, random: Random) -> bytes:
    if suffix == ".run":
        return mutated_run(data, random, [data])
    return mutated(data, {".json": "json", ".toml": "text"}.get(suffix, "binary"), random, [data])


def judge_case(case: Case, corpus: Mapping[str, list[Files]], folder: Path) -> Verdict:
    """Run the command of a case in this process, with what it prints taken up."""
    for old in sorted(folder.rglob("*"), reverse=True) if folder.exists() else ():
        old.rmdir() if old.is_dir() else old.unlink()
    write(damaged_files(case, corpus), folder)
    out, err, began = io.StringIO(), io.StringIO(), time.perf_counter()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([word.replace("{}", str(folder)) for word in COMMANDS[case.reader].line.split()])
    return timed(*classify_output(code, err.getvalue()), time.perf_counter() - began)


def classify_output(code: int, printed: str) -> tuple[str, str]:
    """Whether a command ended well, or with one short line."""
    errors = [line for line in printed.splitlines() if line.startswith((_PREFIX, "internal error"))]
    if code not in (0, BAD_INPUT):
        return f"exit code {code}", " ".join(errors)[:1000] or printed[-1000:]
    if _NUMERIC.search(printed):
        return "warned", printed[-600:]
    longest = max(printed.splitlines(), key=len, default="")
    if len(longest) > LONGEST + len(_PREFIX):
        return "long message", longest[:1000]
    if code == 0:
        return "read", ""
    if len(errors) != 1 or not printed.rstrip("\n").endswith(errors[0]) or not errors[0].isprintable():
        return "not one line", printed[-600:]
    return "refused", errors[0]
