"""Trackers of other packages: found by the environment variable, listed, set and refused as the built-in ones are."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from estimator.tracking.registry import TRACKERS, settings_for
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE, Registry

ROOT = Path(__file__).resolve().parent.parent
TOY = Path(__file__).with_name("toy_plugin.py")


def ran(*arguments: str, plugins: str = "toy_plugin", path: Path = TOY.parent) -> subprocess.CompletedProcess[str]:
    """A process with plugins, which lie in a folder of their own."""
    paths = os.pathsep.join([str(ROOT), str(path)])
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths, VARIABLE: plugins},
    )


def kinemode(*arguments: str, **how: object) -> subprocess.CompletedProcess[str]:
    return ran("-m", "kinemode", *arguments, **how)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def settings_file() -> str:
    done = kinemode("settings", "--tracker", "lazy")
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_a_plugin_is_listed_and_its_settings_are_told(settings_file: str) -> None:
    listed = kinemode("trackers")
    assert "lazy " in listed.stdout
    assert "stays where it is" in listed.stdout
    assert "css-paper" in listed.stdout
    lazy = settings_file.partition("[lazy]\n")[2].partition("\n\n")[0]
    assert lazy.splitlines() == [
        "# naps: how many a frame",
        "naps = 2  # 0 or more, at most 5",
        "# depth: of a nap",
        "depth = 0.5  # more than 0",
        "# bed: where",
        'bed = "sofa"  # one of sofa, floor',
    ]
    assert "[css]" not in settings_file
    assert "enabled = false" in settings_file.partition("[smooth]")[2]


ASKED = """
from estimator.tracking.registry import TRACKERS, make_tracker
from kinemode.settings import choose
chosen = choose("lazy", {path!r})
chosen.check(fits=False)
made = make_tracker("lazy", "a body", chosen.settings)
assert type(made).__name__ == "Lazy" and made.body == "a body" and made.settings is chosen.settings.own
print(chosen.settings.to_dict()["lazy"], chosen.settings.cost.nu, *chosen.notes(cues=None, cameras=1, fits=False))
"""


def test_its_settings_are_taken_from_a_file_and_made_into_a_tracker(settings_file: str, tmp_path: Path) -> None:
    path = tmp_path / "lazy.toml"
    path.write_text(settings_file.replace("naps = 2", "naps = 5").replace("depth = 0.5", "deepness = 2"))
    done = ran("-c", ASKED.format(path=str(path)))
    assert done.stderr == ""
    told = "the setting lazy.deepness is called lazy.depth now"
    assert done.stdout.strip() == "{'naps': 5, 'depth': 2.0, 'bed': 'sofa'} 8.0 " + told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[lazy]\nnaps = 6", "[lazy] naps: 6 cannot work (a finite number, 0 or more, at most 5)"),
        ("[lazy]\nbed = 'car'", "[lazy] bed: 'car' cannot work (one of sofa, floor)"),
        ("[lazy]\nnap = 1", "[lazy]: no setting 'nap' (did you mean naps?"),
        ("[lazy]\nnaps = 0\ndepth = 1.0", "[lazy] depth: has no effect: lazy.naps is 0"),
        ("[css]\nmodes = 3", "[css] modes: has no effect: the tracker lazy goes by [lazy]"),
    ],
)
def test_what_is_wrong_in_its_table_is_refused(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    done = kinemode("track", "a.mp4", "--tracker", "lazy", "--settings", str(path), "--out", str(tmp_path / "a.run"))
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {path}: {told}")


def test_its_table_is_of_no_use_to_the_others(tmp_path: Path) -> None:
    path = tmp_path / "lazy.toml"
    path.write_text("[lazy]\nnaps = 1")
    done = kinemode("track", "a.mp4", "--settings", str(path), "--out", str(tmp_path / "a.run"))
    assert "[lazy] naps: has no effect: the tracker css goes by [css]" in done.stderr


def test_without_the_variable_there_is_none() -> None:
    done = kinemode("settings", "--tracker", "lazy", plugins="")
    assert done.returncode == 2
    assert "no tracker 'lazy' (one of css, css-paper" in done.stderr


@pytest.mark.parametrize(
    ("source", "told"),
    [
        (None, "ModuleNotFoundError: No module named 'broken'"),
        ("import numpy\nnumpy.no_such_name", "AttributeError: module 'numpy' has no attribute 'no_such_name'"),
        (
            "from estimator.tracking.registry import TRACKERS, register\nregister(TRACKERS['css'])",
            "tracker: there is already one named css",
        ),
    ],
)
def test_a_module_that_cannot_be_imported_is_named(source: str | None, told: str, tmp_path: Path) -> None:
    if source is not None:
        (tmp_path / "broken.py").write_text(source)
    (tmp_path / "whole.py").write_text("")
    done = kinemode("trackers", plugins=" whole, broken", path=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {VARIABLE}: module broken cannot be imported: {told}")


def test_what_went_wrong_is_said_at_every_look_up() -> None:
    code = (
        "from estimator.tracking.registry import TRACKERS\n"
        "for _ in range(2):\n"
        "    try: list(TRACKERS)\n"
        "    except ValueError as error: print(error)\n"
    )
    lines = ran("-c", code, plugins="no_such_module").stdout.splitlines()
    assert len(lines) == 2
    assert lines[0] == lines[1]
    assert "no_such_module" in lines[0]


@dataclass(frozen=True)
class Member:
    name: str


def test_a_name_is_given_once() -> None:
    family = Registry("thing", [Member("a"), Member("b")])
    family.register(Member("c"))
    assert list(family) == ["a", "b", "c"]
    with pytest.raises(InputError, match="thing: there is already one named b"):
        family.register(Member("b"))
    with pytest.raises(InputError, match=r"thing: no thing 'd' \(one of a, b, c\)"):
        family["d"]


@pytest.mark.parametrize(
    ("group", "change"),
    [
        ("cost", lambda s: replace(s, group="cost")),
        ("person", lambda s: replace(s, group="person")),
        ("without", lambda s: replace(s, group="")),
        ("other settings", lambda s: replace(s, settings=settings_for("css").cues)),
    ],
)
def test_a_table_is_one_trackers_own(group: str, change: Callable) -> None:
    with pytest.raises(InputError, match=group):
        TRACKERS.register(change(replace(TRACKERS["css"], name="another")))
    assert "another" not in TRACKERS


def test_nothing_else_names_the_toy() -> None:
    files = [p for p in ROOT.rglob("*.py") if not {".venv", "build"} & set(p.parts)]
    naming = {p.name for p in files if "toy_plugin" in p.read_text(encoding="utf-8") or '"lazy"' in p.read_text()}
    assert naming == {"toy_plugin.py", Path(__file__).name}
