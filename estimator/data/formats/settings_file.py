"""Settings as TOML files: nested frozen dataclasses as tables, their docstrings as comments."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from estimator.data.formats.checked_config import parsed_toml
from humanoid.support.files import read_bytes
from humanoid.support.settings import declared, is_group, members

_WIDTH = 110
_UNITS = r"(?: \[[^\]]*\])?"  # "turn_speed [rad/s]"


def load_settings(path: str | Path) -> dict[str, Any]:
    """The tables of a settings file, as `estimator.tracking.registry.settings_for` takes changes.

    Raises
    ------
    InputError: the file cannot be read or is not TOML, with the line.
    """
    return parsed_toml(read_bytes(Path(path)), path, remedy="`kinemode settings` writes one")


def settings_text(settings: Any, title: str) -> str:
    """Nested groups of settings as TOML, every group and setting with its description from the docstring, and every
    setting with its declared valid values.

    settings: a group (`humanoid.support.settings.members`) of groups. title: the first line.
    """
    lines = [*_comment(title), *_comment("A line that is left out keeps the tracker's own value.")]
    about = _described(settings)
    for name, group in members(settings).items():
        lines += _table(group, name, about.get(name))
    return "\n".join(lines) + "\n"


class _Entry(NamedTuple):
    """A docstring's entry for some settings: their names with units, and the text."""

    names: tuple[str, ...]
    heading: str
    text: str


def _table(group: Any, table: str, entry: _Entry | None) -> Iterator[str]:
    about, printed_notes = _described(group), set()
    yield ""
    if entry is not None:
        yield from _comment(f"{entry.heading}: {entry.text}")
    yield from _comment(_summary(group))
    yield f"[{table}]"
    values, valid = members(group), declared(group)
    for name, value in values.items():
        if is_group(value):
            continue
        note = about.get(name)
        if note is not None and note not in printed_notes:
            printed_notes.add(note)
            yield from _comment(f"{note.heading}: {note.text}")
        said = valid[name].said if name in valid else ""
        yield tomli_w.dumps({name: value}).rstrip() + (f"  # {said}" if said else "")
    for name, value in values.items():
        if is_group(value) and members(value):  # what only plugins fill may be empty
            yield from _table(value, f"{table}.{name}", about.get(name))


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)


def _summary(group: Any) -> str:
    kinds = (kind for kind in type(group).__mro__ if is_dataclass(kind))
    return next((said for kind in kinds if (said := _entries(kind, group)[0])), "")


def _described(group: Any) -> dict[str, _Entry]:
    """The description of each of the group's settings in the docstrings of its classes."""
    classes = [kind for kind in reversed(type(group).__mro__) if is_dataclass(kind)]
    return {name: entry for kind in classes for entry in _entries(kind, group)[1] for name in entry.names}


def _entries(kind: type, group: Any) -> tuple[str, list[_Entry]]:
    """The descriptions of the group, and of its settings, in a class' docstring: "a, b [m]: text. c: text."."""
    text = inspect.cleandoc(kind.__doc__ or "").partition("\n\nRaises")[0]
    text = re.sub(r"(?<=\.)\s+Raises InputError[^.]*\.", "", " ".join(text.split()))
    name = f"(?:{'|'.join(re.escape(f.name) for f in fields(group))}){_UNITS}"
    heads = list(re.finditer(rf"(?:^|(?<=[.;:] ))({name}(?:, {name})*): ", text))
    starts = [*(head.start() for head in heads), len(text)]
    entries = [
        _Entry(
            tuple(re.sub(_UNITS.removesuffix("?"), "", head[1]).split(", ")),
            head[1],
            text[head.end() : end].strip().rstrip(";."),
        )
        for head, end in zip(heads, starts[1:], strict=True)
    ]
    return text[: starts[0]].strip(), entries
