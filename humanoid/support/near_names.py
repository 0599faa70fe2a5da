"""Names that were meant where one is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from humanoid.support.errors import first_of

_CLOSE = 0.5  # likeness from which a name counts as near
_CLOSE_WORD = 0.75
_PART = 3  # letters that are looked for inside of names
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
