"""The tables from papers to code name existing functions, and tests that fail when these are broken."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from benchmarks.support.common import ROOT
from humanoid.subject.subject import load_subject
from tests import breaking_papers
from tests.breaking_papers import (
    COUNTED,
    DOTTED,
    MISSING,
    PAGES,
    TEST,
    UNEVEN,
    Breaker,
    Fault,
    Row,
    faults_of_class,
    reached,
    rows_of,
    tables,
    unnoticed,
)
from tests.tiers import later


def resolves(name: str) -> bool:
    """Whether a dotted name is a module or an attribute of one."""
    try:
        reached(name)
    except LookupError:
        return False
    return True


def defined(file: str, test: str) -> bool:
    path = ROOT / file
    if not path.is_file():
        return False
    return test in functions_of(path)


@cache
def functions_of(path: Path) -> set[str]:
    return {n.name for n in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(n, ast.FunctionDef)}


def faults(page: str) -> list[str]:
    """Names that resolve to nothing, tests that are not defined, and rows that lack one of either."""
    wrong = [name for name in DOTTED.findall(page) if not resolves(name)]
    wrong += [f"{file}::{test}" for file, test in TEST.findall(page) if not defined(file, test)]
    for _, row in tables(page):
        if len(row) != 3:
            wrong.append(f"{len(row)} cells: {row[0]}")
        elif not (DOTTED.search(row[1]) and TEST.search(row[2])):
            wrong.append(f"no function or no test: {row[0]}")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_name_exists(page: Path) -> None:
    text = page.read_text()
    assert len(list(tables(text))) > 10
    assert faults(text) == []


GOOD = "| in the paper | function | test |\n|---|---|---|\n| eq. 1 | `humanoid.kinematics.body.Body.at` | `{}` |\n"
THIS = "tests/test_papers.py::test_planted_faults_are_found"


@pytest.mark.parametrize(
    ("text", "count"),
    [
        (GOOD.format(THIS), 0),
        (GOOD.format(THIS).replace("Body.at", "Body.of"), 1),
        (GOOD.format(THIS).replace("humanoid.kin", "humanoid.cin"), 1),
        (GOOD.format(THIS).replace("kinematics.body.Body.at", "kinematics.body.body_of"), 1),
        (GOOD.format("tests/test_papers.py::test_nothing"), 1),
        (GOOD.format("tests/test_paper.py::test_planted_faults_are_found"), 1),
        (GOOD.format("none"), 1),
        (GOOD.format(THIS).replace("| eq. 1 ", "| eq. 1 | and more "), 1),
        ("In a sentence: `estimator.trackers.css.tracker.Cs`.", 1),
    ],
)
def test_planted_faults_are_found(text: str, count: int) -> None:
    assert len(faults(text)) == count, faults(text)


TABLES = list(dict.fromkeys((p.stem, row.section) for p in PAGES for row in rows_of(p.read_text(encoding="utf-8"))))
QUICK = ("loose-limbed", "Image likelihoods (section 3)")
"""The table that takes least time; the others take 10 to 100 s each."""


@pytest.mark.parametrize(("page", "section"), later(TABLES, thorough=[table for table in TABLES if table != QUICK]))
def test_every_named_test_notices_a_broken_function(page: str, section: str) -> None:
    text = (ROOT / "docs" / "papers" / f"{page}.md").read_text(encoding="utf-8")
    assert unnoticed([row for row in rows_of(text) if row.section == section]) == []


def test_planted_rows_that_are_not_true_are_found() -> None:
    names = "humanoid.subject.superquadric.points", "humanoid.subject.superquadric.normals"
    tests = "tests/test_superquadric.py::test_exponents_of_one_give_an_ellipsoid", THIS
    rows = [
        Row("", "true", names, tests[:1]),
        Row("", "not called", names[:1], tests[1:]),
        Row("", "of two tests", names, tests),
        Row("", "compiled", ("estimator.numerics.robust.rho",), ("tests/test_cost.py::test_potentials",)),
    ]
    assert unnoticed(rows) == [f"not called: {each}" for each in (names[0], tests[1])] + [f"of two tests: {tests[1]}"]


class Pair(NamedTuple):
    first: float
    second: int


@dataclass(frozen=True)
class Kept:
    numbers: np.ndarray
    pairs: tuple[Pair, ...] = (Pair(1.0, 2), Pair(3.0, 4))


NUMBERS = np.array([1.0, 0.0, -2.0])
VALUES = [
    True, np.True_, 3, np.int64(0), 2.5, np.float32(0.0), 1j * NUMBERS, NUMBERS, NUMBERS.astype(int), NUMBERS == 0.0,
    np.zeros(2, int), np.array([None, 1.0], object), [1.0], ("a", 1.0), {"a": 1}, {2}, Pair(1.0, 2), Kept(NUMBERS),
    '<a x="0.5"/>',
]  # fmt: skip


@pytest.mark.parametrize("how", [UNEVEN, MISSING])
@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_every_kind_of_result_is_broken_in_a_copy(value: Any, how: str) -> None:
    before = repr(value)
    assert Breaker(COUNTED).wrong(value) is value
    wrong = Breaker(how).wrong(value)
    assert type(wrong) is type(value)
    assert repr(wrong) != before == repr(value)


def test_equal_results_are_broken_differently_and_sequences_are_shortened() -> None:
    breaker, subject = Breaker(), load_subject("arm8")
    assert breaker.wrong(1.0) != breaker.wrong(1.0)
    assert list(breaker.wrong(x for x in (1, 2))) == [2, 3]
    assert breaker.wrong(None) is None
    assert breaker.wrong(len)([0]) == 2
    assert not np.array_equal(breaker.wrong(subject).model.lowerPositionLimit, subject.model.lowerPositionLimit)
    assert len(Breaker(MISSING).wrong(Kept(NUMBERS)).pairs) == 1


def test_whoever_holds_a_function_has_the_broken_one() -> None:
    class Base:
        def __init__(self, value: float) -> None:
            self.value, self.other = value, 1.0

        def twice(self, by: float = 2.0, *, more: float = 0.0) -> float:
            return by * self.value + more

        @staticmethod
        def half(value: float = 1.0) -> float:
            return 0.5 * value

        @cached_property
        def once(self) -> float:
            return self.value

        def fill(self, numbers: np.ndarray) -> None:
            numbers[:] = self.value

    class Derived(Base):
        def twice(self, by: float = 3.0, *, more: float = 0.0) -> float:
            return super().twice(by, more=more)

    def results() -> list[float]:
        thing, numbers = Derived(2.0), np.zeros(2)
        thing.fill(numbers)
        return [thing.twice(more=1.0), bound(1.0), Base.half(), thing.once, *numbers]

    bound, breaker = Derived(4.0).twice, Breaker()
    assert results() == [7.0, 4.0, 0.5, 2.0, 2.0, 2.0]
    faults = faults_of_class(Base)
    assert [len(fault.functions) for fault in faults] == [1, 1, 1, 1, 0]
    for fault in faults[:-1]:
        fault.plant(breaker)
    assert not set(results()) & {7.0, 4.0, 0.5, 2.0}
    assert breaker.calls == 5
    assert Derived(2.0).value == 2.0
    Fault(constructor=Base.__init__, field="value").plant(breaker)
    assert Derived(2.0).value != 2.0
    assert Derived(2.0).other == 1.0


@pytest.mark.parametrize(
    ("name", "count", "functions"),
    [
        ("humanoid.kinematics.body.Body.at", 1, 1),
        ("humanoid.subject.subject.load_subject", 1, 1),
        ("estimator.fitting.fit.Fit.estimates", 1, 1),
        ("estimator.search.proposals.Proposal.sample", 1, 2),
        ("estimator.vision.cues.edges", 3, 0),
        ("estimator.inference.beliefs.strata.Shares", 3, 1),
        ("estimator.trackers.css.settings.PAPER", 1, 0),
        ("estimator.data.cameras.camera.Camera.parallel", 1, 0),
    ],
)
def test_everything_that_a_table_may_name_can_be_broken(name: str, count: int, functions: int) -> None:
    ways = breaking_papers.faults(name)
    assert len(ways) >= count
    assert len(ways[0].functions) >= functions
    assert functions or ways[0].constant is not None or ways[0].constructor is not None
