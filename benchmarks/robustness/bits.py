"""Whether a change of the code changes a bit of what is tracked: fixed cases, hashed once and compared later.

Hashes are of one machine: another processor, or other versions of the libraries, round otherwise."""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from benchmarks.robustness.bits_cases import CASES, ENDLESS, INPUT, RESULT, outcome
from benchmarks.support.common import Data, Several, in_processes, save, tell, work_folder
from humanoid.support.errors import InputError
from kinemode.target import made_folder
from kinemode.terminal import report

Record = dict[str, Any]
"""The stored data of a case: its number of "frames", "seed", and "arrays", their hashes by name."""


@dataclass(frozen=True)
class Task:
    """A case to run. folder: for what it renders and its run. keep: folder for its arrays."""

    case: str
    frames: int | None
    seed: int
    data: Path | None
    folder: Path
    keep: Path | None


def main(
    *,
    write: Path | None = None,
    compare: Path | None = None,
    keep: Path | None = None,
    cases: Annotated[tuple[str, ...], Several] = (),
    frames: int | None = None,
    whole: Annotated[bool, Parameter(negative="")] = False,
    seed: int = 0,
    jobs: int = 1,
    data: Data = None,
) -> None:
    """Hash what fixed cases give, or compare it with hashes of before; exit code 1 where a bit differs.

    Parameters
    ----------
    write
        Write the hashes here.
    compare
        Compare with the hashes in this file, with as many frames as it was written with.
    keep
        Folder of the cases' arrays: written next to the hashes; when comparing, used to measure differences.
    cases
        Only these.
    frames
        So many frames of every case, when writing; by default each case has a number of its own.
    whole
        All frames of every clip, when writing.
    seed
        Seed of the trackers.
    jobs
        Cases at a time, each in a process of its own.
    """
    _check(write, compare, frames, whole)
    before = None if compare is None else load(compare)
    chosen = chosen_cases(cases, before, data)
    counts = {c: before[c]["frames"] if before is not None else count(c, frames, whole) for c in chosen}
    with work_folder(None) as work:
        kept = keep if compare is None else work / "arrays" if keep else None
        tasks = [Task(c, counts[c], seed, data, work / c, kept) for c in chosen]
        records = dict(zip(chosen, in_processes(hashed, tasks, jobs), strict=True))
        if before is not None:
            rows = compared(before, records, keep, kept)
    unequal = list[str]()
    if before is None:
        save(write, {"measure": "bits", "cases": records})
    else:
        unequal = show(rows)
    for sentence in unequal:
        report.console().print(sentence)
    if unequal:
        sys.exit(1)


def _check(write: Path | None, compare: Path | None, frames: int | None, whole: bool) -> None:
    if (write is None) == (compare is None):
        raise InputError(
            "--write, --compare", "exactly one is needed", remedy="--write FILE first, --compare FILE then"
        )
    if compare is not None and (whole or frames is not None):
        raise InputError("--compare", "has the frames of its file", remedy="leave out --frames and --whole")
    if frames is not None and (whole or frames < 2):
        raise InputError("--frames", f"is {frames}", remedy="2 or more, without --whole")


def load(path: Path) -> dict[str, Record]:
    """The records of a file; raises InputError where it has none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["measure"] == "bits":
            return dict(content["cases"])
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        pass
    raise InputError(path, "has no hashes", remedy="--write FILE makes such a file")


def chosen_cases(cases: Sequence[str], before: Mapping[str, Record] | None, data: Path | None) -> list[str]:
    """The requested cases, or all, that can run here; prints which cannot. Raises InputError for an unknown one."""
    known = list(CASES if before is None else before)
    for case in cases:
        if case not in known:
            raise InputError("--cases", f"there is no case {case!r}", remedy="one of " + ", ".join(known))
    able = []
    for case in dict.fromkeys(cases or known):
        if case not in CASES:
            raise InputError("--compare", f"there is no case {case!r} now", remedy="--cases picks others")
        if reason := CASES[case].absent(data):
            tell(f"{case}: skipped, {reason}")
        else:
            able.append(case)
    if not able:
        raise InputError("--cases", "none of them can be run here")
    return able


def count(case: str, frames: int | None, whole: bool) -> int | None:
    """The number of tracked frames of a case; None for all of its clip."""
    return frames if frames is not None else None if whole and case not in ENDLESS else CASES[case].frames


def hashed(task: Task) -> Record:
    """Run a case."""
    began = time.perf_counter()
    arrays = outcome(task.case, task.frames, task.seed, task.data, task.folder)
    shutil.rmtree(task.folder, ignore_errors=True)
    if task.keep is not None:
        few = {name: array for name, array in arrays.items() if name != "pictures"}  # they are large
        np.savez_compressed(made_folder(task.keep) / f"{task.case}.npz", **few)  # type: ignore[arg-type]
    tell(f"{task.case}: {len(arrays['q'])} frames, {time.perf_counter() - began:.1f} s")
    return {"frames": task.frames, "seed": task.seed, "arrays": {name: digest(a) for name, a in arrays.items()}}


def digest(array: np.ndarray) -> str:
    """SHA-256 of an array's kind, shape and bytes."""
    whole = np.ascontiguousarray(array)
    return hashlib.sha256(f"{whole.dtype.str} {whole.shape} ".encode() + whole.tobytes()).hexdigest()


def compared(
    before: Mapping[str, Record], now: Mapping[str, Record], old: Path | None, new: Path | None
) -> dict[str, dict[str, str]]:
    """By case, the arrays that differ and by how much at most; old, new: folders of the arrays, if they are kept."""
    return {
        case: {
            name: largest(case, name, old, new)
            for name in (*INPUT, *RESULT)
            if before[case]["arrays"].get(name) != record["arrays"].get(name)
        }
        for case, record in now.items()
    }


def largest(case: str, name: str, old: Path | None, new: Path | None) -> str:
    """The largest difference of an array, as text; empty where the arrays were not kept."""
    if old is None or new is None or not (old / f"{case}.npz").is_file():
        return ""
    with np.load(old / f"{case}.npz") as kept, np.load(new / f"{case}.npz") as made:
        if name not in kept or name not in made:
            return ""
        a, b = kept[name], made[name]
    if a.shape != b.shape:
        return f"{a.shape} to {b.shape}"
    if not np.array_equal(np.isnan(a), np.isnan(b)):
        return "other entries are NaN"
    return f"{np.nanmax(np.abs(a - b), initial=0.0):.1e}"


def show(rows: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Print the table; returns a sentence where a case differs."""
    made = report.table("bits of tracked cases", "case", "input", "result", "arrays that differ, by at most")
    for case, differ in rows.items():
        verdicts = ("DIFFERENT" if any(n in differ for n in names) else "equal" for names in (INPUT, RESULT))
        made.add_row(case, *verdicts, ", ".join(f"{name} {by}".strip() for name, by in differ.items()))
    different = [case for case, differ in rows.items() if differ]
    out = report.console()
    out.print(made)
    out.print(f"{len(rows) - len(different)} of {len(rows)} cases equal to the last bit")
    return [f"different: {', '.join(different)}"] if different else []
