"""The one exception a user's input can raise."""

from __future__ import annotations

from pathlib import Path


class InputError(ValueError):
    """Something the user gave cannot be used.

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
        where = f"{self.source}: {place}" if place else self.source
        super().__init__(f"{where}: {problem}" + (f" ({remedy})" if remedy else ""))

    def __reduce__(self) -> tuple[object, ...]:
        # keyword-only arguments do not survive the default exception pickling between processes
        return (_rebuild, (self.source, self.problem, self.place, self.remedy))


def _rebuild(source: str, problem: str, place: str, remedy: str) -> InputError:
    return InputError(source, problem, place=place, remedy=remedy)
