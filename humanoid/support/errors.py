"""The one exception a user's input can raise, and names that were meant where one is unknown."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

LONGEST = 500  # characters of a message: longer ones are not read, and may be a damaged file's content
_LONGEST_QUOTE = 60  # of a name or value, where the message is too long
_QUOTED = re.compile(r"'[^']{61,}'" + r'|"[^"]{61,}"')
_GAP = " ... "


class InputError(ValueError):
    """Something the user gave cannot be used.

    Its message is one line of at most 500 characters: where it would be longer, the middle of long names, values and
    lists is left out. The attributes have everything.

    Attributes
    ----------
    source:
        The file (or option) that is wrong.
    place:
        Where in it: an element, a line, a frame; may be empty.
    problem:
        What is wrong, one clause.
    remedy:
        What to do about it, naming the valid choices where there are any.
    """

    def __init__(self, source: str | Path, problem: str, *, place: str = "", remedy: str = "") -> None:
        self.source = str(source)
        self.place = place
        self.problem = problem
        self.remedy = remedy
        super().__init__(_message(*_fitting([_one_line(t) for t in (self.source, place, problem, remedy)])))

    def __reduce__(self) -> tuple[object, ...]:
        # keyword-only arguments do not survive the default exception pickling between processes
        return (_rebuild, (self.source, self.problem, self.place, self.remedy))


def _rebuild(source: str, problem: str, place: str, remedy: str) -> InputError:
    return InputError(source, problem, place=place, remedy=remedy)


def first_of(things: Sequence[object], most: int) -> str:
    """A list for a message: the first things of it, and dots where there are more."""
    return ", ".join(map(str, things[:most])) + (", ..." if len(things) > most else "")


def shown(value: Any, most: int = _LONGEST_QUOTE) -> str:
    """A value as a message quotes it: its repr, shortened in the middle, for any value."""
    try:
        return shortened(_one_line(repr(value)), most)
    except (ValueError, RecursionError):  # a whole number of over 4300 digits has no repr
        return "a number of thousands of digits" if isinstance(value, int) else f"a {type(value).__name__}"


def misplaced(name: str, value: Any, taken: str) -> InputError:
    """The error of an argument that is of a kind which is not taken: what it is, and what may be given."""
    kind = type(value)
    label = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__.partition('.')[0]}.{kind.__name__}"
    quoted = f" ({shown(value, 40)})" if isinstance(value, (str, int, float)) else ""
    received = "None" if value is None else f"of type {label}{quoted}"
    return InputError(name, f"cannot be {received}", remedy=f"give {taken}")


def _message(source: str, place: str, problem: str, remedy: str) -> str:
    where = f"{source}: {place}" if place else source
    return f"{where}: {problem}" + (f" ({remedy})" if remedy else "")


def _one_line(text: str) -> str:
    """Text with control characters written out: line ends, escapes, marks that change the direction of writing."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _fitting(parts: list[str]) -> list[str]:
    """The parts of a message, shortened where they are too long together: first what they quote, then the longest."""
    if len(_message(*parts)) <= LONGEST:
        return parts
    parts = [_QUOTED.sub(lambda quote: shortened(quote[0], _LONGEST_QUOTE), part) for part in parts]
    lengths = sorted(map(len, parts))
    room = LONGEST - (len(_message(*parts)) - sum(lengths))
    for rank, length in enumerate(lengths):  # short parts stay unchanged, long ones share what is left
        share = room // (len(parts) - rank)
        if length > share:
            return [shortened(part, share) for part in parts]
        room -= length
    return parts


def shortened(text: str, most: int = LONGEST) -> str:
    """A text of at most `most` characters, its middle left out."""
    if len(text) <= most:
        return text
    kept = most - len(_GAP)
    return text[: kept - kept // 2] + _GAP + text[len(text) - kept // 2 :]


_CLOSE = 0.5  # likeness from which a name counts as near
_CLOSE_WORD = 0.75
_PART = 3  # letters that are searched for inside names
_LISTED = 40


def near_names(name: str, valid: Iterable[str], most: int = 3, close: float = _CLOSE) -> list[str]:
    """The valid names that are nearest: those that contain the name, the shortest first, then those that are alike, the
    nearest first, then those of which a word is alike; close: likeness that is needed, from 0 to 1."""
    names, part = sorted(set(valid)), name.strip().lower()
    within = sorted((n for n in names if len(part) >= _PART and part in n.lower()), key=len)
    alike = difflib.get_close_matches(name, names, n=most, cutoff=close)
    words = {word for n in names for word in n.lower().split("_")}
    meant = set(difflib.get_close_matches(part, words, n=1, cutoff=_CLOSE_WORD))
    by_word = [n for n in names if meant & set(n.lower().split("_"))]
    return list(dict.fromkeys([*within, *alike, *by_word]))[:most]


def nearest(name: str, valid: Iterable[str], noun: str) -> str:
    """A remedy naming the valid names, the nearest ones first."""
    names = sorted(set(valid))
    close = near_names(name, names)
    if close:
        return "did you mean " + " or ".join(close) + "?"
    return f"valid {noun}: " + (first_of(names, _LISTED) or "none")
