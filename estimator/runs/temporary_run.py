"""Runs without an output file: a file among the temporary ones, which goes with the last `Run` that looks at it."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from pathlib import Path
from typing import ClassVar


class TemporaryFolder:
    """A folder that is removed when this object is gone, at the latest when the process ends."""

    _known: ClassVar[weakref.WeakValueDictionary[Path, TemporaryFolder]] = weakref.WeakValueDictionary()

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="kinemode-")).resolve()
        self._known[self.path] = self
        weakref.finalize(self, _remove, self.path, os.getpid())

    @classmethod
    def of(cls, file: Path) -> TemporaryFolder | None:
        """The one that a file lies in, if it is one of this process."""
        return cls._known.get(file.resolve().parent)


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # not in a forked child, whose parent continues it
        shutil.rmtree(folder, ignore_errors=True)
