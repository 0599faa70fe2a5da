"""The public interface: its content, that nothing else is needed, and that it imports nothing heavy."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import kinemode as km
from benchmarks.speed.starting import FILE, LINES
from kinemode import __main__ as front
from tests.waiting import DEADLINE

ROOT = Path(__file__).resolve().parent.parent
HEAVY = {
    "coal", "cv2", "matplotlib", "meshcat", "networkx", "numba", "numpy", "pinocchio", "proxsuite", "scipy", "trimesh",
    "yourdfpy",
}  # fmt: skip
STANDARD = set(sys.stdlib_module_names) | {"__future__"}
# the message about a missing subject lists those of example-robot-data, whose module loads Pinocchio (and that coal)
ALLOWED = {"track, no such subject": {"coal", "numpy", "pinocchio"}}

_LOADED = """
import io, json, os, sys
from contextlib import redirect_stderr, redirect_stdout
from kinemode import cli  # what every command loads is loaded once
for code in json.loads(sys.argv[1]):
    child = os.fork()
    if not child:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            try:
                exec(code)
                loaded = sorted({name.partition(".")[0] for name in sys.modules})
            except BaseException as error:
                loaded = repr(error)
        print(json.dumps(loaded), flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""
_COMMAND = """
from kinemode.__main__ import main
assert main({line!r}) == {expected}
"""


_HEAVY = "a heavy one"


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """Heavy libraries loaded by each of LINES, and by a program that needs them, in separate processes."""
    folder = tmp_path_factory.mktemp("door")
    (folder / FILE).write_text("{}")
    codes = {
        name: line[1] if line[0] == "-c" else _COMMAND.format(line=list(line), expected=0 if name == "--help" else 2)
        for name, line in LINES.items()
    }
    codes[_HEAVY] = "import kinemode; kinemode.Body"
    done = subprocess.run(
        [sys.executable, "-c", _LOADED, json.dumps(list(codes.values()))], cwd=folder, capture_output=True, text=True,
        check=True, stdin=subprocess.DEVNULL, timeout=DEADLINE, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    modules = dict(zip(codes, map(json.loads, done.stdout.splitlines()), strict=True))
    failed = {name: imported for name, imported in modules.items() if isinstance(imported, str)}
    assert not failed, failed
    return {name: HEAVY & set(imported) for name, imported in modules.items()}


def test_a_heavy_module_would_be_seen(loaded: dict[str, set[str]]) -> None:
    assert {"numba", "numpy", "pinocchio"} <= loaded[_HEAVY]


@pytest.mark.parametrize("name", LINES)
def test_a_missing_file_is_reported_without_heavy_imports(name: str, loaded: dict[str, set[str]]) -> None:
    assert loaded[name] <= ALLOWED.get(name, set())


def test_every_public_name_exists() -> None:
    for name in km.__all__:
        assert getattr(km, name) is not None, name
    assert len(km.__all__) > 50
    with pytest.raises(AttributeError, match=r"no attribute .trak.; it has .*track"):
        km.trak  # noqa: B018


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_a_run_is_given_as_it_is_or_by_its_path(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And a command does what the function of the same name does."""
    clip = km.render(tmp_path / "clip", "arm", fps=10, seconds=0.2, videos=False)
    run = km.track(clip.subject, None, keypoints=clip.keypoints, cameras=clip.cameras, out=tmp_path / "a.run")
    by_run, by_path = km.export(run, tmp_path / "a.csv"), km.export(run.file, tmp_path / "b.csv")
    assert by_run.read_bytes() == by_path.read_bytes()
    assert front.main(["export", str(run.file), str(tmp_path / "c.csv")]) == 0
    assert (tmp_path / "c.csv").read_bytes() == by_run.read_bytes()
    measured = km.evaluate(run, clip.truth)
    assert measured == km.evaluate(str(run.file), km.Reference.load(clip.truth))
    assert 0.0 < measured.mpjpe < 0.1
    for path in (km.view(run, html=tmp_path / "a.html"), km.view(run.file, html=tmp_path / "b.html")):
        assert path is not None
        assert path.read_text(encoding="utf-8").startswith("<!")
    film = km.overlay(run, tmp_path / "a.gif")
    assert front.main(["overlay", str(run.file), "--out", str(tmp_path / "b.gif")]) == 0
    assert (tmp_path / "b.gif").read_bytes() == film.read_bytes()
    with pytest.raises(km.InputError, match="no camera is called 'side'"):
        km.overlay(run, tmp_path / "c.gif", camera="side")


def imported(path: Path) -> set[str]:
    """The packages that a file imports."""
    packages = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            packages |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            packages.add("." * node.level + (node.module or ""))
    return packages


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples_need_the_door_alone(path: Path) -> None:
    """kinemode itself, no module of it, numpy and the standard library."""
    inner = {name for name in imported(path) if name.partition(".")[0] not in STANDARD}
    assert inner <= {"kinemode", "numpy"}


def test_an_import_from_within_would_be_seen(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(
        "import kinemode.jobs\nfrom estimator.data.cameras import camera\nimport numpy as np"
    )
    assert imported(tmp_path / "a.py") == {"kinemode.jobs", "estimator.data.cameras", "numpy"}


@pytest.mark.parametrize("path", sorted((ROOT / "kinemode" / "commands").glob("*.py")), ids=lambda path: path.stem)
def test_commands_have_no_second_way(path: Path) -> None:
    """Commands call public functions; otherwise only what prints, and what has no public name."""
    inner = {name for name in imported(path) if name.partition(".")[0] in ("humanoid", "estimator", "viz", "kinemode")}
    printing = {"kinemode", "kinemode.terminal", "kinemode.comparison"}
    declared = {f"kinemode.{name}" for name in ("flags", "option", "request", "run_requests", "making_requests")}
    unnamed = {
        "kinemode.demo",
        "kinemode.explain",
        "kinemode.findings",
        "kinemode.reporting",
        "kinemode.settings",
        "viz.cue_pictures",
    }
    assert inner <= printing | declared | unnamed
