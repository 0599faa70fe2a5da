"""The outcome of a batch's clip, as stored in its folder, with digests of its dependencies."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from humanoid.support.files import content_digest, replacing
from viz.report.thumbnail import BatchEntry


class FileStamp(NamedTuple):
    """A file as it was: size [bytes], when it was changed [ns], SHA-256 of its bytes."""

    size: int
    changed: int
    digest: str


def options_digest(subject: str, clips: Sequence[str], options: Mapping[str, Any]) -> str:
    """The digest of a row's values, with file names but not their content."""
    given = json.dumps([subject, list(clips), dict(options)], sort_keys=True)
    return hashlib.sha256(given.encode("utf-8", "surrogateescape")).hexdigest()


def input_files(*given: Any) -> list[Path]:
    """The files that texts name, in lists and mappings too, alone or as NAME=PATH; of a folder all that are in it."""
    return sorted({file for text in _texts(given) for file in _files(text)})


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from _texts(list(value.values()))
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _texts(part)


def _files(text: str) -> Iterator[Path]:
    path = text if os.path.exists(text) else text.partition("=")[2]
    if not os.path.isabs(path):  # a value like any other: paths of rows are absolute
        return
    if os.path.isfile(path):
        yield Path(path)
    for folder, _, names in os.walk(path):
        yield from (Path(folder, name) for name in names)


def stamped(files: Sequence[Path]) -> dict[str, FileStamp]:
    """Every file's stamp; one that is not there has none."""
    return {str(file): stamp for file in files if (stamp := _stamp(file)) is not None}


def _stamp(file: Path) -> FileStamp | None:
    try:
        with file.open("rb") as content:
            state = os.fstat(content.fileno())
            return FileStamp(state.st_size, state.st_mtime_ns, content_digest(content))
    except OSError:
        return None


def unchanged(files: Sequence[Path], stamps: Mapping[str, FileStamp]) -> bool:
    """Whether files are unchanged; only those with another time or size are read."""
    return {str(file) for file in files} == set(stamps) and all(_same(file, stamps[str(file)]) for file in files)


def _same(file: Path, stamp: FileStamp) -> bool:
    try:
        state = file.stat()
    except OSError:
        return False
    if (state.st_size, state.st_mtime_ns) == stamp[:2]:
        return True
    now = _stamp(file) if state.st_size == stamp.size else None
    return now is not None and now.digest == stamp.digest


FILE = "outcome.json"


@dataclass(frozen=True)
class ClipOutcome:
    """The outcome of a clip.

    status: done or failed, see `viz.report.thumbnail`. message: why it failed. runs: of one that was tracked, several
    where everybody is; files relative to the folder of the batch. options, inputs: what it depends on, see
    `input_files`; reference: what it was compared with. seconds: of wall-clock time; processor_seconds: of processor
    time, programs that it started included. notes: what was assumed.
    """

    name: str
    status: str
    message: str = ""
    runs: tuple[BatchEntry, ...] = ()
    options: str = ""
    inputs: Mapping[str, FileStamp] = field(default_factory=dict)
    reference: Mapping[str, FileStamp] = field(default_factory=dict)
    seconds: float = 0.0
    processor_seconds: float = 0.0
    notes: tuple[str, ...] = ()

    def written(self, folder: Path) -> None:
        """Keep it in the clip's folder; raises InputError where that fails."""
        with replacing(folder / FILE) as temporary:
            temporary.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8", errors="surrogateescape")

    @staticmethod
    def kept(folder: Path) -> ClipOutcome | None:
        """The one that a clip's folder has; None where there is none, or it cannot be read."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            stored: dict[str, Any] = json.loads((folder / FILE).read_text(encoding="utf-8", errors="surrogateescape"))
            runs = tuple(BatchEntry(**run) for run in stored.pop("runs"))
            stamps = {
                which: {name: FileStamp(*stamp) for name, stamp in stored.pop(which).items()}
                for which in ("inputs", "reference")
            }
            return ClipOutcome(**{**stored, **stamps, "runs": runs, "notes": tuple(stored["notes"])})
        return None
