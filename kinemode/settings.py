"""A tracker's settings as a file: written with every value explained, read back as changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from estimator.formats.settings_file import load_settings, settings_text
from estimator.imaging.cues import CueSettings
from estimator.tracking.idle_settings import Idle, fit_settings, idle_settings, idle_with_input, without
from estimator.tracking.registry import GROUPS, TRACKERS, Settings, keeps_several, settings_for, shares_work
from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError

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
        """What a fit of the subject goes by, see `estimator.tracking.idle_settings.fit_settings`."""
        return fit_settings(self.tracker, self.settings, self.changes)

    def idle(self, fits: bool) -> list[Idle]:
        """What was changed without effect. fits: whether the subject is fitted first."""
        return idle_settings(self.tracker, self.settings, self.changes, fits=fits)

    def check(self, fits: bool) -> None:
        """Raise InputError where something was changed without effect."""
        for idle in self.idle(fits):
            raise idle.refused(self.source)

    def used(self, fits: bool) -> dict[str, Any]:
        """The changes without those that have no effect."""
        return without(self.changes, [idle.name for idle in self.idle(fits)])

    def notes(self, *, cues: CueSettings | None, cameras: int, fits: bool) -> list[str]:
        """What has no effect on this input. cues: those that are looked at, None for none."""
        settings = self.settings if cues is None else replace(self.settings, cues=cues)
        found = idle_with_input(
            self.tracker, settings, self.changes, fits=fits, pictures=cues is not None, cameras=cameras
        )
        why = dict.fromkeys(i.because for i in found)
        return [
            f"settings without effect here: {', '.join(i.name for i in found if i.because == b)} ({b})" for b in why
        ]


def choose(tracker: str, given: Mapping[str, Any] | PathLike | None, modes: int | None = None) -> Chosen:
    """A tracker's settings with the changes that a mapping or a TOML file makes; `modes` goes before both.

    Raises
    ------
    InputError: an unknown tracker; a file that cannot be read; an unknown setting or a value that cannot be.
    """
    source = None if given is None or isinstance(given, Mapping) else given
    changes = load_settings(source) if source is not None else cast(Mapping[str, Any], given or {})
    return Chosen(tracker, settings_for(tracker, modes=modes, changes=changes, source=source), changes, source)


def read_settings(tracker: str, given: Mapping[str, Any] | PathLike | None, modes: int | None = None) -> Settings:
    """The settings alone, see `choose`."""
    return choose(tracker, given, modes).settings


def choose_for_all(
    trackers: Sequence[str], given: Mapping[str, Any] | PathLike | None, modes: int | None, workers: int, fits: bool
) -> dict[str, tuple[dict[str, Any], int | None, int]]:
    """For each of several trackers the changes, the modes and the workers that have an effect on it.

    trackers: in the order of their turns. fits: whether the subject is fitted, which the first does for all.

    Raises
    ------
    InputError: as `choose`; something that has no effect on any of them.
    """
    several = [name for name in trackers if keeps_several(name)]
    used = {name: modes if name in several else None for name in trackers}
    if modes is not None and not several:
        settings_for(trackers[0], modes=modes)
    chosen = {name: choose(name, given, used[name]) for name in trackers}
    idle = {name: c.idle(fits and name == trackers[0]) for name, c in chosen.items()}
    in_all = set.intersection(*({i.name for i in found} for found in idle.values()))
    for i in idle[trackers[0]]:
        if i.name in in_all:
            raise i.refused(chosen[trackers[0]].source)
    if workers > 1 and not any(shares_work(name, c.settings) for name, c in chosen.items()):
        check_workers(chosen[trackers[0]], workers)
    own = {name: c.used(fits and name == trackers[0]) for name, c in chosen.items()}
    hands = {name: workers if shares_work(name, c.settings) else 1 for name, c in chosen.items()}
    return {name: (own[name], used[name], hands[name]) for name in trackers}


def check_workers(chosen: Chosen, workers: int) -> None:
    """Raise InputError where several processes would have nothing to share."""
    if workers > 1 and not shares_work(chosen.tracker, chosen.settings):
        sharing = ", ".join(name for name in TRACKERS if shares_work(name, settings_for(name)))
        raise InputError(
            "workers", f"{chosen.tracker} works in one process", remedy=f"leave it out; work is shared by {sharing}"
        )


def describe_settings(tracker: str = "css") -> str:
    """All settings of a tracker as the text of a TOML file that `track` takes; raises InputError for an unknown one."""
    settings = settings_for(tracker)
    unused = set(GROUPS.values()) - {GROUPS[tracker]}
    title = f"Settings of the tracker {tracker}, for: kinemode track --tracker {tracker} --settings FILE"
    return settings_text(settings, title, leave_out=unused)


def write_settings(path: PathLike, tracker: str = "css") -> Path:
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
