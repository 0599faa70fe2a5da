"""A worker's task and its answer: small and of plain values, as they are sent between processes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError
from humanoid.support.files import unwritable
from kinemode.batches.manifest import BatchRow, fitting_name
from kinemode.batches.outcome import ClipOutcome, input_files, options_digest, unchanged
from kinemode.option import options_of
from kinemode.request import BY_INDEX, FitRequest
from kinemode.target import made_folder
from viz.report.thumbnail import DONE

TOKEN = ".batch"
"""The file in the folder of a batch whose content shows a worker that it has the same folder as the leader."""
LOCK = ".lock"
"""The file that marks a folder as one of a batch, locked by the batch working in it."""
_LIBRARIES = ("numpy", "pin")
_OF_THE_FIT = (
    "fit",
    "height",
    "static",
    "markers",
)
"""Options that a subject that is fitted has in it."""


@dataclass(frozen=True)
class BatchTask:
    """A clip to be tracked, or a person to be fitted from it.

    row: the clip. root: folder of the batch, absolute. token: the content of its file `TOKEN`. fits: whether the person
    is to be fitted. subject: the person's URDF, once that is fitted, "" of a row that takes its own. exports: formats.
    report: whether one is written. versions: those of the leader, by library.
    """

    row: BatchRow
    root: Path
    token: str
    fits: bool = False
    subject: str = ""
    exports: tuple[str, ...] = ()
    report: bool = False
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def clip_folder(self) -> Path:
        """Where everything about the clip is kept."""
        return self.root / "clips" / self.row.name

    @property
    def folder(self) -> Path:
        """Where the outcome is kept."""
        return self.subject_file.parent if self.fits else self.clip_folder

    @property
    def subject_file(self) -> Path:
        """The person's URDF."""
        name = fitting_name(self.row.person)
        if name != self.row.person:  # two persons must not share a folder
            name = f"{name}-{hashlib.sha256(self.row.person.encode('utf-8', 'surrogateescape')).hexdigest()[:8]}"
        return self.root / "people" / name / f"{name}.urdf"

    @property
    def options(self) -> dict[str, Any]:
        """As `track` takes them, or `fit`."""
        given = dict(self.row.options)
        if self.fits:
            return {n: v for n, v in given.items() if n in options_of(FitRequest) and (n, v) != ("start", BY_INDEX)}
        return {n: v for n, v in given.items() if n not in _OF_THE_FIT} if self.subject else given

    @property
    def digest(self) -> str:
        """The digest of the request, files by name alone."""
        what = self.subject or self.row.subject
        return options_digest(f"fit {what}" if self.fits else what, self.row.clips, self.options)

    @property
    def inputs(self) -> list[Path]:
        """The files that it depends on."""
        own = "" if self.subject else self.row.subject
        return input_files(own, self.row.clips, self.options)

    @property
    def reference(self) -> list[Path]:
        """The files that the run is compared with."""
        return input_files(self.row.reference)

    def is_done(self, outcome: ClipOutcome | None) -> bool:
        """Whether an outcome that was kept is that of this task: of the same options and unchanged inputs, with all
        additional requests."""
        if outcome is None or outcome.status != DONE or outcome.options != self.digest:
            return False
        if self.fits:
            return self.subject_file.is_file() and unchanged(self.inputs, outcome.inputs)
        there = all(self._has(run.run, *run.exports.values()) for run in outcome.runs)
        asked = all(set(self.exports) <= run.exports.keys() and (run.report or not self.report) for run in outcome.runs)
        compared = unchanged(self.reference, outcome.reference)
        return there and asked and compared and unchanged(self.inputs, outcome.inputs)

    def _has(self, *files: str) -> bool:
        return all((self.root / file).is_file() for file in files)


@dataclass(frozen=True)
class TaskAnswer:
    """The outcome of a task. subject: the URDF that was fitted. files: by their paths relative to the batch's folder,
    where the worker does not see that."""

    outcome: ClipOutcome
    subject: str = ""
    files: Mapping[str, bytes] = field(default_factory=dict)


def own_folder(folder: Path) -> Path:
    """A folder of the batch, made if it is not there. Raises InputError where it has files of others, which are not to
    be touched."""
    others = folder.is_dir() and not (folder / LOCK).exists() and any(folder.iterdir())
    if others:
        raise InputError(folder, "has files that no batch has made", remedy="name another folder for the batch")
    made_folder(folder)
    try:
        (folder / LOCK).touch()
    except OSError as error:
        raise unwritable(folder, error) from None
    return folder


def versions() -> dict[str, str]:
    """Versions of the packages on which results depend."""
    from kinemode import __version__

    return {"kinemode": __version__, **{name: metadata.version(name) for name in _LIBRARIES}}


def check_versions(leaders: Mapping[str, str], workers: Mapping[str, str], where: str) -> None:
    """Raise InputError unless a worker has the leader's versions; where: its address."""
    for name, version in leaders.items():
        if workers.get(name) != version:
            problem = f"has {name} {workers.get(name, 'in no version')}, and the leader has {version}"
            raise InputError(f"worker {where}", problem, remedy="install the same versions everywhere")
