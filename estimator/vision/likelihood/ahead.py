"""The next frame's cues are computed while this one is searched: OpenCV leaves the interpreter free meanwhile."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

from estimator.data.image_cues import ImageCues
from estimator.vision.likelihood.reader import CueReader


class ReadAhead:
    """A cue reader with one thread of its own, which alone touches the files; the cues are the reader's own."""

    def __init__(self, reader: CueReader) -> None:
        self._reader = reader
        self._thread = ThreadPoolExecutor(1, "cues")
        self._next: tuple[int, Future[tuple[ImageCues, ...]]] | None = None
        self.notes = reader.notes

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """See `CueReader.at`; afterwards the next frame's are on their way."""
        waiting = self._next
        expected = waiting is not None and waiting[0] == index
        reading = waiting[1] if waiting is not None and expected else self._thread.submit(self._reader.at, index)
        cues = reading.result()
        self._next = (
            index + 1,
            self._thread.submit(self._reader.at, index + 1),
        )  # the error past the end is not asked for
        return cues

    def close(self) -> None:
        """Wait for the thread and let go of the files."""
        self._thread.shutdown(cancel_futures=True)
        self._reader.close()
