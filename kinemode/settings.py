"""A tracker's settings as a file: written with every value explained, read back as changes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator.formats.settings_file import load_settings, settings_text
from estimator.trackers.registry import GROUPS, Settings, settings_for
from humanoid.atomic import replacing
from humanoid.errors import InputError

PathLike = str | Path


def read_settings(tracker: str, given: Mapping[str, Any] | PathLike | None, modes: int | None = None) -> Settings:
    """Settings of a tracker with the changes that a mapping or a TOML file makes; `modes` goes before both.

    Raises
    ------
    InputError: an unknown tracker; a file that cannot be read; an unknown setting or a value that cannot be.
    """
    if given is None or isinstance(given, Mapping):
        return settings_for(tracker, modes=modes, changes=given)
    return settings_for(tracker, modes=modes, changes=load_settings(given), source=given)


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
