"""An index of examples, made: bits learned from pairs of pictures, then any number of poses with their bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.npz import read_npz
from estimator.data.media.threads import one_thread
from estimator.numerics.processes import GUARD, begin_as_worker, checked_count, one_thread_each
from estimator.search.examples.hashing import Bits, HashTables, learned_bits, packed, random_keys
from estimator.search.examples.index import FORMAT, ExampleIndex, IndexRecipe
from estimator.synthesis.pictures import Example, ExamplePainter, variants
from estimator.synthesis.poses import sampler_of
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import Base, Subject, subject_from_text
from humanoid.support.errors import InputError
from humanoid.support.files import replacing

SIMILAR, DISSIMILAR = 0.05, 0.10  # m: every landmark within the one, or some beyond the other (ELMO section 4)
PAIRS_AT_ONCE, EXAMPLES_AT_ONCE = 100, 500
_REACH_POSES, _REACH = 200, 98.0  # poses that the square is measured by, and the percentage that fits into it
_PAIRS, _EXAMPLES, _BODIES, _KEYS = range(4)  # what random numbers are for
Report = Callable[[int, int], None]


def train_index(
    subject: Subject,
    recipe: IndexRecipe,
    *,
    parts: Path | None = None,
    processes: int = 1,
    progress: Report | None = None,
) -> ExampleIndex:
    """An index of a subject with flesh, identical for any number of processes.

    parts: a folder for finished pieces, so that the same call continues where one was interrupted. progress: called
    with the number of finished pieces and of all.

    Raises
    ------
    InputError: a subject without flesh, or too few examples or pairs for the keys.
    """
    _check(subject, recipe)
    body = Body(subject)
    painting = Painting(subject.urdf, subject.source, subject.base, recipe, _side(body, recipe))
    store = _PieceStore(parts, f"{FORMAT}{painting!r}")
    counts = [-(-recipe.pairs // PAIRS_AT_ONCE), -(-recipe.examples // EXAMPLES_AT_ONCE)]
    piece_progress = _PieceProgress(progress, sum(counts))
    with _painters(painting, processes) as paint:
        bits = _bits(list(_made(paint, store, "pairs", Gallery.pairs, range(counts[0]), piece_progress)), recipe)
        work = partial(Gallery.examples, bits=bits)
        made = list(_made(paint, store, "examples", work, range(counts[1]), piece_progress))
    q, codes = (np.concatenate([part[name] for part in made])[: recipe.examples] for name in ("q", "codes"))
    keys = random_keys(len(bits), np.random.default_rng((recipe.seed, _KEYS)), recipe.tables, recipe.key_bits)
    return ExampleIndex(recipe, body.q_names, painting.side, q, bits, HashTables(codes, keys))


class Painting(NamedTuple):
    """Input of a process that paints examples. urdf, source, base: of the subject. side [m]: of the square around a
    person."""

    urdf: str
    source: str
    base: Base
    recipe: IndexRecipe
    side: float


class Gallery:
    """Paints pieces of an index; what comes out of a piece depends on its number alone."""

    def __init__(self, painting: Painting) -> None:
        subject = subject_from_text(painting.urdf, source=painting.source, base=painting.base)
        recipe = self._recipe = painting.recipe
        body = Body(subject)
        self._poses = sampler_of(body, recipe)
        bodies = variants(subject, recipe.variants, self._rng(_BODIES, 0))
        self._painter = ExamplePainter(body, bodies, recipe.elevation, painting.side)

    @one_thread()
    def pairs(self, piece: int) -> dict[str, np.ndarray]:
        """Pictures of at most `PAIRS_AT_ONCE` poses, a, and of similar ones, b: `a` and `b` (P, bins), `landmarks`
        (P, L, 3) of the former."""
        rng, made = self._rng(_PAIRS, piece), []
        for _ in range(_count(self._recipe.pairs, PAIRS_AT_ONCE, piece)):
            q = self._poses.draw(rng)
            made.append((self._painter.example(q, rng), self._similar(q, rng)))
        a, b = (np.array([pair[k].description for pair in made]) for k in (0, 1))
        return {"a": a, "b": b, "landmarks": np.array([pair[0].landmarks for pair in made])}

    @one_thread()
    def examples(self, piece: int, bits: Bits) -> dict[str, np.ndarray]:
        """At most `EXAMPLES_AT_ONCE` poses `q` (N, nq) as they are kept, with the codes (N, W) of their bits."""
        rng, count = self._rng(_EXAMPLES, piece), _count(self._recipe.examples, EXAMPLES_AT_ONCE, piece)
        made = [self._painter.example(self._poses.draw(rng), rng) for _ in range(count)]
        values = bits.of(np.array([example.description for example in made]))
        return {"q": np.array([example.q for example in made], dtype=np.float32), "codes": packed(values)}

    def _similar(self, q: np.ndarray, rng: np.random.Generator) -> Example:
        return self._painter.example(self._poses.near(q, rng, SIMILAR), rng)

    def _rng(self, purpose: int, piece: int) -> np.random.Generator:
        return np.random.default_rng((self._recipe.seed, purpose, piece))


def _count(total: int, at_once: int, piece: int) -> int:
    """Number of examples of a piece: the last one has the remainder. (Pieces that were kept before it was so have
    more.)"""
    return min(at_once, total - piece * at_once)


@dataclass(frozen=True)
class _PieceStore:
    """Pieces that are done, as files of a folder; none without one. what: all that decides what comes out."""

    folder: Path | None
    what: str

    def of(self, kind: str, piece: int) -> dict[str, np.ndarray] | None:
        if self.folder is None or not (path := self._path(kind, piece)).is_file():
            return None
        with suppress(InputError):  # an unreadable one is done again
            arrays = read_npz(path)
            if str(arrays.pop("what", "")) == self.what:
                return arrays
        return None

    def put(self, kind: str, piece: int, arrays: dict[str, np.ndarray]) -> None:
        if self.folder is None:
            return
        with replacing(self._path(kind, piece)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, what=np.array(self.what), **arrays)  # type: ignore[arg-type]

    def _path(self, kind: str, piece: int) -> Path:
        assert self.folder is not None
        return self.folder / f"{kind}_{piece:04d}.npz"


@dataclass
class _PieceProgress:
    """Progress over all pieces."""

    report: Report | None
    total: int
    done: int = 0

    def more(self) -> None:
        self.done += 1
        if self.report is not None:
            self.report(self.done, self.total)


_Work = Callable[[Gallery, int], dict[str, np.ndarray]]
_Paint = Callable[[_Work, Sequence[int]], Iterator[dict[str, np.ndarray]]]
"""The results of work on pieces, in their order."""


@contextmanager
def _painters(painting: Painting, processes: int) -> Iterator[_Paint]:
    """This process, or a number of others that share the work. Raises InputError where one of them ends
    unexpectedly."""
    if checked_count(processes) == 1:
        gallery = Gallery(painting)
        yield lambda work, pieces: (work(gallery, piece) for piece in pieces)
        return
    spawn = get_context("spawn")  # a forked child would inherit threads that stand still
    with one_thread_each(), ProcessPoolExecutor(processes, spawn, _open_gallery, (painting,)) as pool:
        try:
            yield lambda work, pieces: pool.map(partial(_work_in_gallery, work), pieces)
        except BrokenProcessPool:
            remedy = f"{GUARD}; else too little memory is the usual cause, and --workers 1 does without"
            raise InputError("workers", "a worker process has ended", remedy=remedy) from None
        finally:
            pool.shutdown(cancel_futures=True)


_gallery: Gallery | None = None  # of a worker process


def _open_gallery(painting: Painting) -> None:
    global _gallery
    begin_as_worker()
    _gallery = Gallery(painting)


def _work_in_gallery(work: _Work, piece: int) -> dict[str, np.ndarray]:
    assert _gallery is not None
    return work(_gallery, piece)


def _made(
    paint: _Paint, store: _PieceStore, kind: str, work: _Work, pieces: Sequence[int], piece_progress: _PieceProgress
) -> Iterator[dict[str, np.ndarray]]:
    """The result of every piece, in their order; each is stored when it is done."""
    known = {k: arrays for k in pieces if (arrays := store.of(kind, k)) is not None}
    painted = paint(work, [k for k in pieces if k not in known])
    for k in pieces:
        arrays = known.pop(k, None)
        if arrays is None:
            arrays = next(painted)
            store.put(kind, k, arrays)
        piece_progress.more()
        yield arrays


def _bits(made: list[dict[str, np.ndarray]], recipe: IndexRecipe) -> Bits:
    """Learned from the pairs: similar ones as they were made, dissimilar ones of pictures of different poses."""
    names = ("a", "b", "landmarks")
    a, b, landmarks = (np.concatenate([part[name] for part in made])[: recipe.pairs] for name in names)
    rng = np.random.default_rng((recipe.seed, _PAIRS))
    i, j = rng.integers(0, len(a), (2, 2 * len(a)))
    apart = np.linalg.norm(landmarks[i] - landmarks[j], axis=2).max(axis=1) > DISSIMILAR
    i, j = i[apart][: len(a)], j[apart][: len(a)]
    bits = learned_bits((a, b), (a[i], b[j]))
    if len(bits) < recipe.key_bits:
        problem = f"{len(bits)} bits distinguish poses, keys have {recipe.key_bits}"
        raise InputError("pairs", problem, remedy="more pairs, or shorter keys")
    return bits


def _side(body: Body, recipe: IndexRecipe) -> float:
    """Side [m] of a square about the middle of the body that most poses fit into."""
    surface = surface_of(body, nodes=500)
    sampler = sampler_of(body, recipe)
    rng = np.random.default_rng((recipe.seed, _BODIES))
    reach = []
    for _ in range(_REACH_POSES):
        places = points_in_world(body.at(sampler.draw(rng)), surface.joint, surface.local)
        reach.append(np.abs(places - np.median(places, axis=0)).max())
    return float(2.0 * np.percentile(reach, _REACH))


def check_flesh(subject: Subject) -> None:
    """Raise InputError where nothing of a subject can be painted."""
    if not subject.flesh:
        raise InputError(
            subject.source, "has no flesh: nothing of it can be painted", remedy="add <flesh> to its links"
        )


def _check(subject: Subject, recipe: IndexRecipe) -> None:
    check_flesh(subject)
    least = 10 * recipe.key_bits
    for name, count in (("examples", recipe.examples), ("pairs", recipe.pairs)):
        if count < least:
            raise InputError(name, f"{count} are too few for keys of {recipe.key_bits} bits", remedy=f"{least} or more")
