"""Members of a family by name, and the modules of other packages that register some."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from typing import Protocol, TypeVar

from humanoid.support.errors import InputError

VARIABLE = "KINEMODE_PLUGINS"
"""The environment variable that names modules, with commas between them."""
ENTRY_POINTS = "kinemode.plugins"
"""The group of entry points whose modules are imported too."""


class Named(Protocol):
    """A named member of a registry."""

    @property
    def name(self) -> str:
        """The name by which it is chosen."""
        ...


Member = TypeVar("Member", bound=Named)


class Registry(Mapping[str, Member]):
    """A family's members by name, in the order in which they were registered.

    The first look-up imports the plugins (`load_plugins`), which may register more; an unknown name is an InputError
    that lists the others.

    Parameters
    ----------
    kind: what a member is called, as "tracker". members: the built-in ones. check: raises InputError where a member
    conflicts with existing ones.
    """

    def __init__(
        self,
        kind: str,
        members: Iterable[Member] = (),
        check: Callable[[Member, Iterable[Member]], None] | None = None,
    ) -> None:
        self._kind, self._check = kind, check
        self._members: dict[str, Member] = {}
        for member in members:
            self.register(member)

    def register(self, member: Member) -> None:
        """Add a member. Raises InputError where its name is taken."""
        if member.name in self._members:
            raise InputError(self._kind, f"there is already one named {member.name}", remedy="give it another name")
        if self._check is not None:
            self._check(member, self._members.values())
        self._members[member.name] = member

    @contextmanager
    def restored(self) -> Iterator[None]:
        """What is registered within it is removed at its end: for tests of a member that must not stay registered."""
        load_plugins()
        before = dict(self._members)
        try:
            yield
        finally:
            self._members = before

    def __getitem__(self, name: str) -> Member:
        load_plugins()
        if name not in self._members:
            raise InputError(self._kind, f"no {self._kind} {name!r}", remedy="one of " + ", ".join(self._members))
        return self._members[name]

    def __contains__(self, name: object) -> bool:
        load_plugins()
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        load_plugins()
        return iter(self._members)

    def __len__(self) -> int:
        load_plugins()
        return len(self._members)


class _Plugins:
    """Imported once in a process; failures are reported at every look-up."""

    def __init__(self) -> None:
        self._begun = False
        self._failure: tuple[str, str, str] | None = None

    def load(self) -> None:
        if not self._begun:
            self._begun = True  # a plugin may itself look up a name
            try:
                self._import_all()
            except InputError as error:
                self._failure = error.source, error.problem, error.remedy
                raise
        elif self._failure is not None:
            source, problem, remedy = self._failure
            raise InputError(source, problem, remedy=remedy)

    def _import_all(self) -> None:
        for name in dict.fromkeys(part.strip() for part in os.environ.get(VARIABLE, "").split(",")):
            if name:
                _imported(partial(import_module, name), VARIABLE, name)
        for point in entry_points(group=ENTRY_POINTS):
            _imported(point.load, f"entry point {point.name} of {ENTRY_POINTS}", point.value)


def _imported(load: Callable[[], object], source: str, module: str) -> None:
    try:
        load()
    except Exception as error:  # importing a module can raise anything
        told = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        remedy = f"leave {module} out of it, or fix it" if source == VARIABLE else "fix or uninstall its package"
        raise InputError(source, f"module {module} cannot be imported: {told}", remedy=remedy) from error


_plugins = _Plugins()


def load_plugins() -> None:
    """Import the modules named in the environment variable `KINEMODE_PLUGINS` and the entry points of the group
    `kinemode.plugins`, once in a process; each registers what it has when it is imported.

    Processes that are started from this one read the same variable. Raises InputError, which names the variable or the
    entry point, the module and what went wrong, now and whenever it is called again.
    """
    _plugins.load()
