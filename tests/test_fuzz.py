"""The measure of damaged files: what it counts as a fault, and a small part of it."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import pytest

from benchmarks.robustness import fuzz, fuzz_commands
from benchmarks.robustness.fuzz_cases import MOST_SECONDS, Case as Damaged, Verdict, peak_memory
from benchmarks.robustness.fuzz_corpus import Files
from benchmarks.robustness.fuzz_judge import classify_message, judge, prepare, timed, write
from benchmarks.robustness.fuzz_readers import CORPUS_OF, READERS
from benchmarks.robustness.fuzz_workers import verdicts
from humanoid.support.errors import LONGEST, InputError, shown
from tests.fuzz_faults import judge as faulty
from tests.waiting import DEADLINE

_SLICE = 90  # damaged files in the test, of the 100,000 of the measure


# --- messages ---


def test_a_message_is_one_short_line_with_both_ends_of_what_it_quotes() -> None:
    name = "first" + 100_000 * "x" + "last"
    error = InputError("a.json", f"the name {name!r} is used twice", place=name, remedy=f"one of {name}, b")
    assert len(str(error)) <= LONGEST
    assert str(error).startswith("a.json: first")
    assert "last' is used twice (one of first" in str(error)
    assert error.place == name  # programs get the full name
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert "\x1b" not in str(InputError("a", "b\n\x1b[31mc\u202e"))
    assert str(InputError("a", "b\n\x1b[31mc")) == "a: b\\n\\x1b[31mc"
    whole = InputError("a.json", "p" * 300, remedy="r" * 150)
    assert "p" * 300 in str(whole)
    assert "r" * 150 in str(whole)


@pytest.mark.parametrize("lengths", [(1, 1, 1, 9999), (9999, 0, 9999, 0), (600, 600, 600, 600), (0, 499, 0, 0)])
def test_every_part_of_a_long_message_has_its_share(lengths: tuple[int, ...]) -> None:
    source, place, problem, remedy = (letter * n for letter, n in zip("abcd", lengths, strict=True))
    text = str(InputError(source, problem, place=place, remedy=remedy))
    assert len(text) <= LONGEST
    assert all(letter in text for letter, n in zip("abcd", lengths, strict=True) if n)
    assert max(lengths) < 500 or len(text) > LONGEST - 10  # no more is cut than necessary


def test_unprintable_content_is_described() -> None:
    assert shown(10**5000) == "a number of thousands of digits"
    assert len(shown("x" * 1000)) == 60
    nested: list[Any] = []
    for _ in range(100_000):
        nested = [nested]
    assert shown(nested) == "a list"


# --- planted faults ---


def test_bad_messages_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    assert classify_message(f"{path}: is empty", path)[0] == "refused"
    assert classify_message(f"{path}: is damaged: {path}: is empty", path)[0] == "wrapped twice"
    assert classify_message("x" * 501, path)[0] == "long message"
    assert classify_message("two\nlines", path)[0] == "message of several lines"
    classify = fuzz_commands.classify_output
    assert classify(0, "note: all is well\n")[0] == "read"
    assert classify(2, "tracking: 1/3\nerror: a: is empty\n")[0] == "refused"
    assert classify(2, "error: a\nerror: b\n")[0] == "not one line"
    assert classify(2, "error: " + "x" * 501)[0] == "long message"
    assert classify(1, "internal error: KeyError: 'q'")[0] == "exit code 1"
    assert classify(0, "note: " + "x" * 600)[0] == "long message"
    assert classify(0, "note: overflow encountered in multiply")[0] == "warned"
    held = peak_memory()  # by earlier tests, to be subtracted
    assert timed("read", "", MOST_SECONDS, held).outcome == "read"
    assert timed("read", "", MOST_SECONDS + 0.1, held).outcome == "slow"


def test_workers_outlive_what_damaged_files_do_to_them(tmp_path: Path) -> None:
    cases = [Damaged(name, 0, i) for i, name in enumerate(("good", "crash", "good", "print", "hang", "good"))]
    by_number: dict[int, Verdict] = {}
    granted = iter([0.0])

    def clock() -> float:
        """The clock stands still until the worker starts the case that hangs, then jumps once."""
        return next(granted, 2.0 * DEADLINE) if 3 in by_number else 0.0

    for case, verdict in verdicts(faulty, tmp_path, cases, 1, batch=6, patience=DEADLINE, clock=clock):
        by_number[case.number] = verdict
    outcomes = [by_number[i].outcome for i in range(len(cases))]
    assert outcomes == ["read", "crash", "read", "printed", "hang", "read"]
    assert by_number[0].message == tmp_path.name
    assert "3" in by_number[1].message
    assert "libfoo" in by_number[3].message


def test_equal_seeds_make_equal_damage(valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    for name in READERS:
        contents = []
        for folder in ("a", "b"):
            prepare(Damaged(name, 5, 3), valid, tmp_path / folder)
            contents.append({p.name: p.read_bytes() for p in (tmp_path / folder).iterdir()})
        assert contents[0] == contents[1]


def test_valid_files_are_read(
    valid: Mapping[str, list[Files]], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Otherwise damage would be added to files already damaged."""
    for name in READERS:
        for number, files in enumerate(valid[CORPUS_OF.get(name, name)]):
            write(files, tmp_path / "case")
            verdict = judge(name, tmp_path / "case" / next(iter(files)), most_seconds=inf)
            assert verdict.outcome == "read", (name, number, verdict)
            assert capfd.readouterr() == ("", ""), (name, number)


def test_damaged_files_give_a_result_or_one_line(valid: Mapping[str, list[Files]]) -> None:
    cases = fuzz.cases(_SLICE, 7)
    outcomes = list(verdicts(partial(fuzz.judge_case, most_seconds=inf), dict(valid), cases, 1, patience=DEADLINE))
    assert len(outcomes) == len(cases)
    assert {case.reader for case in cases} == set(READERS)
    assert not [(str(case), verdict) for case, verdict in outcomes if not verdict.good]
