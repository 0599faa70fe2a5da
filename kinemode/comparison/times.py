"""How long each tracker of a comparison took, kept beside its run so that a resumed comparison still knows."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from humanoid.support.atomic import replacing
from humanoid.support.errors import InputError
from kinemode.progress import Progress, Reporter


@dataclass(frozen=True)
class TrackTime:
    """What tracking one clip took on the clock [s].

    frames, seconds: frames that were timed and what they took together, over all sessions; the first frame of a session
    is left out, because files, fit and start come before it. smoothing: what followed the last frame.
    """

    frames: int = 0
    seconds: float = 0.0
    smoothing: float = 0.0

    def rate(self, count: int) -> float:
        """Frames per second of tracking and smoothing `count` frames; NaN where too few were timed."""
        if self.frames == 0 or count == 0:
            return float("nan")
        return 1.0 / (self.seconds / self.frames + self.smoothing / count)


class TimeFile:
    """The times of several trackers in a JSON file, written again whenever a stage of one ends or is interrupted.

    Raises
    ------
    InputError: the file is there and does not hold times of trackers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._times = _read(path) if path.exists() else {}
        self._live: set[str] = set()  # trackers with frames in this session

    def of(self, tracker: str) -> TrackTime:
        """The times of a tracker, all zero where it has not run."""
        return self._times.get(tracker, TrackTime())

    def clear(self, tracker: str) -> None:
        """Forget a tracker whose run starts again."""
        self._times.pop(tracker, None)

    def clocked(self, tracker: str, reporter: Reporter) -> Reporter:
        """A progress reporter that names the tracker, passes on to `reporter`, and keeps the times of its stages."""

        @contextmanager
        def reported(stage: str) -> Iterator[Progress]:
            marks: list[float] = []
            start = time.perf_counter()
            with reporter(f"{tracker}: {stage}") as progress:

                def marked(done: int, total: int) -> None:
                    marks.append(time.perf_counter())
                    progress(done, total)

                try:
                    yield marked
                finally:
                    self._add(tracker, stage, start, marks)

        return reported

    def _add(self, tracker: str, stage: str, start: float, marks: list[float]) -> None:
        known = self.of(tracker)
        if stage == "tracking" and marks:
            self._live.add(tracker)
        if stage == "smoothing" and (tracker in self._live or known.smoothing == 0.0):  # else a finished run's, again
            self._times[tracker] = replace(known, smoothing=time.perf_counter() - start)
        elif stage == "tracking" and len(marks) > 1:
            frames, seconds = known.frames + len(marks) - 1, known.seconds + marks[-1] - marks[0]
            self._times[tracker] = replace(known, frames=frames, seconds=seconds)
        with replacing(self.path) as temporary:
            temporary.write_text(json.dumps({name: asdict(t) for name, t in self._times.items()}, indent=1) + "\n")


def _read(path: Path) -> dict[str, TrackTime]:
    try:
        return {
            str(name): TrackTime(int(t["frames"]), float(t["seconds"]), float(t["smoothing"]))
            for name, t in json.loads(path.read_text(encoding="utf-8")).items()
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"holds no times of trackers: {error}", remedy="remove it") from None
