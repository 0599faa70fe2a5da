"""Changes to nested settings, from a program or a file: every name, kind and value is checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from estimator.terms.potentials import POTENTIALS
from humanoid.support.errors import InputError, shown

MAY_BE_ZERO = {
    "stabiliser_weight", "upright_weight", "interpenetration_weight", "exchange_penalty", "landmark_mismatch",
    "forgetting", "samples", "flips", "flip_penalty", "spare", "decrease_tolerance", "exact_below", "tolerance",
    "distinct", "edge_evidence", "outline_evidence", "flow_evidence", "visibility_evidence", "motion_boundary",
    "flow_share", "finest_scale", "momentum", "limb_samples", "exchanges", "limb_searches", "pose_prior_weight",
    "calm", "tail", "other_readings", "settled",
}  # fmt: skip
LARGEST, SMALLEST, MOST = 1e9, 1e-12, 100_000
"""No setting needs a number beyond LARGEST, a count beyond MOST, or one below SMALLEST that is not zero; only a
tolerance may be as good as nothing."""
AT_MOST = {
    "motion_boundary": 1.0,  # beyond, an edge's weight 1 - k S_p is negative
    "pose_prior_weight": 1.0,  # a share
    "survival": 1.0,  # a share
}
_KINDS = {bool: "true or false (bool)", int: "whole number (int)", float: "number (float)", str: "text (str)"}

T = TypeVar("T")


def changed(settings: T, changes: Mapping[str, Any], source: str | Path | None = None) -> T:
    """A frozen dataclass of settings with nested changes: a table for a group, a value for a setting.

    source: the file that the changes are from; None where a program gave them.

    Raises
    ------
    InputError: an unknown name (the nearest and all valid ones are told), a value of another kind than the setting's,
        or one that cannot work; with file, table and name.
    """
    return _Changes(source, settings).of(settings, changes, "")


@dataclass(frozen=True)
class _Changes:
    """Where changes come from, for what is said about them. source: see `changed`. root: all settings."""

    source: str | Path | None
    root: Any

    def of(self, settings: T, changes: Mapping[str, Any], table: str) -> T:
        """A group, whose name is `table`, with its changes."""
        assert is_dataclass(settings)
        known = {f.name: getattr(settings, f.name) for f in fields(settings)}
        new: dict[str, Any] = {}
        for name, value in changes.items():
            if name not in known:
                raise self._refused(table, "", f"no setting {shown(name)}", self._valid(name, table, list(known)))
            if is_dataclass(known[name]):
                if not isinstance(value, Mapping):
                    raise self._refused(table, name, "is a group of settings", "give a table")
                new[name] = self.of(known[name], value, f"{table}.{name}".removeprefix("."))
            else:
                new[name] = self._value(table, name, value, type(known[name]))
        try:
            return replace(settings, **new)  # type: ignore[type-var]
        except InputError as error:  # a group's own check
            raise self._refused(table, "", error.problem, error.remedy) from None

    def _value(self, table: str, name: str, value: Any, kind: type[Any]) -> Any:
        """A value of a setting's kind; whole numbers do where others are meant."""
        if kind is float and type(value) is int and abs(value) <= LARGEST:
            value = float(value)
        if type(value) is not kind and not (kind is float and type(value) is int):
            raise self._refused(table, name, f"{shown(value)} is no {_KINDS[kind]}", "")
        if name.endswith("potential") and value not in POTENTIALS:
            raise self._refused(table, name, f"no potential {shown(value)}", "one of " + ", ".join(POTENTIALS))
        if isinstance(value, (int, float)) and kind is not bool:
            lowest, wanted = _lowest(name, kind)
            highest = AT_MOST.get(name, MOST if kind is int else LARGEST)
            if not (lowest <= value <= highest or (value == 0.0 and name in MAY_BE_ZERO)):
                wanted = f"a finite number, {wanted}, at most {highest:g}"
                raise self._refused(table, name, f"{shown(value)} cannot work", wanted)
        return value

    def _valid(self, name: str, table: str, known: list[str]) -> str:
        """What may have been meant."""
        close = get_close_matches(name, known, n=1, cutoff=0.6)
        elsewhere = [place for place, setting, _ in every_setting(self.root) if setting == name and place != table]
        said = f"did you mean {close[0]}? " if close else ""
        if elsewhere and not close:
            said = f"it belongs to {' or '.join(f'[{place}]' for place in elsewhere)}; here: "
        return said + "one of " + ", ".join(known)

    def _refused(self, table: str, name: str, problem: str, remedy: str) -> InputError:
        if self.source is None:
            return InputError(".".join(part for part in ("settings", table, name) if part), problem, remedy=remedy)
        place = f"[{table}] {name}".strip() if table else name
        return InputError(self.source, problem, place=place, remedy=remedy)


def _lowest(name: str, kind: type) -> tuple[float, str]:
    if kind is int:
        return (0.0, "0 or more") if name in MAY_BE_ZERO else (1.0, "1 or more")
    smallest = float(np.nextafter(0.0, 1.0)) if name.endswith("tolerance") else SMALLEST
    return smallest, "0 or more" if name in MAY_BE_ZERO else "more than 0"


def every_setting(group: Any, table: str = "") -> Iterator[tuple[str, str, Any]]:
    """(table, name, value) of every setting in nested groups."""
    for f in fields(group):
        value = getattr(group, f.name)
        if is_dataclass(value):
            yield from every_setting(value, f"{table}.{f.name}".removeprefix("."))
        else:
            yield table, f.name, value
