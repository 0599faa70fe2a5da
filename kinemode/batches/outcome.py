"""What became of a clip of a batch, as it is kept in its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from humanoid.support.atomic import replacing
from kinemode.batches.digests import FileStamp

FILE = "outcome.json"


@dataclass(frozen=True)
class TrackedRun:
    """A run of a clip, of which there are several where everybody is tracked; paths relative to the batch's folder, ""
    of what there is not. The figures are those of `viz.batch.entry.BatchEntry`."""

    name: str
    run: str
    report: str = ""
    thumbnail: str = ""
    exports: Mapping[str, str] = field(default_factory=dict)
    subject: str = ""
    tracker: str = ""
    frames: int = 0
    hard: int = 0
    unobserved: int = 0
    doubtful: float | None = None
    error: float | None = None
    message: str = ""


@dataclass(frozen=True)
class ClipOutcome:
    """What became of a clip.

    status: done or failed, see `viz.batch.entry`. message: why it failed. runs: of one that was tracked. options,
    inputs: what it depends on, see `kinemode.batches.digests`; reference: what it was compared with. seconds: of
    wall-clock time; processor_seconds: of processor time, programs that it started included. notes: what was assumed.
    """

    name: str
    status: str
    message: str = ""
    runs: tuple[TrackedRun, ...] = ()
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
            runs = tuple(TrackedRun(**run) for run in stored.pop("runs"))
            stamps = {
                which: {name: FileStamp(*stamp) for name, stamp in stored.pop(which).items()}
                for which in ("inputs", "reference")
            }
            return ClipOutcome(**{**stored, **stamps, "runs": runs, "notes": tuple(stored["notes"])})
        return None
