"""Changes to nested settings, from a program or a file: every name, kind and value is checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from humanoid.support.errors import InputError, near_names, shown
from humanoid.support.settings import LARGEST, Valid, declared, every_setting, is_group, members, with_members

_KINDS = {bool: "true or false (bool)", int: "a whole number (int)", float: "a number (float)", str: "text (str)"}

T = TypeVar("T")
_OF_CUES = {
    **{f"edge_{name}": f"edges.{name}" for name in ("evidence", "noise", "window", "candidates", "nu")},
    "motion_boundary": "edges.motion_boundary",
    **{f"flow_{name}": f"flow.{name}" for name in ("evidence", "leading", "noise", "share", "nu")},
    **{f"outline_{name}": f"silhouette.{name}" for name in ("evidence", "noise", "nu")},
    "depth_evidence": "depth.evidence",
    "depth_noise": "depth.surface_noise",
    "depth_slide": "depth.slide",
    "depth_nu": "depth.nu",
    **{
        name: f"surface.{name}"
        for name in (
            "nodes",
            "fineness",
            "beside_keypoints",
            "visibility_evidence",
            "back_facing",
            "occluded",
            "rounds",
        )
    },
}
FORMER = {
    **{f"cost.image.{former}": f"cues.{now}" for former, now in _OF_CUES.items()},
    "search.settled": "search.reassign_tolerance",
    "css.other_readings": "css.swapped_readings",
    "css.flips": "css.jumps",
    "css.flip_penalty": "css.jump_penalty",
    "loose_limbed.shout": "loose_limbed.part_detectors",
    "loose_limbed.part_detectors.hull.kept": "loose_limbed.part_detectors.hull.survivors",
    "loose_limbed.propagation.product.sighted": "loose_limbed.propagation.product.image_weighted",
}
"""Present names by former ones, of settings and of groups, with their groups in front."""


def changed(settings: T, changes: Mapping[str, Any], source: str | Path | None = None) -> T:
    """A group of settings with nested changes: a table for a group, a value for a setting.

    source: the file that the changes are from; None where a program gave them.

    Raises
    ------
    InputError: an unknown name (the message names the nearest and all valid ones), a value of another kind than the
        setting's, or one that cannot work; with file, table and name.
    """
    return _Changes(source, settings).of(settings, changes, "")


def refused(source: object, table: str, name: str, problem: str, remedy: str) -> InputError:
    """The error of a setting; of a whole group where `name` is empty. source: as in `changed`."""
    if source is None:
        return InputError(".".join(part for part in ("settings", table, name) if part), problem, remedy=remedy)
    return InputError(str(source), problem, place=f"[{table}] {name}".strip() if table else name, remedy=remedy)


@dataclass(frozen=True)
class _Changes:
    """The source of changes, for messages. source: see `changed`. root: all settings."""

    source: str | Path | None
    root: Any

    def of(self, group: T, changes: Mapping[str, Any], table: str) -> T:
        """A group, whose name is `table`, with its changes."""
        known, valid = members(group), declared(group)
        new: dict[str, Any] = {}
        for name, value in changes.items():
            if name not in known:
                raise self._refused(table, "", f"no setting {shown(name)}", self._meant(name, table, list(known)))
            if is_group(known[name]):
                if not isinstance(value, Mapping):
                    raise self._refused(table, name, "is a group of settings", "give a table")
                new[name] = self.of(known[name], value, f"{table}.{name}".removeprefix("."))
            else:
                new[name] = self._value(table, name, value, type(known[name]), valid.get(name, Valid()))
        try:
            return with_members(group, new)
        except InputError as error:  # a group's own check
            raise self._refused(table, "", error.problem, error.remedy) from None

    def _value(self, table: str, name: str, value: Any, kind: type[Any], valid: Valid) -> Any:
        """A value of a setting's kind; whole numbers do where others are meant."""
        if kind is float and type(value) is int and abs(value) <= LARGEST:
            value = float(value)
        if type(value) is not kind and not (kind is float and type(value) is int):
            raise self._refused(table, name, f"{shown(value)} is not {_KINDS[kind]}", "")
        if wanted := valid.wanted(value, kind):
            raise self._refused(table, name, f"{shown(value)} cannot work", wanted)
        return value

    def _meant(self, name: str, table: str, known: list[str]) -> str:
        """A suggestion for an unknown name."""
        elsewhere = [place for place, setting, _ in every_setting(self.root) if setting == name and place != table]
        close = near_names(name, known, most=1)
        said = f"did you mean {close[0]}? " if close else ""
        if elsewhere:  # an existing name helps more than a similar one
            said = f"it belongs to {' or '.join(f'[{place}]' for place in elsewhere)}; here: "
        return said + "one of " + ", ".join(known)

    def _refused(self, table: str, name: str, problem: str, remedy: str) -> InputError:
        return refused(self.source, table, name, problem, remedy)


def with_present_names(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Nested settings with every setting by its present name."""
    for former, name in FORMER.items():
        *groups, last = former.split(".")
        holder: Any = stored
        for group in groups:
            holder = holder.get(group) if isinstance(holder, Mapping) else None
        if isinstance(holder, Mapping) and last in holder:
            stored = _with(_without(stored, former.split(".")), name.split("."), holder[last])
    return dict(stored)


def _without(settings: Mapping[str, Any], path: list[str]) -> dict[str, Any]:
    """Settings without one of them, and without groups left empty."""
    first, *rest = path
    inner = _without(settings[first], rest) if rest else {}
    left = {name: value for name, value in settings.items() if name != first}
    return {**left, first: inner} if inner else left


def _with(settings: Mapping[str, Any], path: list[str], value: Any) -> dict[str, Any]:
    first, *rest = path
    return {**settings, first: _with(settings.get(first, {}), rest, value) if rest else value}
