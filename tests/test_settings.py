"""Settings files: what is written can be read back, and what is wrong in one is named with its place."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

from estimator.data.formats.settings_file import load_settings, settings_text
from estimator.tracking.registry import TRACKERS, current_changes, settings_for
from estimator.tracking.unused_settings import RULES
from estimator.vision.likelihood.settings import unused_rules
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from humanoid.support.settings import declared, every_setting, is_group, members, setting
from humanoid.support.unused import ONE_CAMERA, PICTURES
from kinemode.settings import (
    choose,
    choose_for_all,
    describe_settings,
    former_names_in,
    read_settings,
    write_settings,
)

CHANGES = {
    "cost": {"nu": 0.1 + 0.2, "potential": "leclerc"},
    "search": {"exchange": False, "explore": {"kkt_tolerance": 1e-300}},
    "cues": {"use_flow": False, "flow": {"finest_scale": 2}, "edges": {"candidates": 2, "motion_boundary": 0}},
}


@dataclass(frozen=True)
class Inner:
    """About the inner.

    size [px]: first. It goes on: so. flag, word: both. Raises InputError where they cannot be.
    """

    word: str = 'a "b" \\ é'
    size: int = setting(3, at_least=1, at_most=9)
    flag: bool = True


@dataclass(frozen=True)
class Outer:
    """All. inner: a group."""

    inner: Inner = field(default_factory=Inner)


def test_comments_are_the_docstrings() -> None:
    assert settings_text(Outer(), "title").splitlines() == [
        "# title",
        "# A line that is left out keeps the tracker's own value.",
        "",
        "# inner: a group",
        "# About the inner.",
        "[inner]",
        "# flag, word: both",
        'word = "a \\"b\\" \\\\ é"',
        "# size [px]: first. It goes on: so",
        "size = 3  # 1 or more, at most 9",
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
    assert read_settings("css", path).own.modes == 3
    assert read_settings("css", path, modes=5).own.modes == 5
    assert read_settings("css", None).own.modes == 7


UNUSED = {
    ("css", "[css]\ntransition = false\njump_penalty = 2.0\n"): ("[css] jump_penalty", "css.transition is off"),
    ("css", "[css]\njumps = 0\njump_penalty = 2.0\n"): ("[css] jump_penalty", "css.jumps is 0"),
    ("css", "[single_mode]\nlimits = false\n"): ("[single_mode] limits", "css uses [css]"),
    ("css", "[smooth]\nlag = 3\n"): ("[smooth] lag", "live use"),
    ("css", "[cost]\npose_prior_weight = 0.0\npose_prior_file = 'a.json'\n"): (
        "[cost] pose_prior_file",
        "cost.pose_prior_weight is 0",
    ),
    ("css", "[cost]\npotential = 'gaussian'\nnu = 3.0\n"): ("[cost] nu", "cost.potential is gaussian"),
    ("css", "[search]\nweigh_samples = 9\n"): ("[search] weigh_samples", "search.weigh is height"),
    ("css", "[cues]\nuse_flow = false\n[cues.flow]\ntolerance = 1.0\n"): ("[cues.flow] tolerance", "use_flow is off"),
    ("css", "[css.budget]\ncalm = 1.0\nalarm = 3.0\n"): ("[css.budget] alarm", "css.budget.calm is 1"),
    ("css-paper", "[smooth]\nwindow = 9\n"): ("[smooth] window", "smooth.enabled is off"),
    ("css-paper", "[css]\nother_readings = 3\n"): ("[css] swapped_readings", "search.exchange is off"),
    ("single-mode", "[css]\nmodes = 3\n"): ("[css] modes", "single-mode uses [single_mode]"),
    ("condensation", "[cost]\ntransition_nu = 3.0\n"): ("[cost] transition_nu", "dynamics alone"),
    ("robust-single-mode", "[search.contact]\nsteps = 3\n"): ("[search.contact] steps", "interpenetration_weight is 0"),
}


@pytest.mark.parametrize("case", UNUSED)
def test_settings_without_effect_are_refused(case: tuple[str, str], tmp_path: Path) -> None:
    tracker, text = case
    path = tmp_path / "unused.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        choose(tracker, path).check(fits=False)
    place, why = UNUSED[case]
    assert str(error.value).startswith(f"{path}: {place}: has no effect: ")
    assert why in str(error.value)
    with pytest.raises(InputError, match=r"settings\.\w"):
        choose(tracker, load_settings(path)).check(fits=False)


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_settings_file_as_it_is_written_is_taken(tracker: str, tmp_path: Path) -> None:
    choose(tracker, write_settings(tmp_path / "all.toml", tracker)).check(fits=False)


@pytest.mark.parametrize("tracker", TRACKERS)
def test_rules_name_settings_that_there_are(tracker: str) -> None:
    names = {f"{table}.{name}" for table, name, _ in every_setting(settings_for(tracker))}
    groups = {name.rpartition(".")[0] for name in names}
    for rule in (*RULES, *unused_rules(), *TRACKERS[tracker].unused):
        assert set(rule.names) <= names | groups
        assert {name for name, _ in rule.where} <= names
        assert rule.needs in ("", PICTURES, ONE_CAMERA)


def test_a_rule_is_for_what_a_default_or_the_input_decides() -> None:
    """Not for what somebody must have turned off."""
    rules = {name: (*RULES, *unused_rules(), *spec.unused) for name, spec in TRACKERS.items()}
    acting = set()
    for name, of_tracker in rules.items():
        values = {f"{table}.{key}": value for table, key, value in every_setting(settings_for(name))}
        for rule in of_tracker:
            decided = [values[n] == value for n, value in rule.where if not n.startswith("cues.use_")]
            acting |= {rule} if rule.needs or all(decided) else set()
    for rule in {rule for of_tracker in rules.values() for rule in of_tracker}:
        assert {rule, rule.of_group("css_dual", "css")} & acting, rule


@pytest.mark.parametrize("tracker", TRACKERS)
def test_every_number_declares_what_can_work_and_has_a_default_that_can(tracker: str) -> None:
    def look(group: object) -> None:
        valid = declared(group)
        for name, value in members(group).items():
            if is_group(value):
                look(value)
            elif isinstance(value, (int, float)) and not isinstance(value, bool):
                assert valid[name].said
                assert not valid[name].wanted(value, type(value))

    look(settings_for(tracker))


def test_a_setting_may_be_called_by_its_former_name() -> None:
    chosen = choose("css", {"css": {"flips": 3, "flip_penalty": 2.0}})
    assert chosen.settings == settings_for("css", changes={"css": {"jumps": 3, "jump_penalty": 2.0}})
    assert chosen.changes == {"css": {"jumps": 3, "jump_penalty": 2.0}}
    assert chosen.notes(cues=chosen.settings.cues, cameras=1, fits=False) == [
        "the setting css.flips is called css.jumps now",
        "the setting css.flip_penalty is called css.jump_penalty now",
    ]
    told = former_names_in(("css", "css-paper", "annealed"), {"css": {"flips": 3}, "annealed": {"layers": 3}})
    assert told == ["the setting css.flips is called css.jumps now"]
    with pytest.raises(InputError, match=r"settings\.css\.flips: is called jumps now, and both are given"):
        choose("css", {"css": {"flips": 3, "jumps": 3}})


def test_what_acts_on_the_fit_alone_is_no_setting_without_effect() -> None:
    chosen = choose("condensation", {"cost": {"transition_nu": 3.0, "nu": 5.0}})
    chosen.check(fits=True)
    assert chosen.for_fit.cost.transition_nu == 3.0
    with pytest.raises(InputError, match="transition_nu"):
        chosen.check(fits=False)
    gaussian = choose("gaussian-single-mode", {"search": {"spare": 5}})
    assert gaussian.for_fit.search.spare == 5
    assert gaussian.for_fit.cost == settings_for("css").cost  # the tracker's own potential is not the fit's
    assert choose("css-paper", {"css": {"samples": 9}}).for_fit.own == settings_for("css").own
    assert choose("css", {"css": {"samples": 9}}).for_fit.own.samples == 9


def test_several_hypotheses_of_a_single_mode_are_refused() -> None:
    assert read_settings("single-mode", None, modes=1) == settings_for("single-mode")
    with pytest.raises(InputError, match=r"modes: single-mode keeps a single hypothesis.*css, css-paper"):
        read_settings("single-mode", None, modes=3)


def test_for_several_trackers_it_is_enough_if_one_uses_it() -> None:
    changes = {"css": {"samples": 3}, "single_mode": {"limits": False}, "cost": {"nu": 5.0}}
    chosen = choose_for_all(("single-mode", "css", "condensation"), changes, 4, fits=False)
    assert chosen["single-mode"] == ({"single_mode": {"limits": False}, "cost": {"nu": 5.0}}, None)
    assert chosen["css"] == ({"css": {"samples": 3}, "cost": {"nu": 5.0}}, 4)
    assert chosen["condensation"][1] == 4
    for name, (own, modes) in chosen.items():
        choose(name, own, modes).check(fits=False)
    for trackers, wrong in (
        (("single-mode", "condensation"), {"given": {"css": {"samples": 3}}}),
        (("single-mode", "css"), {"given": {"css": {"transition": False, "jump_penalty": 2.0}}}),
        (("single-mode", "robust-single-mode"), {"modes": 3}),
    ):
        given = {"given": None, "modes": None, **wrong}
        with pytest.raises(InputError, match="css"):
            choose_for_all(trackers, fits=False, **given)


def test_what_has_no_effect_on_this_input_is_noted() -> None:
    chosen = choose("css", {"css": {"jumps": 3}, "cues": {"flow": {"nu": 3.0}, "edges": {"nu": 3.0}}})
    assert chosen.notes(cues=chosen.settings.cues, cameras=1, fits=False) == []
    (several,) = chosen.notes(cues=chosen.settings.cues, cameras=4, fits=False)
    assert several == "settings without effect here: css.jumps (it is for one camera, there are 4)"
    (blind,) = chosen.notes(cues=None, cameras=1, fits=False)
    assert blind.endswith("cues.edges.nu, cues.flow.nu (no pictures are used)")
    (edges,) = chosen.notes(cues=chosen.settings.cues.using(["edges", "silhouette"]), cameras=1, fits=False)
    assert "cues.flow" in edges
    assert "cues.edges" not in edges


def test_former_names_of_settings_and_groups_are_taken() -> None:
    """Those of the trackers, deep within their tables too."""
    given = {"shout": {"by_hull": False}, "propagation": {"product": {"sighted": False}}}
    chosen = choose("loose-limbed", {"loose_limbed": given})
    assert not chosen.settings.own.part_detectors.by_hull
    assert not chosen.settings.own.propagation.product.image_weighted
    notes = chosen.notes(cues=chosen.settings.cues, cameras=4, fits=False)
    assert "the setting loose_limbed.shout is called loose_limbed.part_detectors now" in notes
    assert choose("css", {"css": {"other_readings": 3}}).settings.own.swapped_readings == 3
    assert choose("css", {"search": {"settled": 0.02}}).settings.search.reassign_tolerance == 0.02
    by_hull = {"loose_limbed": {"part_detectors": {"hull": {"kept": 7}}}}
    assert choose("loose-limbed", by_hull).settings.own.part_detectors.hull.survivors == 7


def test_settings_of_another_group_once_are_found_where_they_are_now() -> None:
    once = {"edge_nu": 3.0, "depth_noise": 0.1, "rounds": 2}
    former = {"cost": {"nu": 5.0, "image": once}, "cues": {"edges": {"window": 0.2}}}
    cues = {"edges": {"window": 0.2, "nu": 3.0}, "depth": {"surface_noise": 0.1}, "surface": {"rounds": 2}}
    now = {"cost": {"nu": 5.0}, "cues": cues}
    assert choose("css", former).settings == choose("css", now).settings
    names, noted = current_changes("css", former)
    assert names == now
    assert "the setting cost.image.edge_nu is called cues.edges.nu now" in noted
    with pytest.raises(InputError, match=r"edge_nu: is called cues\.edges\.nu now"):
        choose("css", {"cost": {"image": {"edge_nu": 3.0}}, "cues": {"edges": {"nu": 3.0}}})


def test_a_pose_prior_that_the_body_does_not_suit_is_noted() -> None:
    other, human34 = Body(load_subject("upper13")), Body(load_subject("human34"))
    asked = {"cost": {"pose_prior_weight": 0.5}}
    for tracker in ("css", "css-paper"):
        (note,) = choose(tracker, asked).notes_on_body(other)
        assert note.startswith("settings without effect here: cost.pose_prior_weight (")
        assert "joints it does not have" in note
        assert choose(tracker, asked).notes_on_body(human34) == []
    for silent in (None, {"cost": {"pose_prior_weight": 0.0}}, {"cost": {"nu": 5.0}}):
        assert choose("css", silent).notes_on_body(other) == []


BAD = {
    "[cots]\n": ("no setting 'cots'", "did you mean cost?"),
    "[cost]\nkeypoint_nois = 1.0\n": ("[cost]: no setting 'keypoint_nois'", "did you mean keypoint_noise?"),
    "[cost]\nturn_spee = 1.0\n": ("[cost]: no setting 'turn_spee'", "did you mean turn_speed?"),
    "[cues]\nwindow = 1.0\n": ("[cues]: no setting 'window' (it belongs to [smooth] or [cues.edges]; here: one of",),
    "[cues.edges]\nzzz = 1\n": ("[cues.edges]: no setting 'zzz'", "noise, window"),
    "[css]\nmodes = 2.0\n": ("[css] modes: 2.0 is no whole number",),
    "[css]\nmodes = 0\n": ("[css] modes: 0 cannot work", "1 or more"),
    "[css]\nkeep = 1\n": ("[css] keep: 1 is no true or false",),
    "[cost]\nnu = 'wide'\n": ("[cost] nu: 'wide' is no number",),
    "[cost]\nnu = nan\n": ("[cost] nu: nan cannot work", "more than 0"),
    f"[cost]\nnu = 1{'0' * 400}\n": ("[cost] nu", "cannot work"),
    "[cost]\npotential = 'soft'\n": ("[cost] potential: 'soft' cannot work", "one of gaussian, lorentzian"),
    "[cost.image]\nmotion_boundary = 1.5\n": ("[cues.edges] motion_boundary: 1.5", "at most 1"),
    "cost = 3\n": ("cost: is a group of settings", "give a table"),
    "[cues.flow]\nfinest_scale = 7\n": ("[cues.flow] finest_scale: 7 cannot work", "0 or more, at most 2"),
    "[cues]\nworking_size = 8\n": ("[cues] working_size: 8 cannot work", "64 or more"),
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
