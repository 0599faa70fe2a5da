"""A tracker's settings as a file: written with every value explained, read back as changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from estimator.data.formats.settings_file import load_settings, settings_text
from estimator.search.cost_terms import without_prior
from estimator.tracking.registry import (
    DEFAULT,
    TRACKERS,
    Settings,
    changes_for,
    other_tables,
    settings_for,
)
from estimator.tracking.unused_settings import (
    UnusedSetting,
    changed_names,
    fit_settings,
    unused_settings,
    unused_with_input,
    without,
)
from estimator.vision.cues.settings import CueSettings
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from humanoid.support.files import replacing

PathLike = str | Path


@dataclass(frozen=True)
class Chosen:
    """A tracker with its settings. changes: what was changed of its own, as nested mappings; source: the file that they
    are from, None where a program gave them."""

    tracker: str
    settings: Settings
    changes: Mapping[str, Any]
    source: PathLike | None = None

    @property
    def for_fit(self) -> Settings:
        """The settings of a fit of the subject, see `estimator.tracking.unused_settings.fit_settings`."""
        return fit_settings(self.tracker, self.settings, self.changes)

    def unused(self, fits: bool) -> list[UnusedSetting]:
        """Changed settings without effect. fits: whether the subject is fitted first."""
        return unused_settings(self.tracker, self.settings, self.changes, fits=fits)

    def check(self, fits: bool) -> None:
        """Raise InputError where something was changed without effect."""
        for unused in self.unused(fits):
            raise unused.refused(self.source)

    def used(self, fits: bool) -> dict[str, Any]:
        """The changes without those that have no effect."""
        return without(self.changes, [unused.name for unused in self.unused(fits)])

    def notes_on_body(self, body: Body) -> list[str]:
        """A share that was given to the pose prior, where the body goes without."""
        cost = self.settings.cost
        given = "pose_prior_weight" in self.changes.get("cost", {})
        problem = without_prior(body, cost) if given and cost.stabiliser_weight * cost.pose_prior_weight > 0.0 else None
        if problem is None:
            return []
        return [f"settings without effect here: cost.pose_prior_weight (the pose prior shipped needs {problem})"]

    def notes(self, *, cues: CueSettings | None, cameras: int, fits: bool) -> list[str]:
        """Settings without effect on this input. cues: those that are used, None for none."""
        settings = self.settings if cues is None else replace(self.settings, cues=cues)
        unused = unused_with_input(
            self.tracker, settings, self.changes, fits=fits, pictures=cues is not None, cameras=cameras
        )
        why = dict.fromkeys(i.because for i in unused)
        return [
            f"settings without effect here: {', '.join(i.name for i in unused if i.because == b)} ({b})" for b in why
        ]


def choose(tracker: str, given: Mapping[str, Any] | PathLike | None, modes: int | None = None) -> Chosen:
    """A tracker's settings with the changes that a mapping or a TOML file makes; `modes` goes before both.

    Raises
    ------
    InputError: an unknown tracker; a file that cannot be read; an unknown setting or an invalid value.
    """
    return _choose(tracker, *loaded_changes(given), modes)


def loaded_changes(given: Mapping[str, Any] | PathLike | None) -> tuple[Mapping[str, Any], PathLike | None]:
    """Changes to settings, and the file that they are from, None where a program gave them. Raises InputError where the
    file cannot be read."""
    source = None if given is None or isinstance(given, Mapping) else given
    return (load_settings(source) if source is not None else cast(Mapping[str, Any], given or {})), source


def _choose(tracker: str, given: Mapping[str, Any], source: PathLike | None, modes: int | None) -> Chosen:
    settings = settings_for(tracker, modes=modes, changes=given, source=source)
    return Chosen(tracker, settings, dict(given), source)


def read_settings(tracker: str, given: Mapping[str, Any] | PathLike | None, modes: int | None = None) -> Settings:
    """The settings alone, see `choose`."""
    return choose(tracker, given, modes).settings


def choose_for_all(
    trackers: Sequence[str], given: Mapping[str, Any] | PathLike | None, modes: int | None, fits: bool
) -> dict[str, tuple[dict[str, Any], int | None]]:
    """For each of several trackers the changes and the modes that have an effect on it.

    trackers: in the order of their turns. fits: whether the subject is fitted, which the first does for all. given: a
    tracker takes its own table of it, and the common ones.

    Raises
    ------
    InputError: as `choose`; something that has no effect on any of them.
    """
    changes, source = loaded_changes(given)
    several = [name for name in trackers if TRACKERS[name].keeps_several]
    used = {name: modes if name in several else None for name in trackers}
    if modes is not None and not several:
        settings_for(trackers[0], modes=modes)
    strange = set[str].intersection(*(other_tables(name) for name in trackers))  # refused by the first of them
    given_to = {
        name: {k: v for k, v in changes.items() if k in strange} | changes_for(name, changes) for name in trackers
    }
    chosen = {name: _choose(name, given_to[name], source, used[name]) for name in trackers}
    _check_each_acts(list(chosen.values()), fits)
    own = {name: c.used(fits and name == trackers[0]) for name, c in chosen.items()}
    return {name: (own[name], used[name]) for name in trackers}


def _check_each_acts(chosen: Sequence[Chosen], fits: bool) -> None:
    """Raise InputError where a change has no effect on any of several trackers, the first of which may fit."""
    unused: list[UnusedSetting] = []
    acting: set[str] = set()
    for c in chosen:
        own = c.unused(fits and c is chosen[0])
        acting |= set(changed_names(c.tracker, c.settings)) - {i.name for i in own}
        unused += own
    for i in unused:
        if i.name not in acting:
            raise i.refused(chosen[0].source)


def describe_settings(tracker: str = DEFAULT) -> str:
    """All settings of a tracker as the text of a TOML file that `track` takes; raises InputError for an unknown one."""
    title = f"Settings of the tracker {tracker}, for: kinemode track --tracker {tracker} --settings FILE"
    return settings_text(settings_for(tracker), title)


def write_settings(path: PathLike, tracker: str = DEFAULT) -> Path:
    """Write `describe_settings` to a file that is not there yet, and return its path.

    Raises
    ------
    InputError: an unknown tracker, a file that is there or cannot be written.
    """
    path, text = Path(path), describe_settings(tracker)
    if path.exists():
        raise InputError(path, "exists already", remedy="give another name; it may have been edited")
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path
