"""Names that were meant where one is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_CLOSE = 0.5  # likeness from which a name counts as near
_PART = 3  # letters that are looked for inside of names
_LISTED = 40


def near_names(name: str, valid: Iterable[str], most: int = 3) -> list[str]:
    """The valid names that are nearest: those that contain the name, then those that are alike, the nearest first."""
    names, part = sorted(set(valid)), name.strip().lower()
    within = [n for n in names if len(part) >= _PART and part in n.lower()]
    alike = difflib.get_close_matches(name, names, n=most, cutoff=_CLOSE)
    return list(dict.fromkeys([*within, *alike]))[:most]


def nearest(name: str, valid: Iterable[str], noun: str) -> str:
    """A remedy naming the valid names, the nearest ones first."""
    names = sorted(set(valid))
    close = near_names(name, names)
    if close:
        return "did you mean " + " or ".join(close) + "?"
    return f"valid {noun}: " + (", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "") or "none")
