"""Settings files: what is written can be read back, and what is wrong in one is named with its place."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import pytest

from estimator.formats.settings_file import load_settings, settings_text
from estimator.tracking.idle_rules import OF_ONE_CAMERA, OF_PICTURES, RULES
from estimator.tracking.registry import GROUPS, TRACKERS, settings_for
from estimator.tracking.setting_changes import every_setting
from humanoid.support.errors import InputError
from kinemode.settings import (
    check_workers,
    choose,
    choose_for_all,
    describe_settings,
    read_settings,
    write_settings,
)

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


IDLE = {
    ("css", "[css]\ntransition = false\nflip_penalty = 2.0\n"): ("[css] flip_penalty", "css.transition is off"),
    ("css", "[css]\nshape = 'weakest'\ntail = 4.0\n"): ("[css] tail", "css.shape is weakest"),
    ("css", "[css]\nflips = 0\nflip_penalty = 2.0\n"): ("[css] flip_penalty", "css.flips is 0"),
    ("css", "[single_mode]\nlimits = false\n"): ("[single_mode] limits", "css goes by [css]"),
    ("css", "[smooth]\nlag = 3\n"): ("[smooth] lag", "live use"),
    ("css", "[cost]\npose_prior_file = 'a.json'\n"): ("[cost] pose_prior_file", "cost.pose_prior_weight is 0"),
    ("css", "[cost]\npotential = 'gaussian'\nnu = 3.0\n"): ("[cost] nu", "cost.potential is gaussian"),
    ("css", "[search]\nweigh_samples = 9\n"): ("[search] weigh_samples", "search.weigh is height"),
    ("css", "[cues]\nuse_flow = false\n[cues.flow]\ntolerance = 1.0\n"): ("[cues.flow] tolerance", "use_flow is off"),
    ("css", "[css.budget]\ncalm = 1.0\nalarm = 3.0\n"): ("[css.budget] alarm", "css.budget.calm is 1"),
    ("css-paper", "[smooth]\nwindow = 9\n"): ("[smooth] window", "smooth.enabled is off"),
    ("css-paper", "[css]\nother_readings = 3\n"): ("[css] other_readings", "search.exchange is off"),
    ("single-mode", "[css]\nmodes = 3\n"): ("[css] modes", "single-mode goes by [single_mode]"),
    ("condensation", "[cost]\ntransition_nu = 3.0\n"): ("[cost] transition_nu", "dynamics alone"),
    ("robust-single-mode", "[search.contact]\nsteps = 3\n"): ("[search.contact] steps", "interpenetration_weight is 0"),
}


@pytest.mark.parametrize("case", IDLE)
def test_settings_without_effect_are_refused(case: tuple[str, str], tmp_path: Path) -> None:
    tracker, text = case
    path = tmp_path / "idle.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        choose(tracker, path).check(fits=False)
    place, why = IDLE[case]
    assert str(error.value).startswith(f"{path}: {place}: has no effect: ")
    assert why in str(error.value)
    with pytest.raises(InputError, match=r"settings\.\w"):
        choose(tracker, load_settings(path)).check(fits=False)


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_settings_file_as_it_is_written_is_taken(tracker: str, tmp_path: Path) -> None:
    choose(tracker, write_settings(tmp_path / "all.toml", tracker)).check(fits=False)


def test_rules_name_settings_that_there_are() -> None:
    names = {f"{table}.{name}" for table, name, _ in every_setting(settings_for("css"))}
    groups = {name.rpartition(".")[0] for name in names}
    for rule in RULES:
        assert set(rule.names) <= names | groups
        assert {name for name, _ in rule.where} <= names
        assert rule.group in ("", *GROUPS.values())
    for name in (*OF_PICTURES, *OF_ONE_CAMERA):
        assert name in names | groups


def test_what_acts_on_the_fit_alone_is_no_setting_without_effect() -> None:
    chosen = choose("condensation", {"cost": {"transition_nu": 3.0, "nu": 5.0}})
    chosen.check(fits=True)
    assert chosen.for_fit.cost.transition_nu == 3.0
    with pytest.raises(InputError, match="transition_nu"):
        chosen.check(fits=False)
    gaussian = choose("gaussian-single-mode", {"search": {"spare": 5}})
    assert gaussian.for_fit.search.spare == 5
    assert gaussian.for_fit.cost == settings_for("css").cost  # the tracker's own potential is not the fit's
    assert choose("css-paper", {"css": {"samples": 9}}).for_fit.css == settings_for("css").css
    assert choose("css", {"css": {"samples": 9}}).for_fit.css.samples == 9


def test_several_hypotheses_of_a_single_mode_are_refused() -> None:
    assert read_settings("single-mode", None, modes=1) == settings_for("single-mode")
    with pytest.raises(InputError, match=r"modes: single-mode keeps a single hypothesis.*css, css-paper"):
        read_settings("single-mode", None, modes=3)


def test_processes_are_refused_where_they_share_nothing() -> None:
    check_workers(choose("css", None), 2)
    check_workers(choose("multiple-hypothesis", None), 2)
    check_workers(choose("annealed", None), 1)
    for name in ("annealed", "condensation", "single-mode", "gaussian-multiple-hypothesis"):
        with pytest.raises(InputError, match=rf"workers: {name} works in one process.*css, css-paper"):
            check_workers(choose(name, None), 2)


def test_for_several_trackers_it_is_enough_if_one_uses_it() -> None:
    changes = {"css": {"samples": 3}, "single_mode": {"limits": False}, "cost": {"nu": 5.0}}
    found = choose_for_all(("single-mode", "css", "condensation"), changes, 4, 2, fits=False)
    assert found["single-mode"] == ({"css": {}, "single_mode": {"limits": False}, "cost": {"nu": 5.0}}, None, 1)
    assert found["css"] == ({"css": {"samples": 3}, "single_mode": {}, "cost": {"nu": 5.0}}, 4, 2)
    assert found["condensation"][1:] == (4, 1)
    for name, (own, modes, _) in found.items():
        choose(name, own, modes).check(fits=False)
    for trackers, wrong in (
        (("single-mode", "condensation"), {"given": {"css": {"samples": 3}}}),
        (("single-mode", "robust-single-mode"), {"modes": 3}),
        (("single-mode", "condensation"), {"workers": 2}),
    ):
        given = {"given": None, "modes": None, "workers": 1, **wrong}
        with pytest.raises(InputError, match="css"):
            choose_for_all(trackers, fits=False, **given)


def test_what_has_no_effect_on_this_input_is_noted() -> None:
    chosen = choose("css", {"css": {"flips": 3}, "cost": {"image": {"flow_nu": 3.0, "edge_nu": 3.0}}})
    assert chosen.notes(cues=chosen.settings.cues, cameras=1, fits=False) == []
    (several,) = chosen.notes(cues=chosen.settings.cues, cameras=4, fits=False)
    assert several == "settings without effect here: css.flips (it is for one camera, there are 4)"
    (blind,) = chosen.notes(cues=None, cameras=1, fits=False)
    assert blind.endswith("cost.image.edge_nu, cost.image.flow_nu (no pictures are looked at)")
    (edges,) = chosen.notes(cues=replace(chosen.settings.cues, use_flow=False), cameras=1, fits=False)
    assert "flow_nu" in edges
    assert "edge_nu" not in edges


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
