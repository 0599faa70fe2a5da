"""Trackers by name, and everything that decides a track besides subject, clip and seed: their settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from estimator.search.cost_terms import CostSettings
from estimator.search.settings import ModeSearchSettings
from estimator.trackers import markers
from estimator.trackers.base import TrackerProtocol
from estimator.trackers.baselines import annealed, condensation, multiple_hypothesis, single_mode
from estimator.trackers.css import css_dual, tracker as css
from estimator.trackers.dual_chain import tracker as dual_chain
from estimator.trackers.elmo import tracker as elmo
from estimator.trackers.loose_limbed import tracker as loose_limbed
from estimator.trackers.spec import Spec
from estimator.tracking.setting_changes import changed, refused, with_present_names
from estimator.tracking.smoothing import SmoothSettings
from estimator.vision.cues.settings import CueSettings, cue_settings
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, shown
from humanoid.support.plugins import Registry
from humanoid.support.settings import MOST, plain

COMMON = ("cost", "search", "smooth", "cues")
"""The groups that are there for every tracker."""


@dataclass(frozen=True)
class Settings:
    """Everything that decides a track, besides subject, clip and seed.

    cost: the energy. search: how its minima are found. smooth: the smoothing after the last frame. cues: what is taken
    from the pictures. own: the tracker's own settings, None where it has none; table: the group that these are in files
    and changes, as "css".
    """

    cost: CostSettings = field(default_factory=CostSettings)
    search: ModeSearchSettings = field(default_factory=ModeSearchSettings)
    own: Any = None
    smooth: SmoothSettings = field(default_factory=SmoothSettings)
    cues: CueSettings = field(default_factory=cue_settings)
    table: str = ""

    def members(self) -> dict[str, Any]:
        """The groups by name, as `humanoid.support.settings.members` takes them."""
        own = {} if self.own is None else {self.table: self.own}
        return {"cost": self.cost, "search": self.search, **own, "smooth": self.smooth, "cues": self.cues}

    def with_members(self, new: Mapping[str, Any]) -> Settings:
        """The settings with some groups replaced."""
        groups = dict(new)
        own = groups.pop(self.table, self.own)
        return replace(self, own=own, **groups)

    def to_dict(self) -> dict[str, Any]:
        """Plain nested dictionary, as stored in run files; groups that only plugins fill are left out where empty."""
        return _without_empty(plain(self))


def _without_empty(group: Mapping[str, Any]) -> dict[str, Any]:
    filled = {name: _without_empty(value) if isinstance(value, Mapping) else value for name, value in group.items()}
    return {name: value for name, value in filled.items() if value != {}}


_BESIDE = ("fit", "person", "height")  # what run files keep beside the settings
DEFAULT = "css"
"""The tracker that is used where none is named, and by which a fit of the subject goes."""


def _check(spec: Spec, others: Iterable[Spec]) -> None:
    """Raise InputError where a tracker's table of settings is not one, or another tracker's."""
    if bool(spec.group) != (spec.settings is not None):
        raise InputError(f"tracker {spec.name}", "has settings without a group, or a group without settings")
    if spec.group in (*COMMON, *_BESIDE):
        raise InputError(f"tracker {spec.name}", f"its group of settings cannot be {spec.group!r}")
    for other in others:
        if spec.group and other.group == spec.group and type(other.settings) is not type(spec.settings):
            raise InputError(f"tracker {spec.name}", f"{other.name} has other settings in the group {spec.group!r}")


TRACKERS: Registry[Spec] = Registry(
    "tracker",
    (
        *css.SPECS,
        *single_mode.SPECS,
        condensation.SPEC,
        annealed.SPEC,
        *multiple_hypothesis.SPECS,
        *elmo.SPECS,
        loose_limbed.SPEC,
        *dual_chain.SPECS,
        css_dual.SPEC,
        markers.SPEC,
    ),
    _check,
)
register = TRACKERS.register


def settings_for(
    name: str,
    *,
    modes: int | None = None,
    changes: Mapping[str, Any] | None = None,
    source: str | Path | None = None,
) -> Settings:
    """Defaults of a tracker, then nested `changes` (the layout of `Settings.to_dict`), then `modes`.

    source: the file that the changes are from, for errors.

    Raises
    ------
    InputError: unknown tracker, unknown setting (the valid ones are listed), a value of the wrong kind, the settings of
        another tracker, or several modes of a tracker that keeps one.
    """
    spec = TRACKERS[name]
    for table, values in (changes or {}).items():
        if table in other_tables(name):
            first = next(iter(values), "") if isinstance(values, Mapping) else ""
            raise refused(source, table, first, f"has no effect: {_group_note(spec)}", "leave it out")
    settings = changed(_defaults(spec), changes or {}, source)
    if modes is None:
        return settings
    if not 1 <= modes <= MOST:
        raise InputError("modes", f"{shown(modes)} hypotheses cannot be kept", remedy=f"at least 1, at most {MOST}")
    if not spec.keeps_several:
        if modes > 1:
            several = ", ".join(other.name for other in TRACKERS.values() if other.keeps_several)
            raise InputError("modes", f"{name} keeps a single hypothesis", remedy=f"leave it out; several: {several}")
        return settings
    return replace(settings, own=replace(settings.own, modes=modes))


def common_settings(changes: Mapping[str, Any], source: str | Path | None = None) -> Settings:
    """The settings that belong to no tracker, by those of the `changes` that are not about a tracker."""
    return changed(Settings(), {name: changes[name] for name in COMMON if name in changes}, source)


def other_tables(name: str) -> set[str]:
    """The groups of settings that are other trackers' own."""
    return {spec.group for spec in TRACKERS.values()} - {TRACKERS[name].group, ""}


def changes_for(name: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The changes without other trackers' own settings."""
    others = other_tables(name)
    return {table: values for table, values in changes.items() if table not in others}


def stored_settings(name: str, stored: Mapping[str, Any]) -> dict[str, Any]:
    """The settings in a run file as they would be stored now: files once had those of all trackers, and settings other
    names."""
    return changes_for(name, with_present_names(stored))


def stored_changes(name: str, stored: Mapping[str, Any]) -> dict[str, Any]:
    """The same without what is not a setting, as changes."""
    return {table: values for table, values in stored_settings(name, stored).items() if table not in _BESIDE}


def make_tracker(name: str, body: Body, settings: Settings | None = None) -> TrackerProtocol[Any]:
    """A tracker for a body; one object serves one clip.

    Raises
    ------
    InputError: an unknown name, the settings of another tracker.
    """
    spec = TRACKERS[name]
    settings = settings or _defaults(spec)
    if settings.table != spec.group:
        raise InputError("settings", f"are those of another tracker: {_group_note(spec)}")
    return spec.make(body, settings)


def _defaults(spec: Spec) -> Settings:
    return changed(Settings(own=spec.settings, table=spec.group), spec.defaults)


def _group_note(spec: Spec) -> str:
    return f"the tracker {spec.name} " + (f"uses [{spec.group}]" if spec.group else "has no settings of its own")
