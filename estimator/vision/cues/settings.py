"""The cues there are, by name, and their settings."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, fields, make_dataclass, replace
from functools import cache
from typing import Any

from estimator.vision.cues.anchors import Anchor
from estimator.vision.cues.base import Cue, SurfaceSettings
from estimator.vision.cues.colour import Colour
from estimator.vision.cues.depth import Depth
from estimator.vision.cues.edges import Edges
from estimator.vision.cues.flow import Flow
from estimator.vision.cues.silhouette import Outline
from humanoid.support.errors import InputError
from humanoid.support.plugins import Registry
from humanoid.support.settings import CheckedSettings, UnusedRule, setting


def _check(cue: Cue, others: Iterable[Cue]) -> None:
    if (
        not cue.name.isidentifier()
        or cue.name.startswith("use_")
        or cue.name in ("auto", "off", "working_size", "surface")
    ):
        raise InputError("cue", f"none can be named {cue.name!r}", remedy="a plain word, not auto or off")


CUES: Registry[Cue] = Registry("cue", (Edges(), Flow(), Outline(), Depth(), Colour(), Anchor()), _check)
"""All cues by name, in the order in which their energies are summed."""


def register(cue: Cue) -> None:
    """Make a cue known: to `--cues`, the settings and all that uses the pictures.

    It is read, and its energy summed, after the existing ones. Worker processes have it too, if they can import its
    class. Raises InputError where the name is taken, or no plain word.
    """
    CUES.register(cue)


def cues_of(read: Collection[str]) -> list[Cue]:
    """The cues that something was read for, in the order of `CUES`."""
    return [cue for cue in CUES.values() if cue.name in read]


_USE = "use_"


@dataclass(frozen=True)
class CueSettings(CheckedSettings):
    """Which cues are computed, how, and how they enter the energy.

    working_size: longest side of the pictures they are computed from [px]; larger frames are reduced to it. surface:
    what they share.
    """

    # `cue_settings` makes them: each registered cue adds a truth value `use_NAME` and a group `NAME` of its own

    working_size: int = setting(640, at_least=64)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)

    @property
    def used(self) -> tuple[str, ...]:
        """Names of the cues that are computed, in the order of registration."""
        return tuple(name for name in self._names if getattr(self, _USE + name))

    def using(self, names: Iterable[str]) -> CueSettings:
        """The same with these cues and no others."""
        chosen = set(names)
        uses: dict[str, Any] = {_USE + name: name in chosen for name in self._names}
        return replace(self, **uses)

    def of(self, name: str) -> Any:
        """The settings of one cue."""
        return getattr(self, name)

    @property
    def _names(self) -> list[str]:
        return [f.name.removeprefix(_USE) for f in fields(self) if f.name.startswith(_USE)]

    def __reduce__(self) -> tuple[Any, ...]:
        """The cues are pickled along, so that a worker process, which has imported no plug-in, has them too."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return _unpacked, (tuple(CUES[name] for name in self._names), values)


def cue_settings(names: Iterable[str] | None = None, *, working_size: int = CueSettings.working_size) -> CueSettings:
    """The default settings of all registered cues, with these `names` in use, or all of them."""
    made = _settings_of(tuple(CUES.values()))(working_size=working_size)
    return made if names is None else made.using(names)


def unused_rules() -> tuple[UnusedRule, ...]:
    """The settings of an unused cue have no effect."""
    return tuple(UnusedRule((f"cues.{name}",), ((f"cues.{_USE}{name}", False),)) for name in CUES)


@cache
def _settings_of(known: tuple[Cue, ...]) -> type[CueSettings]:
    """`CueSettings` with the fields of these cues, and what they are."""
    uses: list[Any] = [(_USE + cue.name, bool, field(default=True)) for cue in known]
    groups: list[Any] = [(cue.name, type(cue.settings), field(default=cue.settings)) for cue in known]
    made = make_dataclass("CueSettings", [*uses, *groups], bases=(CueSettings,), frozen=True)
    made.__doc__ = " ".join(f"{_USE}{cue.name}: {cue.summary}." for cue in known)
    return made


def _unpacked(known: tuple[Cue, ...], values: dict[str, Any]) -> CueSettings:
    for cue in known:
        if cue.name not in CUES:
            register(cue)
    return _settings_of(tuple(CUES[cue.name] for cue in known))(**values)
