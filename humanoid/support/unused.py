"""Rules of which settings have no effect under which others; they stand beside the settings that they are about."""

from __future__ import annotations

from typing import Any, NamedTuple

PICTURES, ONE_CAMERA = "pictures", "one camera"
"""What a setting may need of the input: that pictures are looked at, that there is one camera."""


class UnusedRule(NamedTuple):
    """Settings that have no effect, or groups that stand for all in them, by their names with their groups in front;
    where all of `where` have these values, or, where it is given, on input without what they need. because: why, where
    the values do not say it."""

    names: tuple[str, ...]
    where: tuple[tuple[str, Any], ...] = ()
    because: str = ""
    needs: str = ""

    def of_group(self, old: str, new: str) -> UnusedRule:
        """The same of settings that stand in the group `new` instead of `old`."""

        def moved(name: str) -> str:
            return new + name[len(old) :] if name == old or name.startswith(f"{old}.") else name

        names = tuple(moved(name) for name in self.names)
        return self._replace(names=names, where=tuple((moved(name), value) for name, value in self.where))

    @property
    def reason(self) -> str:
        """Why they have none."""
        said = [f"{name} is {_said(value)}" for name, value in self.where]
        return " and ".join([*said, self.because] if self.because else said)


def _said(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return "empty" if value == "" else f"{value:g}" if value == 0 else str(value)


def unused_where(names: str, because: str = "", **where: Any) -> UnusedRule:
    """names: separated by blanks. where: names with two underscores for their dots."""
    conditions = tuple((name.replace("__", "."), value) for name, value in where.items())
    return UnusedRule(tuple(names.split()), conditions, because)


def unused_without(needs: str, names: str) -> UnusedRule:
    """Settings, their names separated by blanks, that need `PICTURES` or `ONE_CAMERA`."""
    return UnusedRule(tuple(names.split()), needs=needs)
