"""Long measures in pieces: each leaves a file when it is done and is not done again, so that a measure that was
interrupted resumes; and clips that are rendered once."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from benchmarks.support.common import ROOT, quiet, tell
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.progress import reported
from kinemode.shot import RenderedClip
from kinemode.target import made_folder
from kinemode.terminal.interruption import is_interruption

Figures = dict[str, Any]
"""JSON values."""
DONE = "done"
INTERRUPTED = 130  # exit code


class Piece(Protocol):
    """One piece of a measure; sent to other processes, so of plain values."""

    @property
    def name(self) -> str:
        """The name of the file, in words."""
        ...

    @property
    def what(self) -> Mapping[str, Any]:
        """All that decides what comes out, but the code: JSON values."""
        ...

    def work(self, store: ResultStore) -> Figures:
        """Do it; other pieces that it needs are in `store` or are done there."""
        ...


@dataclass(frozen=True)
class ResultStore:
    """The pieces that are done, a file each in a folder; and where they may put what is not kept."""

    folder: Path

    def done(self, piece: Piece) -> Figures | None:
        """The result of a piece, None where it is not done."""
        path = self.path(piece)
        return json.loads(path.read_text(encoding="utf-8"))["result"] if path.is_file() else None

    def of(self, piece: Piece) -> Figures:
        """The result of a piece, which is computed if missing."""
        if (before := self.done(piece)) is not None:
            return before
        path, result = self.path(piece), piece.work(self)
        made_folder(path.parent)
        with replacing(path) as temporary:
            written = {"what": piece.what, "code": code_digest(), "result": result}
            temporary.write_text(json.dumps(written, indent=1) + "\n", encoding="utf-8")
        return json.loads(json.dumps(result))  # as it is read next time

    def scratch(self, piece: Piece, suffix: str) -> Path:
        """A path of the piece's own for a file that it removes when it is done."""
        return made_folder(self.folder / "scratch") / (self.path(piece).stem + suffix)

    def codes(self, pieces: Sequence[Piece]) -> set[str]:
        """Digests of the sources that made these pieces, which are done."""
        return {json.loads(self.path(piece).read_text(encoding="utf-8"))["code"] for piece in pieces}

    def path(self, piece: Piece) -> Path:
        """The file of a piece."""
        text = json.dumps(piece.what, sort_keys=True)
        return self.folder / "done" / f"{piece.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}.json"


@cache
def code_digest() -> str:
    """The digest of all sources on which a track depends."""
    digest = hashlib.sha256()
    for package in ("humanoid", "estimator"):
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in {".py", ".urdf", ".toml"}:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def all_done(label: str, store: ResultStore, pieces: Sequence[Piece], jobs: int) -> list[Figures]:
    """The results of all pieces in order; so many processes do those that are not done yet, with progress
    and the time left. Raises InputError for no process."""
    if jobs < 1:
        raise InputError("--jobs", f"is {jobs}", remedy="1 or more")
    missing = {store.path(piece): piece for piece in pieces if store.done(piece) is None}
    left = list(missing.values())
    if len(left) < len(pieces):
        tell(f"{label}: {len(pieces) - len(left)} of {len(pieces)} are kept from before")
    try:
        with reported(label) as progress:
            _do(store, left, jobs, lambda done: progress(done, len(left)))
    except (KeyboardInterrupt, SystemError) as stop:
        if not is_interruption(stop):
            raise
        tell("interrupted: the same command with the same --work resumes")
        sys.exit(INTERRUPTED)
    return [store.of(piece) for piece in pieces]


def _do(store: ResultStore, pieces: Sequence[Piece], jobs: int, progress: Callable[[int], None]) -> None:
    if min(jobs, len(pieces)) < 2:
        for i, piece in enumerate(pieces):
            store.of(piece)
            progress(i + 1)
        return
    spawn = multiprocessing.get_context("spawn")  # a forked child would inherit threads that stand still
    pool = ProcessPoolExecutor(min(jobs, len(pieces)), spawn, quiet)
    try:
        waiting: list[Future[Figures]] = [pool.submit(store.of, piece) for piece in pieces]
        for i, future in enumerate(as_completed(waiting)):
            future.result()
            progress(i + 1)
    finally:
        pool.shutdown(cancel_futures=True)


def removed(run: Path) -> None:
    """Remove a run file and the files next to it."""
    for path in run.parent.glob(f"{run.name}*"):
        path.unlink()


def cached_clip(folder: Path, render: Callable[[Path], object]) -> RenderedClip:
    """The clip that `render` renders into a folder, rendered only if it is not there to the end."""
    if not (folder / DONE).is_file():
        render(folder)
        (folder / DONE).touch()
    names = sorted(path.stem for path in (folder / "keypoints").glob("*.json"))
    videos = {name: folder / f"{name}.mp4" for name in names}
    plates = {name: folder / f"plate_{name}.png" for name in names}
    return RenderedClip(
        {name: path for name, path in videos.items() if path.is_file()},
        {name: folder / "keypoints" / f"{name}.json" for name in names},
        {name: folder / "first_frame" / f"{name}.json" for name in names},
        {name: path for name, path in plates.items() if path.is_file()},
        folder / "cameras.json",
        folder / "truth.npz",
        folder / "subject.urdf",
        depths={path.name: path for path in sorted((folder / "depths").glob("*"))},
    )
