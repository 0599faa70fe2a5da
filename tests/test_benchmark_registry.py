"""The measures of `benchmarks`: each is registered, declares what it needs, and runs by its name."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.__main__ import main
from benchmarks.registry import (
    BEAM4CAM,
    CHROMIUM,
    DETECTOR,
    EXTRA,
    INDEX,
    MEASURES,
    MOCAP,
    MOCAP_MORE,
    NEEDS,
    NOTHING,
    Measure,
)
from benchmarks.support.common import ROOT
from humanoid.support.errors import InputError

SIGNS = {
    BEAM4CAM: r"\bbeam_folder\(",
    MOCAP: r"\bcaptured_folder\(|\bcaptured_files\(",
    MOCAP_MORE: r"\bcaptured_files\(",
    INDEX: r"\bindex: Path\b",
    DETECTOR: r"\bkm\.detect\(|\"--detect\"",
    CHROMIUM: r"\bopened_browser\(",
    EXTRA: r"^import pink|\bmissing\(\)",
}
"""Marks in the source of a measure that show what it needs or uses."""
FEWEST = 3  # modules in a folder, without `__init__`


def modules_with_main(root: Path) -> dict[str, Path]:
    """Dotted names of the modules that define `main`, without the command itself."""
    paths = {
        ".".join(path.relative_to(root).with_suffix("").parts): path
        for path in sorted((root / "benchmarks").rglob("*.py"))
        if path.name != "__main__.py"
    }
    return {name: path for name, path in paths.items() if defines_main(path.read_text(encoding="utf-8"))}


def defines_main(source: str) -> bool:
    return any(isinstance(node, ast.FunctionDef) and node.name == "main" for node in ast.parse(source).body)


def faults(root: Path, measures: Sequence[Measure]) -> list[str]:
    """Faults of a registry of the modules below a folder."""
    modules, registered = modules_with_main(root), [measure.module for measure in measures]
    names = [measure.name for measure in measures]
    wrong = [f"{module} has a main and is not registered" for module in modules if module not in registered]
    wrong += [f"{name} appears twice" for name in dict.fromkeys(names) if names.count(name) > 1]
    for measure in measures:
        if measure.module not in modules:
            wrong.append(f"{measure.module} is registered and has no main")
        else:
            wrong += faults_of(measure, modules[measure.module].read_text(encoding="utf-8"))
    return wrong


def faults_of(measure: Measure, source: str) -> Iterable[str]:
    declared = (*measure.needs, *measure.uses)
    if not re.fullmatch(r"\S[^\n]+[^.]\.", measure.summary):
        yield f"{measure.name}: the summary is not a sentence"
    if not measure.needs or (NOTHING in measure.needs and len(measure.needs) > 1) or NOTHING in measure.uses:
        yield f"{measure.name} does not name what it needs"
    yield from (f"{measure.name} names the unknown {need!r}" for need in declared if need not in NEEDS)
    for need, sign in SIGNS.items():
        if need not in declared and re.search(sign, source, re.MULTILINE):
            yield f"{measure.name} needs {need}"


def test_the_registry_is_true() -> None:
    assert len(MEASURES) > 50
    assert faults(ROOT, MEASURES) == []


def test_no_folder_is_nearly_empty() -> None:
    folders = [path for path in (ROOT / "benchmarks").rglob("*") if path.is_dir() and path.name != "__pycache__"]
    assert len(folders) > 7
    few = [f.name for f in folders if len([p for p in f.glob("*.py") if p.name != "__init__.py"]) < FEWEST]
    assert few == []


GOOD = Measure("benchmarks.speed.a", "Time of a.", "1 s", (NOTHING,))


@pytest.mark.parametrize(
    ("measures", "source", "wrong"),
    [
        ([GOOD], "def main(): pass", []),
        ([], "def main(): pass", ["benchmarks.speed.a has a main and is not registered"]),
        ([GOOD], "def other(): pass", ["benchmarks.speed.a is registered and has no main"]),
        ([GOOD, GOOD], "def main(): pass", ["a appears twice"]),
        ([replace(GOOD, summary="Time of a")], "def main(): pass", ["a: the summary is not a sentence"]),
        ([replace(GOOD, needs=())], "def main(): pass", ["a does not name what it needs"]),
        ([replace(GOOD, needs=(NOTHING, INDEX))], "def main(): pass", ["a does not name what it needs"]),
        ([replace(GOOD, uses=("a disk",))], "def main(): pass", ["a names the unknown 'a disk'"]),
        ([GOOD], "def main(): beam_folder(None)", [f"a needs {BEAM4CAM}"]),
        ([replace(GOOD, uses=(BEAM4CAM,))], "def main(): beam_folder(None)", []),
        ([GOOD], "import pink\ndef main(): pass", [f"a needs {EXTRA}"]),
        ([GOOD], "def main(*, index: Path): pass", [f"a needs {INDEX}"]),
    ],
)
def test_planted_faults_are_found(tmp_path: Path, measures: list[Measure], source: str, wrong: list[str]) -> None:
    (tmp_path / "benchmarks" / "speed").mkdir(parents=True)
    (tmp_path / "benchmarks" / "speed" / "a.py").write_text(source)
    (tmp_path / "benchmarks" / "__main__.py").write_text("def main(): pass")
    assert faults(tmp_path, measures) == wrong


def test_every_reference_mark_exists() -> None:
    """A mark that no source contains would check nothing."""
    sources = [path.read_text(encoding="utf-8") for path in modules_with_main(ROOT).values()]
    assert [need for need, sign in SIGNS.items() if not any(re.search(sign, s, re.MULTILINE) for s in sources)] == []


def test_a_list_names_every_measure(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    listed = {line.split()[0]: lines[k + 1] for k, line in enumerate(lines) if re.match(r"  \w", line)}
    assert set(listed) == {measure.name for measure in MEASURES}
    assert all(" needs: " in details for details in listed.values())


def test_a_list_imports_nothing_heavy() -> None:
    code = (
        "import sys; from benchmarks.__main__ import main; main(['--list'])\n"
        "sys.exit(str({'numpy', 'cyclopts', 'kinemode', 'pinocchio'} & set(sys.modules) or ''))"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.stderr.strip() == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["stpe"], "no measure 'stpe' (did you mean step"),
        (["loose_limb"], "loose_limbed"),
        (["nothing_like_it_at_all"], "--list prints all"),
        (["--lst"], "no option --lst"),
        (["--list", "speed"], "no option --list speed"),
    ],
)
def test_a_bad_name_is_one_line(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("error: benchmarks: ")
    assert message in error
    assert error.count("\n") == 1


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "measure_of_nothing.py").write_text("import no_such_library")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match="no_such_library is not installed"):
        replace(GOOD, module="measure_of_nothing").main()


def test_help_describes_the_measure(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["starting", "--help"])
    assert not ended.value.code
    out = capsys.readouterr().out
    assert "python -m benchmarks starting" in out
    assert "--times" in out


def test_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert main([]) == 2
    assert "NAME --help" in capsys.readouterr().out
