"""What is wrong with a manifest: all of it at once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from humanoid.support.errors import InputError


class ManifestError(InputError):
    """A manifest that cannot be used: nothing of it was begun.

    Its message is a line for the manifest and one for each fault, of at most 500 characters each.

    Attributes
    ----------
    faults:
        Everything that is wrong, in the order of the manifest; `place` is the row, and the column where it is one.
    """

    def __init__(self, source: str | Path, faults: Sequence[InputError]) -> None:
        self.faults = tuple(faults)
        count = f"{len(self.faults)} fault{'' if len(self.faults) == 1 else 's'}"
        super().__init__(source, f"{count}, nothing was begun")
        self.args = ("\n".join([str(self), *(f"  {_without_source(fault)}" for fault in self.faults)]),)

    def __reduce__(self) -> tuple[object, ...]:
        return ManifestError, (self.source, self.faults)


def _without_source(fault: InputError) -> str:
    """The message of a fault below a line that names the manifest."""
    if not fault.place:
        return str(InputError("the file", fault.problem, remedy=fault.remedy))
    return str(InputError(fault.place, fault.problem, remedy=fault.remedy))


class FaultList:
    """The faults of one manifest, collected while it is read."""

    def __init__(self, source: str) -> None:
        self.source = source
        self._faults: dict[tuple[str, str], InputError] = {}

    def add(self, place: str, problem: str, remedy: str = "", column: str = "") -> None:
        """Note a fault of a row, or of a column in it."""
        where = ", ".join(part for part in (place, f"column {column}" if column else "") if part)
        fault = InputError(self.source, problem, place=where, remedy=remedy)
        self._faults.setdefault((where, problem), fault)  # what holds for all rows is wrong once

    def with_last(self, place: str, problem: str, remedy: str) -> ManifestError:
        """The error of all faults and of one that nothing can be read after."""
        self.add(place, problem, remedy)
        return self.error()

    def error(self) -> ManifestError:
        """The error of all faults, by row."""
        return ManifestError(self.source, sorted(self._faults.values(), key=_row_number))

    def check(self) -> None:
        """Raise ManifestError where there is any fault."""
        if self:
            raise self.error()

    def __bool__(self) -> bool:
        return bool(self._faults)


def _row_number(fault: InputError) -> int:
    """Of the row that a fault is in, 0 where it is of all."""
    row = re.match(r"row (\d+)", fault.place)
    return int(row[1]) if row else 0
