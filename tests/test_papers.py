"""The tables from papers to code name existing functions and tests."""

from __future__ import annotations

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted((ROOT / "docs" / "papers").glob("*.md"))
_DOTTED = re.compile(r"`((?:humanoid|estimator|viz|kinemode|benchmarks)(?:\.\w+)+)`")
_TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


def resolves(name: str) -> bool:
    """Whether a dotted name is a module or an attribute of one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        module = ".".join(parts[:length])
        try:
            reached: object = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is not None and not module.startswith(error.name):
                raise  # the module exists, but an import of it fails
            continue
        for attribute in parts[length:]:
            if not hasattr(reached, attribute):
                return attribute in getattr(reached, "__dataclass_fields__", {})
            reached = getattr(reached, attribute)
        return True
    return False


def defined(file: str, test: str) -> bool:
    path = ROOT / file
    if not path.is_file():
        return False
    return test in functions_of(path)


@cache
def functions_of(path: Path) -> set[str]:
    return {n.name for n in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(n, ast.FunctionDef)}


def rows(page: str) -> list[list[str]]:
    """The cells of all rows of the page's tables, without headers."""
    lines = [line.strip().strip("|") for line in page.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.split("|")] for line in lines]
    return [row for row in cells if row[0] != "in the paper" and not set(row[0]) <= set("-: ")]


def faults(page: str) -> list[str]:
    """Names that resolve to nothing, tests that are not defined, and rows that lack one of either."""
    wrong = [name for name in _DOTTED.findall(page) if not resolves(name)]
    wrong += [f"{file}::{test}" for file, test in _TEST.findall(page) if not defined(file, test)]
    for row in rows(page):
        if len(row) != 3:
            wrong.append(f"{len(row)} cells: {row[0]}")
        elif not (_DOTTED.search(row[1]) and _TEST.search(row[2])):
            wrong.append(f"no function or no test: {row[0]}")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_name_exists(page: Path) -> None:
    text = page.read_text()
    assert len(rows(text)) > 10
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
