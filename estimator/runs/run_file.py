"""Run files, the writing side: one SQLite file, written as the run goes (see `run_store` for the layout)."""

from __future__ import annotations

import datetime
import os
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import numpy as np

from estimator.data.formats.packing import pack, unpack
from estimator.data.observation import Observation
from estimator.runs import run_store
from estimator.runs.run_arrays import frame_arrays, smoothed_parts
from estimator.runs.run_header import RunHeader, with_findings
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing import Smoothed
from humanoid.support.errors import InputError
from humanoid.support.files import replacing


class RunWriter:
    """Appends frames to a run file; a context manager that closes the file, complete or not."""

    def __init__(self, path: Path, connection: sqlite3.Connection, position: int) -> None:
        self.path = path
        self._connection = connection
        self._position = position

    @property
    def frame_count(self) -> int:
        """Frames in the file."""
        return self._position

    @classmethod
    def create(cls, path: str | Path, header: RunHeader, overwrite: bool = False) -> RunWriter:
        """Start a run; the file appears with its header in it or not at all.

        Raises
        ------
        InputError: there is such a file and `overwrite` is not set, or it is not writable.
        """
        path = Path(path)
        if path.exists() and not overwrite:
            raise InputError(path, "exists already", remedy="--resume continues it, --overwrite replaces it")
        with replacing(path) as temporary:
            run_store.create_store(temporary, header.to_json(), path)
            for suffix in ("-wal", "-shm"):  # a killed run's log must not be read as the new run's
                with suppress(FileNotFoundError):
                    os.unlink(f"{path}{suffix}")
        return cls(path, run_store.open_writing(path), 0)

    @classmethod
    def resume(cls, path: str | Path, header: RunHeader) -> tuple[RunWriter, dict[str, np.ndarray] | None, int]:
        """Go on with a run: the writer, the state after its last frame (None before the first), the next position.

        Raises
        ------
        InputError: no such run, or one made from something else; where a clip lies may differ.
        """
        path = Path(path)
        different = Run.open(path).header.differences(header)
        if different:
            raise InputError(
                path, f"was made from other input: {'; '.join(different)}", remedy="--overwrite starts again"
            )
        connection = run_store.open_writing(path)
        with run_store.translated(path):
            row = connection.execute("SELECT next, data FROM state").fetchone()
            (count,) = connection.execute("SELECT count(*) FROM frame").fetchone()
        try:
            state = unpack(row[1]) if row else None
            if count != (row[0] if row else 0):
                raise ValueError(f"it is not of the last of {count} frames")
        except ValueError as error:
            connection.close()
            raise InputError(path, f"is damaged: {error}", place="state", remedy="--overwrite starts again") from None
        return cls(path, connection, count), state, count

    def put_observations(self, observations: Sequence[Observation]) -> None:
        """Store the keypoints of every frame; in a resumed run they have to be those it began with.

        Raises
        ------
        InputError: naming the first frame whose keypoints differ.
        """
        rows = [
            (
                i,
                pack(
                    {
                        "pixels": o.pixels,
                        "confidence": o.confidence,
                        "given": np.array(o.given),
                        "jitter": np.array(o.jitter),
                        "noise": np.array(o.noise),
                        **_knowledge_of(o),
                    }
                ),
            )
            for i, o in enumerate(observations)
        ]
        with run_store.translated(self.path, has_frames=True):
            stored = self._connection.execute("SELECT position, data FROM observation ORDER BY position").fetchall()
            if not stored:
                self._connection.execute("BEGIN IMMEDIATE")
                self._connection.executemany("INSERT INTO observation VALUES (?, ?)", rows)
                self._connection.execute("COMMIT")
                return
        if stored != rows:
            first = next(
                (i for i, (a, b) in enumerate(zip(stored, rows, strict=False)) if a != b), min(len(stored), len(rows))
            )
            remedy = "--overwrite starts again"
            raise InputError(self.path, "was made from other keypoints", place=f"frame {first}", remedy=remedy)

    def append(self, result: FrameResult, state: Mapping[str, np.ndarray]) -> None:
        """Store a frame and, in the same transaction, the tracker's exact state after it in place of the last one."""
        data, exact = pack(frame_arrays(result)), pack(state)
        execute = self._connection.execute
        with run_store.translated(self.path, has_frames=True):
            execute("BEGIN IMMEDIATE")
            try:
                execute("INSERT INTO frame VALUES (?, ?)", (self._position, data))
                execute("INSERT OR REPLACE INTO state VALUES (0, ?, ?)", (self._position + 1, exact))
                execute("COMMIT")
            except BaseException:  # Ctrl-C lands anywhere
                if self._connection.in_transaction:
                    execute("ROLLBACK")
                raise
        self._position += 1

    def settle(self) -> int:
        """After an interruption, which lands anywhere: remove what is half stored; returns the number of frames in the
        file."""
        with run_store.translated(self.path, has_frames=True):
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            (self._position,) = self._connection.execute("SELECT count(*) FROM frame").fetchone()
        return self._position

    def put_header(self, header: RunHeader) -> None:
        """Replace what the run was made from: how long a live one is, is known when it is over."""
        execute = self._connection.execute
        with run_store.translated(self.path):
            execute("BEGIN IMMEDIATE")
            execute("UPDATE header SET json = ?", (header.to_json(),))
            execute("COMMIT")

    def put_smoothed(self, smoothed: Smoothed) -> None:
        """Store the smoothed trajectory of all frames, in place of any other."""
        execute = self._connection.execute
        with run_store.translated(self.path, has_frames=True):
            execute("BEGIN IMMEDIATE")
            execute("DELETE FROM smoothed")
            self._connection.executemany(
                "INSERT INTO smoothed VALUES (?)", ((pack(arrays),) for arrays in smoothed_parts(smoothed))
            )
            execute("COMMIT")

    def put_findings(self, findings: Sequence[str], contradicted: Sequence[int] = ()) -> None:
        """Store the run's findings, in place of any others; its notes have them too. contradicted: rows of the frames
        that are "hard" because of them, whatever the tracker's status."""
        execute = self._connection.execute
        with run_store.translated(self.path):
            execute("BEGIN IMMEDIATE")
            (text,) = execute("SELECT json FROM header").fetchone()
            execute("UPDATE header SET json = ?", (with_findings(text, findings, contradicted),))
            execute("COMMIT")

    def finish(self) -> None:
        """Mark the run complete and close it; one file is left."""
        now = datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")
        with run_store.translated(self.path, has_frames=True):
            self._connection.execute("INSERT INTO finished SELECT ? WHERE NOT EXISTS (SELECT * FROM finished)", (now,))
        self.close()

    def close(self) -> None:
        """Close the file; a run that is not finished can be resumed."""
        run_store.close_writing(self._connection)

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(sqlite3.ProgrammingError):  # finish() has closed it
            self.close()


def _knowledge_of(o: Observation) -> dict[str, np.ndarray]:
    estimate, lifted = o.estimate, o.lifted
    arrays = {} if estimate is None else {"estimate_q": estimate.q, "estimate_covariance": estimate.covariance}
    arrays |= {} if lifted is None else {"lifted": lifted.points, "lifted_share": np.array(lifted.share)}
    return arrays if o.markers is None else {**arrays, "markers": o.markers}
