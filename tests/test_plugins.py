"""Trackers of other packages: found by the environment variable, listed, configured and refused like built-in ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from estimator.trackers.spec import Spec
from estimator.tracking.registry import TRACKERS, make_tracker, settings_for
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE, Registry
from kinemode import __main__ as front
from kinemode.settings import choose
from tests.command_lines import CommandResult, plugins_here, ran, run_with_plugins

ROOT = Path(__file__).resolve().parent.parent
HERE: dict[str, Any] = {"names": "toy_plugin", "path": Path(__file__).parent}


LAZY = ["--tracker", "lazy"]
REFUSED = {
    "too many": (LAZY, "[lazy]\nnaps = 6", "[lazy] naps: 6 cannot work (a finite number, 0 or more, at most 5)"),
    "no choice": (LAZY, "[lazy]\nbed = 'car'", "[lazy] bed: 'car' cannot work (one of sofa, floor)"),
    "no setting": (LAZY, "[lazy]\nnap = 1", "[lazy]: no setting 'nap' (did you mean naps? one of naps, depth, bed)"),
    "unused": (LAZY, "[lazy]\nnaps = 0\ndepth = 1.0", "[lazy] depth: has no effect: lazy.naps is 0"),
    "another's": (LAZY, "[css]\nmodes = 3", "[css] modes: has no effect: the tracker lazy uses [lazy]"),
    "unused table": ([], "[lazy]\nnaps = 1", "[lazy] naps: has no effect: the tracker css uses [css]"),
}


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> dict[str, CommandResult]:
    folder = tmp_path_factory.mktemp("plugins")
    clip = folder / "a.mp4"
    clip.write_bytes(b"opened after the settings are read")
    lines = {"trackers": ["trackers"], "settings": ["settings", *LAZY]}
    for name, (tracker, text, _) in REFUSED.items():
        file = folder / f"{name}.toml"
        file.write_text(text)
        lines[name] = ["track", str(clip), *tracker, "--settings", str(file), "--out", str(folder / "a.run")]
    return dict(zip(lines, run_with_plugins(*lines.values(), **HERE), strict=True))


def test_a_plugin_is_listed_with_its_settings(commands: Mapping[str, CommandResult]) -> None:
    assert all(part in commands["trackers"].out for part in ("lazy ", "stays where it is", "css-paper"))
    written = commands["settings"].out
    assert written.partition("[lazy]\n")[2].partition("\n\n")[0].splitlines() == [
        "# naps: how many a frame",
        "naps = 2  # 0 or more, at most 5",
        "# depth: of a nap",
        "depth = 0.5  # more than 0",
        "# bed: where",
        'bed = "sofa"  # one of sofa, floor',
    ]
    assert "[css]" not in written
    assert "enabled = false" in written.partition("[smooth]")[2]


def test_its_settings_are_taken_from_a_file_and_made_into_a_tracker(
    commands: Mapping[str, CommandResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "lazy.toml"
    path.write_text(commands["settings"].out.replace("naps = 2", "naps = 5").replace("depth = 0.5", "depth = 2"))
    with plugins_here(HERE["names"], HERE["path"]):
        chosen = choose("lazy", path)
        chosen.check(fits=False)
        body: Any = "a body"
        made: Any = make_tracker("lazy", body, chosen.settings)
        assert type(made).__name__ == "Lazy"
        assert made.body == body
        assert made.settings is chosen.settings.own
        assert chosen.settings.to_dict()["lazy"] == {"naps": 5, "depth": 2.0, "bed": "sofa"}
        assert chosen.settings.cost.nu == 8.0
        assert list(chosen.notes(cues=None, cameras=1, fits=False)) == []
    assert "lazy" not in TRACKERS


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_in_its_table_is_refused(name: str, commands: Mapping[str, CommandResult]) -> None:
    assert commands[name].code == 2
    assert commands[name].error.startswith("error: ")
    assert f"/{name}.toml: {REFUSED[name][2]}" in commands[name].error


def test_without_the_variable_no_plugin_is_loaded(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["settings", *LAZY]) == front.BAD_INPUT
    assert "no tracker 'lazy' (one of css, css-paper" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("source", "why"),
    [
        (None, "ModuleNotFoundError: No module named 'broken'"),
        ("import sys\nsys.no_such_name", "AttributeError: module 'sys' has no attribute 'no_such_name'"),
    ],
)
def test_a_module_that_cannot_be_imported_is_named_at_every_lookup(
    source: str | None, why: str, tmp_path: Path
) -> None:
    (tmp_path / "whole.py").write_text("print('imported')")
    if source is not None:
        (tmp_path / "broken.py").write_text(source)
    code = (
        "from humanoid.support.plugins import load_plugins\n"
        "for _ in range(2):\n"
        "    try: load_plugins()\n"
        "    except ValueError as error: print(error)\n"
    )
    remedy = "leave broken out of it, or fix it"
    problem = f"{VARIABLE}: module broken cannot be imported: {why} ({remedy})"
    assert ran(code, names=" whole, broken", path=tmp_path).splitlines() == ["imported", problem, problem]


def test_modules_of_installed_packages_are_imported_too(tmp_path: Path) -> None:
    information = tmp_path / "dreams-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: dreams\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[kinemode.plugins]\nsleep = asleep\n")
    code = "from humanoid.support.plugins import load_plugins\ntry: load_plugins()\nexcept ValueError as e: print(e)"
    (tmp_path / "asleep.py").write_text("print('imported')")
    assert ran(code, names="", path=tmp_path) == "imported\n"
    (tmp_path / "asleep.py").write_text("1 / 0")
    assert ran(code, names="", path=tmp_path).startswith(
        "entry point sleep of kinemode.plugins: module asleep cannot be imported: ZeroDivisionError"
    )


def test_a_name_that_is_taken_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "twin.py").write_text(
        "from estimator.tracking.registry import TRACKERS, register\nregister(TRACKERS['css'])\n"
    )
    with plugins_here("twin", tmp_path):
        assert front.main(["trackers"]) == front.BAD_INPUT
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "module twin cannot be imported: tracker: there is already one named css" in printed.err


@dataclass(frozen=True)
class Member:
    name: str


def test_members_keep_their_order_and_their_names() -> None:
    family = Registry("thing", [Member("b"), Member("a")])
    family.register(Member("c"))
    assert list(family) == ["b", "a", "c"]
    assert "c" in family
    with pytest.raises(InputError, match="thing: there is already one named b"):
        family.register(Member("b"))
    with pytest.raises(InputError, match=r"thing: no thing 'd' \(one of b, a, c\)"):
        family["d"]
    with family.restored():
        family.register(Member("d"))
        assert family["d"].name == "d"
    assert list(family) == ["b", "a", "c"]


@pytest.mark.parametrize(
    ("message", "change"),
    [
        ("cannot be 'cost'", lambda s: replace(s, group="cost")),
        ("cannot be 'person'", lambda s: replace(s, group="person")),
        ("settings without a group", lambda s: replace(s, group="")),
        ("css has other settings", lambda s: replace(s, settings=settings_for("css").cues)),
    ],
)
def test_a_table_is_one_trackers_own(message: str, change: Callable[[Spec], Spec]) -> None:
    with pytest.raises(InputError, match=f"tracker another: .*{message}"):
        TRACKERS.register(change(replace(TRACKERS["css"], name="another")))
    assert "another" not in TRACKERS


def test_nothing_else_names_the_toy() -> None:
    packages = ("humanoid", "estimator", "viz", "kinemode", "tests", "examples", "benchmarks")
    texts = {p: p.read_text(encoding="utf-8") for package in packages for p in (ROOT / package).rglob("*.py")}
    naming = {p.name for p, text in texts.items() if "toy_plugin" in text or '"lazy"' in text}
    assert naming == {"toy_plugin.py", Path(__file__).name}
