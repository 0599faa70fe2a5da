"""The next frame's cues are computed in another process: in a thread of this one they would wait for the searches and
the searches for them, wherever either is not in compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from estimator.imaging.camera import Camera
from estimator.imaging.cues import CueReader, CueSettings, ImageCues
from estimator.processes.board import Board, BoardReader
from estimator.processes.companion import Companion
from humanoid.errors import InputError


class CueRecipe(NamedTuple):
    """What a `CueReader` is made from; see there."""

    clips: Sequence[Path]
    cameras: Sequence[Camera]
    settings: CueSettings
    masks: Sequence[Path | None] | None = None
    plates: Sequence[Path | None] | None = None

    def reader(self) -> CueReader:
        """The reader."""
        return CueReader(self.clips, self.cameras, self.settings, masks=self.masks, plates=self.plates)


class ReadAheadProcess:
    """A cue reader in a process of its own, which alone touches the files; the cues are the reader's to the last bit.

    Raises
    ------
    InputError: what `CueReader` raises.
    """

    def __init__(self, recipe: CueRecipe) -> None:
        self._companion = Companion(_read, recipe)
        self._board = BoardReader()
        self._next: int | None = None  # the frame that was asked for and not fetched
        try:
            self.notes: tuple[str, ...] = self._answer()
        except BaseException:
            self.close()
            raise

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """See `CueReader.at`; afterwards the next frame's are on their way."""
        if self._next != index:
            if self._next is not None:
                self._companion.receive()
            self._companion.send(index)
        self._next = None
        cues: tuple[ImageCues, ...] = self._board.read(self._answer(), copied=True)
        self._companion.send(index + 1)
        self._next = index + 1
        return cues

    def close(self) -> None:
        """End the process and let go of the files."""
        self._companion.close()
        self._board.close()

    def _answer(self):  # type: ignore[no-untyped-def]
        """What was asked for; an error past the end is raised only where somebody asks."""
        answer = self._companion.receive()
        if isinstance(answer, InputError):
            raise answer
        return answer


def _read(connection: Connection, recipe: CueRecipe) -> None:
    """The side of the process: notes first, then the cues of one frame after the other."""
    import os; os.nice(19)
    try:
        reader = recipe.reader()
    except InputError as error:
        connection.send(error)
        return
    connection.send(reader.notes)
    with Board() as board:
        try:
            while True:
                index = connection.recv()
                try:
                    connection.send(board.post(reader.at(index)))
                except InputError as error:
                    connection.send(error)
        finally:
            reader.close()
