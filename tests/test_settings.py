"""Settings files: what is written can be read back, and faults are named with their place."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from estimator.data.formats.settings_file import load_settings, settings_text
from estimator.tracking.registry import TRACKERS, settings_for, stored_changes
from estimator.tracking.setting_changes import FORMER
from estimator.tracking.unused_settings import RULES
from estimator.vision.cues.settings import unused_rules
from humanoid.support.errors import InputError
from humanoid.support.settings import ONE_CAMERA, PICTURES, declared, every_setting, is_group, members, setting
from kinemode.settings import (
    choose,
    choose_for_all,
    describe_settings,
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

    size [px]: first. It continues: so. flag, word: both. Raises InputError for invalid values.
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
        "# size [px]: first. It continues: so",
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


def test_options_override_files_and_files_override_defaults(tmp_path: Path) -> None:
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
    ("css-paper", "[css]\nswapped_readings = 3\n"): ("[css] swapped_readings", "search.exchange is off"),
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
def test_rules_name_existing_settings(tracker: str) -> None:
    names = {f"{table}.{name}" for table, name, _ in every_setting(settings_for(tracker))}
    groups = {name.rpartition(".")[0] for name in names}
    for rule in (*RULES, *unused_rules(), *TRACKERS[tracker].unused):
        assert set(rule.names) <= names | groups
        assert {name for name, _ in rule.where} <= names
        assert rule.needs in ("", PICTURES, ONE_CAMERA)


def test_a_rule_is_for_what_a_default_or_the_input_decides() -> None:
    """Not for what can only be off by choice."""
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


def test_settings_of_the_fit_alone_have_an_effect() -> None:
    chosen = choose("condensation", {"cost": {"transition_nu": 3.0, "nu": 5.0}})
    chosen.check(fits=True)
    assert chosen.for_fit.cost.transition_nu == 3.0
    with pytest.raises(InputError, match="transition_nu"):
        chosen.check(fits=False)
    gaussian = choose("gaussian-single-mode", {"search": {"spare": 5}})
    assert gaussian.for_fit.search.spare == 5
    assert gaussian.for_fit.cost == settings_for("css").cost  # the fit does not use the tracker's potential
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


def test_run_files_of_earlier_versions_have_other_names() -> None:
    """Settings that were in another group, groups and settings of trackers, deep within their tables too."""
    once = {"edge_nu": 3.0, "depth_noise": 0.1, "rounds": 2}
    stored = {"cost": {"nu": 5.0, "image": once}, "cues": {"edges": {"window": 0.2}}, "css": {"flips": 3}, "fit": "off"}
    cues = {"edges": {"window": 0.2, "nu": 3.0}, "depth": {"surface_noise": 0.1}, "surface": {"rounds": 2}}
    now = {"cost": {"nu": 5.0}, "cues": cues, "css": {"jumps": 3}}
    assert stored_changes("css", stored) == now
    hull = {"shout": {"hull": {"kept": 7}}, "propagation": {"product": {"sighted": False}}}
    settings = settings_for("loose-limbed", changes=stored_changes("loose-limbed", {"loose_limbed": hull}))
    assert settings.own.part_detectors.hull.survivors == 7
    assert not settings.own.propagation.product.image_weighted
    with pytest.raises(InputError, match="no setting 'flips'"):  # user input must have the current names
        choose("css", {"css": {"flips": 3}})


@pytest.mark.parametrize("former", FORMER)
def test_every_former_name_has_a_setting_or_a_group_now(former: str) -> None:
    table, *path = FORMER[former].split(".")
    group: Any = settings_for("css" if table != "loose_limbed" else "loose-limbed")
    for name in (table, *path):
        group = members(group)[name]
