"""The columns of a manifest: a few of its own, and every option of `track`, read by the types the command line has."""

from __future__ import annotations

import math
import os
import shlex
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import cyclopts

from humanoid.support.errors import nearest, shown
from kinemode.checks import is_word
from kinemode.flags import Files, SubjectOption, flag_types
from kinemode.option import Option, options_of
from kinemode.request import RunOptions, TrackRequest

NAME, CLIPS, PERSON, FITS, SUBJECT, REFERENCE, PERSON_ID = (
    "name", "clips", "person", "fits", "subject", "reference", "person_id",
)  # fmt: skip
OF_A_ROW = (NAME, CLIPS, PERSON, FITS, SUBJECT, REFERENCE)
"""Columns that are not keyword arguments of `track`; its argument `person` is the column `person_id`."""
OF_THE_BATCH = tuple(options_of(RunOptions))
"""Arguments of `track` without a column: the batch gives them for all."""
_SPELLED = {bool: "yes or no", int: "a whole number", float: "a number", str: "a text", Path: "a path"}
_SHOWN = 60  # characters of a cell that are repeated
Fault = Callable[[str, str], None]
"""Takes a problem and its remedy."""


@dataclass(frozen=True)
class Column:
    """A column: its name, and the type of its values as the command line converts it."""

    name: str
    type: Any

    @property
    def option(self) -> Option | None:
        """The option of `track` that it is, None of others."""
        return options_of(TrackRequest).get(self.name)

    @property
    def files(self) -> str:
        """The kind of files in [NAME=]PATH texts, "" for other cells."""
        return "" if self.option is None else self.option.files

    @property
    def kinds(self) -> tuple[Any, ...]:
        """The types that a value may have, None aside."""
        return _kinds(self.type)

    @property
    def several(self) -> bool:
        """Whether a cell has a list of texts."""
        return any(typing.get_origin(kind) in (list, tuple) for kind in self.kinds)

    @property
    def is_path(self) -> bool:
        """Whether a cell has one path, or a keyword in its place."""
        return Path in self.kinds or (self.option is not None and self.option.is_read)

    @property
    def taken(self) -> str:
        """The allowed values."""
        choices = [", ".join(map(str, typing.get_args(k))) for k in self.kinds if typing.get_origin(k) is Literal]
        return " or ".join([*(_SPELLED[k] for k in self.kinds if k in _SPELLED), *choices]) or "texts"


def _kinds(hint: Any) -> tuple[Any, ...]:
    if typing.get_origin(hint) is Annotated:
        return _kinds(typing.get_args(hint)[0])
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return tuple(kind for part in typing.get_args(hint) for kind in _kinds(part) if kind is not type(None))
    return (hint,)


@cache
def columns() -> Mapping[str, Column]:
    """All columns by name."""
    options = dict(flag_types(TrackRequest))
    own: dict[str, Any] = {
        NAME: str, CLIPS: Files, PERSON: str, FITS: bool, SUBJECT: SubjectOption, REFERENCE: Path | None,
        PERSON_ID: options.pop("person"),
    }  # fmt: skip
    types_by_name = own | {name: hint for name, hint in options.items() if name not in own}
    return {name: Column(name, hint) for name, hint in types_by_name.items() if name not in OF_THE_BATCH}


def column_of(written: str) -> Column | None:
    """The column of a name as it is written, with - or _, None where there is none."""
    return columns().get("_".join(written.strip().lower().lstrip("-").replace("-", " ").replace("_", " ").split()))


def unknown(written: str) -> tuple[str, str]:
    """Problem and remedy for an unknown column."""
    if written.strip().lower().lstrip("-") in OF_THE_BATCH:
        return f"{shown(written)} is not of a clip", "leave it out, and give it on the command line"
    near = nearest(written, columns(), "columns")
    return f"there is no column {shown(written)}", f"{near}; all options are in kinemode track --help"


def is_given(value: Any) -> bool:
    """Whether a cell has a value."""
    return not (value is None or (isinstance(value, str) and not value.strip()) or value in ([], (), {}))


def cell_value(column: Column, given: Any, folder: Path, fault: Fault) -> Any:
    """The value of a cell as JSON has it, paths made absolute from `folder`; None, and a fault, for a cell
    that cannot be read. Files that do not exist are faults, too."""
    texts = _texts(column, given, folder, fault)
    if texts is None:
        return None
    try:
        value = _converted(column.type, tuple(texts))
    except (cyclopts.CycloptsError, ValueError, OverflowError):
        fault(f"{shown(given, _SHOWN)} is not taken", f"give {column.taken}")
        return None
    if isinstance(value, float) and not math.isfinite(value):
        fault(f"{shown(given, _SHOWN)} is not a number", f"give {column.taken}")
        return None
    if column.files:
        return [_named_file(text, folder, column.files, fault) for text in value]
    if column.is_path and not (column.option is not None and is_word(column.option, texts[0])):
        return existing(texts[0], folder, fault)
    return list(value) if column.several else str(value) if isinstance(value, Path) else value


@cache  # most cells of a column are the same
def _converted(hint: Any, texts: tuple[str, ...]) -> Any:
    return cyclopts.convert(hint, texts)


def existing(text: str, folder: Path, fault: Fault, what: str = "file") -> str:
    """An absolute path; a fault where nothing is there."""
    path = os.path.abspath(folder / text)
    if not os.path.exists(path):
        relative = "" if os.path.isabs(text) else f"searched for in {folder}"
        fault(f"there is no such {what}: {shown(text, _SHOWN)}", relative)
    return path


def _named_file(text: str, folder: Path, what: str, fault: Fault) -> str:
    name, separator, path = text.partition("=")
    if not separator or os.path.exists(folder / text):  # a file may have = in its name
        return existing(text, folder, fault, what)
    if not name or not path:
        fault(f"{shown(text, _SHOWN)} is not a {what}", "write NAME=PATH or PATH")
        return text
    return f"{name}={existing(path, folder, fault, what)}"


def _texts(column: Column, given: Any, folder: Path, fault: Fault) -> list[str] | None:
    """A cell as arguments of a command line."""
    if isinstance(given, (str, Path)):
        text = str(given).strip()
        if not column.several or isinstance(given, Path) or os.path.exists(folder / text):
            return [text]  # a file's name may have spaces
        return _words(text, fault)
    if isinstance(given, (bool, int, float)):
        return [str(given)]
    if column.several and isinstance(given, (Mapping, list, tuple)):
        parts = list(given.values()) if isinstance(given, Mapping) else list(given)
        if not all(isinstance(part, (str, Path, int, float)) for part in parts):
            fault(f"{shown(given, _SHOWN)} is not taken", "give a list of texts")
            return None
        return (
            [f"{name}={part}" for name, part in given.items()] if isinstance(given, Mapping) else list(map(str, parts))
        )
    fault(f"is of type {type(given).__name__}", f"give {column.taken}")
    return None


def _words(text: str, fault: Fault) -> list[str] | None:
    """A text split at spaces as a shell does, but that a backslash is one: paths of Windows have them."""
    lexer = shlex.shlex(text, posix=True, punctuation_chars=False)
    lexer.whitespace_split, lexer.commenters, lexer.escape = True, "", ""
    try:
        return list(lexer)
    except ValueError:
        fault(f"unclosed quotation mark: {shown(text, _SHOWN)}", 'write "names with spaces" in quotation marks')
        return None
