"""The SQLite file under a run: schema, opening, and what can be wrong with it.

    header(json)                              one row
    frame(position, data)                     one row a frame, in order: the packed arrays of a FrameResult
    state(next, data)                         one row: the tracker's exact state after the last frame
    observation(position, data)               keypoints of each frame, for pictures and for a resume's check
    smoothed(data)                            one row: the best trajectory, estimated over all frames together; of a
                                              long one the covariances in further rows, of some frames each
    finished(at)                              one row when the run is complete

While a run is written it keeps a write-ahead log (`RUN-wal`) beside the file, so that readers and the writer never wait
for each other and a killed process loses nothing committed. Closing folds the log into the file.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import ClassVar

from humanoid.support.errors import InputError

APPLICATION_ID = 0x6B6D6F64  # "kmod", SQLite's own mark of a file's application
SCHEMA_VERSION = 1
SCHEMA = """
CREATE TABLE header (json TEXT NOT NULL);
CREATE TABLE frame (position INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE state (id INTEGER PRIMARY KEY CHECK (id = 0), next INTEGER NOT NULL, data BLOB NOT NULL);
CREATE TABLE observation (position INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE smoothed (data BLOB NOT NULL);
CREATE TABLE finished (at TEXT NOT NULL);
"""
_WAIT_S = 10.0
_PAGE = 16384  # bytes: a frame has some 80 kB, which in fewer pages takes a third less time to write


def create_store(path: Path, header: str, final: Path) -> None:
    """Write a new, empty run file with its header; `final` is the name it will have, and has in errors."""
    with translated(final):
        connection = sqlite3.connect(path, isolation_level=None)
        try:
            connection.execute(f"PRAGMA page_size = {_PAGE}")
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            connection.executescript(f"BEGIN; {SCHEMA} COMMIT;")
            connection.execute("INSERT INTO header VALUES (?)", (header,))
        finally:
            connection.close()


def open_writing(path: Path) -> sqlite3.Connection:
    """A connection that writes; commits survive the death of the process, though not of the machine."""
    check(path)
    with translated(path):
        connection = sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
        return connection


def close_writing(connection: sqlite3.Connection) -> None:
    """Close so that one file is left, unless a reader still has it open."""
    with suppress(sqlite3.OperationalError):  # a reader is at work: the last one to close folds the log in
        connection.execute("PRAGMA busy_timeout = 200")
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        connection.execute("PRAGMA journal_mode = DELETE")
    connection.close()


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection for some queries that see the run as of one moment."""
    with translated(path):
        connection = _connect_reading(path)
        try:
            connection.execute("BEGIN")
            yield connection
        finally:
            connection.close()


def _connect_reading(path: Path) -> sqlite3.Connection:
    # opening for writing lets SQLite recover a killed writer's log; a file in a read-only folder has to do without
    for mode in ("mode=rw", "mode=ro", "mode=ro&immutable=1"):
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?{mode}", uri=True, timeout=_WAIT_S, isolation_level=None
        )
        try:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            connection.execute("PRAGMA query_only = 1")
            return connection
        except sqlite3.OperationalError:
            connection.close()
            if mode.endswith("immutable=1"):
                raise
    raise AssertionError


def check(path: Path) -> None:
    """Raise InputError unless `path` is a run file of a version this program reads."""
    if path.is_dir():
        raise InputError(path, "is a folder, a run file is needed")
    if not path.is_file():
        raise InputError(path, "no such run file")
    try:
        with path.open("rb") as file:
            start = file.read(100)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from None
    if not start.startswith(b"SQLite format 3\0"):
        raise InputError(path, "is not a run file", remedy="run files are written by `kinemode track`")
    with reading(path) as connection:
        (owner,) = connection.execute("PRAGMA application_id").fetchone()
        (version,) = connection.execute("PRAGMA user_version").fetchone()
    if owner != APPLICATION_ID:
        raise InputError(path, "is a database of another program, no run file")
    if version != SCHEMA_VERSION:
        remedy = "update kinemode" if version > SCHEMA_VERSION else "track again"
        raise InputError(path, f"is of version {version}, this program reads {SCHEMA_VERSION}", remedy=remedy)


@contextmanager
def translated(path: Path, *, has_frames: bool = False) -> Iterator[None]:
    """SQLite's errors as errors of the file; `has_frames` where there may be frames in it, which an error does not
    touch."""
    try:
        yield
    except sqlite3.IntegrityError:
        raise InputError(path, "another process is writing this run") from None
    except sqlite3.OperationalError as error:
        raise _refused(path, str(error), has_frames) from None
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # the latter from a message quoting damaged text
        raise InputError(path, f"is damaged: {error}", remedy="a truncated copy? copy it again") from None


def _refused(path: Path, why: str, has_frames: bool) -> InputError:
    """An error of SQLite as an InputError. A quota or a limit on file sizes is an I/O error to SQLite."""
    full = {"database or disk is full": "the disk is full", "disk I/O error": "the disk takes no more, or failed"}.get(
        why
    )
    if full is None:
        return InputError(path, f"cannot be used: {why}")
    if not has_frames:
        return InputError(path, f"cannot be written: {full}", remedy="make room, or name a file on another disk")
    return InputError(path, f"{full}; what was tracked is kept", remedy="make room, --resume then continues it")


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
