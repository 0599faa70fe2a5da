"""Where a result goes: checked before an hour of work, not after."""

from __future__ import annotations

import os
import shlex
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from estimator.runs.run_store import TemporaryFolder
from humanoid.support.compiled_cache import cache_roots
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class RunTarget:
    """The place of a run, and the treatment of an existing one.

    resume: it is continued. overwrite: it is replaced.
    """

    path: Path
    resume: bool = False
    overwrite: bool = False

    @property
    def resumed(self) -> bool:
        """Whether there is a run to resume."""
        return self.resume and self.path.exists()

    def check(self) -> None:
        """Raise InputError where the file cannot be written, or is there without `resume` or `overwrite`."""
        check_folder(self.path)
        check_absent([self.path], self.resume, self.overwrite, "--resume continues it, --overwrite replaces it")


def run_path(out: str | os.PathLike[str] | None, name: str = "track.run") -> tuple[Path, TemporaryFolder | None]:
    """Where a run is written; where no file is named, a temporary folder that it is in, which goes with its last
    `Run`."""
    if out is not None:
        return Path(out), None
    temporary = TemporaryFolder()
    return temporary.path / name, temporary


def check_absent(paths: list[Path], resume: bool, overwrite: bool, remedy: str) -> None:
    """Raise InputError, with the remedy, where one of the files is there without `resume` or `overwrite`."""
    present = next((path for path in paths if path.exists()), None)
    if resume and overwrite:
        raise InputError(present or paths[0], "cannot be resumed and overwritten", remedy="choose one")
    if present is not None and not (resume or overwrite):
        raise InputError(present, "exists already", remedy=remedy)


def check_new(path: Path) -> None:
    """Raise InputError where a file cannot be put, or is there: it is never replaced."""
    check_folder(path)
    check_absent([path], False, False, "nothing is overwritten: name another file, or move this one away")


def check_folder(path: Path) -> None:
    """Raise InputError where a file cannot be put: its folder is missing, or it is a folder itself."""
    if path.is_dir():
        raise InputError(path, "is a folder, a file is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(path, "its folder does not exist", remedy=f"mkdir -p {shlex.quote(str(path.parent))}")


def made_folder(folder: Path) -> Path:
    """The folder, made if it is not there; raises InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be made: {error.strerror}", remedy="name a folder of your own") from None
    return folder


def cache_folder() -> Path:
    """The user's cache folder, made if it is not there; a temporary folder where none can be written to."""
    return next(filter(_takes_files, cache_roots()), None) or Path(tempfile.mkdtemp(prefix="kinemode-"))


def _takes_files(folder: Path) -> bool:
    """Whether files can be written to a folder, which is made if it is not there."""
    with suppress(InputError):
        return os.access(made_folder(folder), os.W_OK)
    return False
