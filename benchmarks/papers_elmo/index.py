"""An index of examples: how near to a picture's pose its neighbours are, beside what exact search and chance find, by
size of the index, keys, tables and neighbours; and how long a query takes, beside other searches of the same bits."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np

from benchmarks.papers_elmo.index_curves import Curves, Made, Row
from benchmarks.papers_elmo.index_libraries import missing
from benchmarks.papers_elmo.index_pictures import asked, painted
from benchmarks.papers_elmo.index_plot import TITLES, write_curves
from benchmarks.papers_elmo.index_searches import Row as SearchRow, searched
from benchmarks.support.common import Json, Several, save, tell
from estimator.data.media.threads import one_thread
from estimator.search.examples.index import ExampleIndex, load_index
from estimator.vision.person_view import edge_histogram
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.terminal import report

_SEED = 12345  # of the queries: other bodies, clothes, light and poses than the index's
_OPTIONS = {"examples": "--sizes", "key_bits": "--key-bits", "tables": "--tables", "neighbours": "--counts"}
_LONGEST_KEY = 62  # bits: keys are whole numbers of 64


def main(
    *,
    index: Path,
    subject: str = "human34",
    queries: int = 200,
    sizes: Annotated[tuple[int, ...], Several] = (1000, 3000, 6000, 12_000, 30_000, 60_000),
    key_bits: Annotated[tuple[int, ...], Several] = (10, 14, 18, 22, 26),
    tables: Annotated[tuple[int, ...], Several] = (10, 25, 50, 100, 200),
    counts: Annotated[tuple[int, ...], Several] = (1, 5, 10, 20, 50, 100, 200),
    count: int = 50,
    aligned: bool = True,
    seed: int = _SEED,
    picture: Path | None = None,
    json: Json = None,
) -> None:
    """Look up pictures of poses that are not in an index.

    Parameters
    ----------
    index
        The file (`kinemode train-index`).
    subject
        Whose it is.
    queries
        How many pictures.
    sizes
        Sizes of the index, of its first examples.
    key_bits
        Bits of a key.
    tables
        Hash tables.
    counts
        Numbers of neighbours.
    count
        Neighbours where their number is not what changes.
    aligned
        Errors about the mean of the joints; without, as the poses are put before the camera.
    seed
        Of the pictures.
    picture
        Also draw the curves here (PNG).
    """
    body = Body(load_subject(subject))
    whole = load_index(index, body)
    made = Made(len(whole.q), whole.recipe.key_bits, whole.recipe.tables, count)
    values = {"examples": [n for n in sizes if n <= made.examples], "key_bits": key_bits, "tables": tables}
    changed = {
        name: [made._replace(**{name: v}) for v in some] for name, some in (values | {"neighbours": counts}).items()
    }
    check(changed, queries, len(whole.bits))
    with one_thread():
        pictures = painted(body, whole, queries, np.random.default_rng(seed))
        histogram_ms = 1e3 * _seconds(lambda: [edge_histogram(e.grey, e.where) for e in pictures]) / queries
    picture_queries = asked(body, whole, pictures, aligned=aligned)
    curves = Curves(whole, picture_queries, max(m.neighbours for some in changed.values() for m in some))
    rows = {name: [curves.row(m) for m in some] for name, some in changed.items()}
    show(whole, rows, histogram_ms)
    beside = list(searched(whole, picture_queries, count))
    show_searches(beside, count)
    if picture is not None:
        write_curves(picture, rows)
    asked_for = {"index": str(index), "queries": queries, "seed": seed, "aligned": aligned}
    size = {"bits": len(whole.bits), "bytes": index.stat().st_size, "histogram_ms": histogram_ms}
    plain = {name: [asdict(r) | {"made": r.made._asdict()} for r in some] for name, some in rows.items()}
    save(json, {"measure": "index", **asked_for, **size, "curves": plain, "searches": [asdict(r) for r in beside]})


def check(changed: dict[str, list[Made]], queries: int, bits: int) -> None:
    """Raise InputError where a request cannot be met."""
    if queries < 1:
        raise InputError("--queries", f"is {queries}", remedy="1 or more")
    longest = min(bits, _LONGEST_KEY)
    for name, some in changed.items():
        option = _OPTIONS[name]
        for made in some:
            if min(made) < 1:
                raise InputError(option, f"has {min(made)}", remedy="1 or more")
            if made.neighbours > made.examples:
                raise InputError(option, f"has {made.neighbours} neighbours of {made.examples} examples")
            if made.key_bits > longest:
                raise InputError(option, f"has keys of {made.key_bits} bits", remedy=f"at most {longest}")


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def show(index: ExampleIndex, curves: dict[str, list[Row]], histogram_ms: float) -> None:
    tell(f"{len(index.bits)} bits, side {index.side:.2f} m, a histogram in {histogram_ms:.1f} ms")
    for name, rows in curves.items():
        table = report.table(
            "mean over shoulders, elbows, wrists, neck and head of the best neighbour [mm]",
            TITLES[name], "nearest of all", "all compared", "hashed", "chance", "hashed / nearest", "/ all compared",
            "/ chance", "compared", "too few", "query [ms]",
        )  # fmt: skip
        for r in rows:
            errors = (f"{x:.0f}" for x in (r.nearest, r.exact, r.hashed, r.chance))
            ratios = (f"{r.hashed / x:.2f}" for x in (r.nearest, r.exact, r.chance))
            shares = f"{r.looked_at:.2%}", f"{r.fell_back:.0%}"
            table.add_row(str(getattr(r.made, name)), *errors, *ratios, *shares, f"{r.query_ms:.2f}")
        report.console().print(table)


def show_searches(rows: Sequence[SearchRow], count: int) -> None:
    columns = ("search", "build [s]", "query [ms]", f"recall@{count}", f"best of {count} [mm]")
    table = report.table("the same bits, other searches, one core", *columns)
    for r in rows:
        quality = ("", "") if r.recall is None else (f"{r.recall:.2f}", f"{r.best:.0f}")
        table.add_row(r.name, f"{r.build_s:.1f}", f"{r.query_ms:.2f}", *quality)
    report.console().print(table)
    if missing():
        tell(f"for more rows: pip install {' '.join(missing())}")
