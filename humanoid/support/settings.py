"""Settings: frozen dataclasses whose fields declare which values can work, in groups that may hold other groups, and
rules of which have no effect under which others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, NamedTuple, TypeVar

from humanoid.support.errors import InputError

LARGEST, SMALLEST, MOST = 1e9, 1e-12, 100_000
"""No setting needs a number beyond LARGEST, a count beyond MOST, or one nearer to zero than SMALLEST that is not zero;
only a tolerance may be as good as nothing."""
_DECLARED = "kinemode setting"

T = TypeVar("T")


@dataclass(frozen=True)
class Valid:
    """Which values of a setting can work.

    at_least, above, at_most, below: bounds of a number, None where there is none. tiny: numbers nearer to zero than
    `SMALLEST` are taken too. one_of: the words that a text may be, any where it is empty.
    """

    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None
    below: float | None = None
    tiny: bool = False
    one_of: tuple[str, ...] = ()

    @property
    def said(self) -> str:
        """The declared bounds or words as text: "more than 0, at most 1"; empty where none are."""
        bounds = (
            (self.at_least, "{:g} or more"), (self.above, "more than {:g}"), (self.at_most, "at most {:g}"),
            (self.below, "less than {:g}"),
        )  # fmt: skip
        if self.one_of:
            return "one of " + ", ".join(self.one_of)
        return ", ".join(text.format(bound) for bound, text in bounds if bound is not None)

    def wanted(self, value: Any, kind: type[Any]) -> str:
        """The requirement that an invalid value misses, empty for a valid one. kind: the setting's, bool, int, float or
        str."""
        if kind is str:
            return self.said if self.one_of and value not in self.one_of else ""
        most = MOST if kind is int else LARGEST
        if kind is bool or self._holds(value, most):
            return ""
        ends = self.at_most is not None or self.below is not None
        said = self.said if ends else ", ".join(part for part in (self.said, f"at most {most:g}") if part)
        return f"a finite number, {said}"

    def _holds(self, value: float, most: float) -> bool:
        bounds = (
            abs(value) <= most,  # also false of NaN
            self.tiny or value == 0 or abs(value) >= SMALLEST,
            self.at_least is None or value >= self.at_least,
            self.above is None or value > self.above,
            self.at_most is None or value <= self.at_most,
            self.below is None or value < self.below,
        )
        return all(bounds)


def setting(
    default: Any,
    *,
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
    below: float | None = None,
    tiny: bool = False,
    one_of: tuple[str, ...] = (),
) -> Any:
    """A field of a settings dataclass with its default and what can work, see `Valid`.

    The meaning of a setting is in the docstring of its dataclass, from which settings files take it.
    """
    valid = Valid(at_least, above, at_most, below, tiny, tuple(one_of))
    return field(default=default, metadata={_DECLARED: valid})


def declared(group: Any) -> dict[str, Valid]:
    """The declarations of a group's fields by name, without settings that declare nothing."""
    named = fields(group) if is_dataclass(group) else ()
    return {f.name: f.metadata[_DECLARED] for f in named if _DECLARED in f.metadata}


class CheckedSettings:
    """Base of settings dataclasses that programs make too: an invalid value raises InputError."""

    def __post_init__(self) -> None:
        for name, valid in declared(self).items():
            value = getattr(self, name)
            # the default is in the class and gives the kind
            if not is_group(value) and (wanted := valid.wanted(value, type(getattr(type(self), name)))):
                words = "".join(f" {c.lower()}" if c.isupper() else c for c in type(self).__name__).strip()
                raise InputError(words, f"{name} is {value!r}", remedy=wanted)


def is_group(value: Any) -> bool:
    """Whether a value holds settings by name: a dataclass, or a mapping."""
    return isinstance(value, Mapping) or (is_dataclass(value) and not isinstance(value, type))


def members(group: Any) -> dict[str, Any]:
    """The settings of a group, and the groups in it, by name.

    They are a dataclass' fields or a mapping's items, or what a method `members` of the group returns; such a group
    also has the inverse, `with_members(new)`.
    """
    if hasattr(group, "members"):
        return dict(group.members())
    return dict(group) if isinstance(group, Mapping) else {f.name: getattr(group, f.name) for f in fields(group)}


def with_members(group: T, new: Mapping[str, Any]) -> T:
    """The group with some of its members exchanged. InputError: its own check refuses them."""
    if hasattr(group, "with_members"):
        return group.with_members(new)
    if isinstance(group, Mapping):
        return {**group, **new}  # type: ignore[return-value]
    return replace(group, **new)  # type: ignore[type-var]


def plain(group: Any) -> Any:
    """A group as nested dictionaries."""
    return {name: plain(value) for name, value in members(group).items()} if is_group(group) else group


def every_setting(group: Any, table: str = "") -> Iterator[tuple[str, str, Any]]:
    """(table, name, value) of every setting in nested groups."""
    for name, value in members(group).items():
        if is_group(value):
            yield from every_setting(value, f"{table}.{name}".removeprefix("."))
        else:
            yield table, name, value


PICTURES, ONE_CAMERA = "pictures", "one camera"
"""What a setting may require of the input: pictures, or a single camera."""


class UnusedRule(NamedTuple):
    """Settings that have no effect, or whole groups, by their names with their groups in front;
    where all of `where` have these values, or, where it is given, on input without what they need. because: why, where
    the values do not show it."""

    names: tuple[str, ...]
    where: tuple[tuple[str, Any], ...] = ()
    because: str = ""
    needs: str = ""

    def of_group(self, old: str, new: str) -> UnusedRule:
        """The same rule for settings in the group `new` instead of `old`."""

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
