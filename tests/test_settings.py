"""Settings files: what is written can be read back, and what is wrong in one is named with its place."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

from estimator.formats.settings_file import load_settings, settings_text
from estimator.trackers.registry import TRACKERS, settings_for
from humanoid.errors import InputError
from kinemode.settings import describe_settings, read_settings, write_settings

CHANGES = {
    "cost": {"nu": 0.1 + 0.2, "potential": "leclerc", "image": {"edge_candidates": 2, "motion_boundary": 0}},
    "search": {"exchange": False, "explore": {"kkt_tolerance": 1e-300}},
    "cues": {"use_flow": False, "flow": {"finest_scale": 2}},
}


@dataclass(frozen=True)
class Inner:
    """About the inner.

    size [px]: first. It goes on: so. flag, word: both. Raises InputError where they cannot be.
    """

    word: str = 'a "b" \\ é'
    size: int = 3
    flag: bool = True


@dataclass(frozen=True)
class Outer:
    """All. inner: a group. other: never written."""

    inner: Inner = field(default_factory=Inner)
    other: Inner = field(default_factory=Inner)


def test_comments_are_the_docstrings() -> None:
    assert settings_text(Outer(), "title", leave_out=("other",)).splitlines() == [
        "# title",
        "# A line that is left out keeps the tracker's own value.",
        "",
        "# inner: a group",
        "# About the inner.",
        "[inner]",
        "# flag, word: both",
        'word = "a \\"b\\" \\\\ é"',
        "# size [px]: first. It goes on: so",
        "size = 3",
        "flag = true",
    ]


@pytest.mark.parametrize("tracker", TRACKERS)
def test_what_is_written_is_read_back(tracker: str, tmp_path: Path) -> None:
    path = write_settings(tmp_path / "all.toml", tracker)
    assert read_settings(tracker, path) == settings_for(tracker)
    changed = settings_for(tracker, changes=CHANGES)
    path.write_text(settings_text(changed, "changed"), encoding="utf-8")
    assert read_settings(tracker, path) == changed == read_settings(tracker, CHANGES)
    assert changed != settings_for(tracker)


def test_every_setting_is_written_and_nearly_all_are_explained() -> None:
    lines = describe_settings("css").splitlines()
    explained = sum(before.startswith("#") for before, line in pairwise(lines) if " = " in line)
    assert sum(" = " in line and not line.startswith("#") for line in lines) > 70
    assert explained > 50
    assert not any(line.startswith("[single_mode]") for line in lines)
    assert not any(line.startswith("[css]") for line in describe_settings("single-mode").splitlines())


def test_the_option_goes_before_the_file_and_the_file_before_the_default(tmp_path: Path) -> None:
    path = tmp_path / "few.toml"
    path.write_text("[css]\nmodes = 3\n")
    assert read_settings("css", path).css.modes == 3
    assert read_settings("css", path, modes=5).css.modes == 5
    assert read_settings("css", None).css.modes == 7


BAD = {
    "[cots]\n": ("no setting 'cots'", "did you mean cost?"),
    "[cost]\nkeypoint_nois = 1.0\n": ("[cost]: no setting 'keypoint_nois'", "did you mean keypoint_noise?"),
    "[cost]\nedge_noise = 1.0\n": ("[cost]: no setting 'edge_noise'", "[cost.image]"),
    "[cost.image]\nzzz = 1\n": ("[cost.image]: no setting 'zzz'", "edge_noise, edge_window"),
    "[css]\nmodes = 2.0\n": ("[css] modes: 2.0 is no whole number",),
    "[css]\nmodes = 0\n": ("[css] modes: 0 cannot work", "1 or more"),
    "[css]\nkeep = 1\n": ("[css] keep: 1 is no true or false",),
    "[cost]\nnu = 'wide'\n": ("[cost] nu: 'wide' is no number",),
    "[cost]\nnu = nan\n": ("[cost] nu: nan cannot work", "more than 0"),
    f"[cost]\nnu = 1{'0' * 400}\n": ("[cost] nu", "cannot work"),
    "[cost]\npotential = 'soft'\n": ("[cost] potential: no potential 'soft'", "lorentzian"),
    "[cost.image]\nmotion_boundary = 1.5\n": ("[cost.image] motion_boundary: 1.5", "at most 1"),
    "cost = 3\n": ("cost: is a group of settings", "give a table"),
    "[cues.flow]\nfinest_scale = 7\n": ("[cues.flow]: finest_scale is 7", "0, 1 or 2"),
    "[cues]\nworking_size = 8\n": ("[cues]: working_size is 8", "at least 64"),
    "[css]\nmodes = = 3\n": ("line 2, column 9", "is not TOML"),
    "[css]\nmodes = 3\nmodes = 4\n": ("line 3", "is not TOML"),
    "[css": ("is not TOML",),
}


@pytest.mark.parametrize("text", BAD)
def test_what_is_wrong_is_named_with_its_place(text: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_settings("css", path)
    assert str(error.value).startswith(f"{path}: ")
    assert all(part in str(error.value) for part in BAD[text])


def test_a_program_is_told_the_same_as_a_file(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    for changes, text in (({"css": {"modes": -1}}, "[css]\nmodes = -1"), ({"csss": {}}, "[csss]")):
        path.write_text(text)
        with pytest.raises(InputError) as of_file:
            read_settings("css", path)
        with pytest.raises(InputError) as of_mapping:
            read_settings("css", changes)
        assert (of_file.value.problem, of_file.value.remedy) == (of_mapping.value.problem, of_mapping.value.remedy)
        assert of_mapping.value.source.startswith("settings")


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for path, told in (
        (tmp_path / "none.toml", "no such file"),
        (tmp_path, "folder"),
        (tmp_path / "binary.toml", "text"),
    ):
        with pytest.raises(InputError, match=told):
            load_settings(path)
    with pytest.raises(InputError, match="exists already"):
        write_settings(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="tracker"):
        write_settings(tmp_path / "new.toml", "ccs")
    assert not (tmp_path / "new.toml").exists()
