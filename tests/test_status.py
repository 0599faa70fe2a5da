"""docs/history/status.md follows from the measures' registry and figures."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from benchmarks import status
from benchmarks.registry import MEASURES, by_name
from benchmarks.status import FIGURES, MARK, STATUS, Line, System, load, measures_without_line, table, with_tables
from benchmarks.support.common import ROOT
from humanoid.support.errors import InputError

MOST_WORDS = 20  # of a cell
NO_OPTIONS = {"set": "changes", "all": "every"}  # options whose argument has another name


def faults_of(command: str) -> list[str]:
    """Faults of the command of a line."""
    words = command.split()
    if words[:3] == ["python", "-m", "benchmarks"]:
        if words[3] not in by_name():
            return [f"{words[3]} is not a measure"]
        known = arguments_of(by_name()[words[3]].module)
        options = [word[2:] for word in words if re.match(r"--[a-z]", word)]
        return [f"{words[3]} has no --{o}" for o in options if NO_OPTIONS.get(o, o).replace("-", "_") not in known]
    if words[0] == "pytest":
        return [f"{word} is not there" for word in words[1:] if not (ROOT / word).is_file()]
    return [] if words[0] in ("kinemode", "make") or command == "script, not kept" else [f"{command} is not a command"]


def arguments_of(module: str) -> set[str]:
    """The arguments of a measure's `main`, read from its source, as importing all would be slow."""
    tree = ast.parse((ROOT / (module.replace(".", "/") + ".py")).read_text(encoding="utf-8"))
    (main,) = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "main"]
    return {argument.arg for argument in (*main.args.args, *main.args.kwonlyargs)}


def faults(systems: list[System]) -> list[str]:
    wrong = []
    for line in (line for system in systems for line in system.lines):
        wrong += [f"{line.what}: {fault}" for fault in faults_of(line.command)]
        wrong += [f"{line.what}: long cell {c!r}" for c in line.cells() if len(c.split()) > MOST_WORDS]
        wrong += [f"{line.what}: {c!r} is several lines" for c in line.cells() if "\n" in c]
    return wrong


def test_the_page_is_what_the_command_writes() -> None:
    text = STATUS.read_text(encoding="utf-8")
    assert text == with_tables(text, load()), "python -m benchmarks --write-status"


def test_every_line_is_short_and_its_command_exists() -> None:
    assert sum(len(system.lines) for system in load()) > 100
    assert faults(load()) == []


def test_most_measures_have_a_line() -> None:
    """Measures that only draw, or whose figures are on other pages, have none."""
    assert len(measures_without_line(load())) <= len(MEASURES) // 5


def test_reasons_stand_under_the_same_headings() -> None:
    notes = (STATUS.parent / status.NOTES).read_text(encoding="utf-8")
    missing = {system.name for system in load()} - set(re.findall(r"^## (.*)$", notes, re.MULTILINE))
    assert not missing


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (Line("a", "", "1", "python -m benchmarks bits --compare FILE"), ""),
        (Line("a", "", "1", "python -m benchmarks bitz"), "a: bitz is not a measure"),
        (Line("a", "", "1", "python -m benchmarks bits --compares FILE"), "a: bits has no --compares"),
        (Line("a", "", "1", "pytest tests/test_nothing.py"), "a: tests/test_nothing.py is not there"),
        (Line("a", "", "1", "by hand"), "a: by hand is not a command"),
        (Line("a", "", "1 " * 21, "make test"), f"a: long cell {'1 ' * 21!r}"),
    ],
)
def test_planted_faults_of_a_line_are_found(line: Line, fault: str) -> None:
    assert faults([System("s", (line,))]) == [fault] * bool(fault)


def test_what_is_edited_by_hand_is_found() -> None:
    text = STATUS.read_text(encoding="utf-8")
    changed = text.replace(" mm** |", " m** |", 1)
    assert with_tables(changed, load()) == text != changed
    assert with_tables(text.replace("# Status", "# State"), load()) == text.replace("# Status", "# State")


def test_a_page_without_the_mark_is_refused() -> None:
    with pytest.raises(InputError, match="no mark"):
        with_tables("# Status\n", load())


LINE = '[[system]]\nname = "s"\n[[system.line]]\nmeasure = "step"\nwhat = "w"\nfigure = "f"\n'


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('measure = "step"', 'measure = "stpe"', "did you mean step"),
        ('measure = "step"', "", "exactly one"),
        ('measure = "step"', 'measure = "step"\ncommand = "make"', "exactly one"),
        ('figure = "f"', "", "no figure"),
        ('figure = "f"', 'figure = "f"\nfigures = "g"', "has figures"),
        ('what = "w"', "what = ", "TOML"),
    ],
)
def test_planted_faults_of_a_file_are_found(tmp_path: Path, old: str, new: str, problem: str) -> None:
    (tmp_path / "figures.toml").write_text(LINE.replace(old, new))
    with pytest.raises(InputError, match=problem):
        load(tmp_path / "figures.toml")


def test_a_line_without_target_has_that_of_its_measure(tmp_path: Path) -> None:
    (tmp_path / "figures.toml").write_text(LINE)
    (system,) = load(tmp_path / "figures.toml")
    assert table(system)[-2] == f"| w | {by_name()['step'].target} | f | `python -m benchmarks step` |"


def test_the_command_writes_the_page(tmp_path: Path) -> None:
    page = tmp_path / "status.md"
    page.write_text(f"Above.\n\n{MARK}\nold")
    assert "live_film" in status.write(page)
    assert page.read_text().startswith(f"Above.\n\n{MARK}\n\n## ")
    assert "old" not in page.read_text().split(MARK)[1].split("##")[0]
    assert FIGURES.is_file()
