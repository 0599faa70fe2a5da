"""An index of examples: how near to a picture's pose its neighbours are, beside what exact search and chance find, by
size of the index, and how long it takes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from benchmarks.common import Several, save, start, tell
from benchmarks.elmo_clips import JOINTS
from estimator.imaging.edge_histogram import edge_histogram
from estimator.media.threads import one_thread
from estimator.search.examples.hashing import HashTables, unpacked
from estimator.search.examples.index import ExampleIndex, load_index
from estimator.synthesis.examples.pictures import Example, ExamplePainter, variants
from estimator.synthesis.examples.poses import PoseSampler
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

_SEED = 12345  # of the queries: other bodies, clothes, light and poses than the index's


@dataclass(frozen=True)
class Row:
    """Of one size of the index: mean error of the best of `count` neighbours [mm], over all queries, by who chose them;
    `nearest`: of all examples; `first`: of the nearest neighbour alone; looked_at: share of the examples that a query
    was compared with; fell_back: share of the queries whose buckets had too few; milliseconds of a query, and of exact
    search by all codes."""

    examples: int
    nearest: float
    exact: float
    hashed: float
    hashed_10: float
    first: float
    chance: float
    chance_10: float
    looked_at: float
    fell_back: float
    query_ms: float
    exact_ms: float


def main(
    *,
    index: Path,
    subject: str = "human34",
    queries: int = 200,
    sizes: Annotated[tuple[int, ...], Several] = (1000, 3000, 6000, 12_000, 30_000, 60_000),
    count: int = 50,
    aligned: bool = True,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
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
    count
        Neighbours.
    aligned
        Errors about the mean of the joints; without, as the poses are put before the camera.
    json
        Also write the figures here.
    """
    body = Body(load_subject(subject))
    whole = load_index(index, body)
    rng = np.random.default_rng(_SEED)
    with one_thread():
        made = asked(body, whole, queries, rng)
        histogram_ms = 1e3 * _seconds(lambda: [edge_histogram(e.grey, e.where) for e in made]) / len(made)
    joints = [body.landmark_names.index(name) for name in JOINTS if name in body.landmark_names]

    def places(q: np.ndarray) -> np.ndarray:
        points = body.landmarks(body.at(q.astype(float)))[joints]
        return points - points.mean(axis=0) if aligned else points

    known = np.array([places(q) for q in whole.q])
    true = np.array([places(e.q) for e in made])
    values = whole.bits.of(np.array([e.description for e in made]))
    rows = [row(whole, known, true, values, min(n, len(known)), count, rng) for n in sizes if n <= len(known)]
    show(whole, rows, count, histogram_ms)
    figures = {"queries": queries, "bits": len(whole.bits), "histogram_ms": histogram_ms}
    told = figures | {"bytes": index.stat().st_size, "rows": [asdict(r) for r in rows]}
    save(json, {"measure": "example index", "index": str(index), **told})


def asked(body: Body, index: ExampleIndex, count: int, rng: np.random.Generator) -> list[Example]:
    """Pictures of poses drawn as those of the index, of bodies that it has not seen."""
    recipe = index.recipe
    painter = ExamplePainter(body, variants(body.subject, 6, rng), recipe.elevation, index.side)
    sampler = PoseSampler(body, headings=recipe.headings, legs=recipe.legs)
    return [painter.example(sampler.draw(rng), rng) for _ in range(count)]


def row(
    index: ExampleIndex, known: np.ndarray, true: np.ndarray, values: np.ndarray, size: int, count: int,
    rng: np.random.Generator,
) -> Row:  # fmt: skip
    """Of the first `size` examples; known (N, J, 3), true (Q, J, 3) [m], values (Q, M) bool."""
    tables = HashTables(index.tables.codes[:size], index.tables.chosen)
    bits = unpacked(index.tables.codes[:size])[:, : values.shape[1]].astype(np.float32)
    signs = 2.0 * bits - 1.0
    least: list[list[float]] = []
    looked, back, query_s, exact_s = [], [], [], []
    for q, value in enumerate(values):
        away = 1e3 * np.linalg.norm(known[:size] - true[q], axis=2).mean(axis=1)
        begin = time.perf_counter()
        near = tables.nearest(value, count)
        query_s.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        exact = np.argsort(-(signs @ (2.0 * value.astype(np.float32) - 1.0)), kind="stable")[:count]
        exact_s.append(time.perf_counter() - begin)
        drawn = rng.choice(size, count, replace=False)
        chosen = (slice(None), exact, near.numbers, near.numbers[:10], near.numbers[:1], drawn, drawn[:10])
        least.append([float(away[numbers].min()) for numbers in chosen])
        looked.append(near.looked_at / size)
        back.append(near.fell_back)
    nearest, exact_mm, hashed, hashed_10, first, chance, chance_10 = np.mean(least, axis=0).tolist()
    query_ms, exact_ms = (1e3 * float(np.median(seconds)) for seconds in (query_s, exact_s))
    return Row(
        size, nearest, exact_mm, hashed, hashed_10, first, chance, chance_10, float(np.mean(looked)),
        float(np.mean(back)), query_ms, exact_ms,
    )  # fmt: skip


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def show(index: ExampleIndex, rows: list[Row], count: int, histogram_ms: float) -> None:
    tell(f"{len(index.bits)} bits, side {index.side:.2f} m, a histogram in {histogram_ms:.1f} ms")
    table = report.table(
        f"best of {count}, mean over shoulders, elbows, wrists, neck and head [mm]",
        "examples", "nearest of all", "exact by codes", "hashed", "of 10", "of 1", "chance", "of 10 ",
        "hashed / nearest", "/ exact", "/ chance", "looked at", "all looked at", "query [ms]", "exact [ms]",
    )  # fmt: skip
    for r in rows:
        errors = (r.nearest, r.exact, r.hashed, r.hashed_10, r.first, r.chance, r.chance_10)
        ratios = (r.hashed / r.nearest, r.hashed / r.exact, r.hashed / r.chance)
        shares = f"{r.looked_at:.1%}", f"{r.fell_back:.0%}"
        times = f"{r.query_ms:.2f}", f"{r.exact_ms:.1f}"
        table.add_row(str(r.examples), *(f"{x:.0f}" for x in errors), *(f"{x:.2f}" for x in ratios), *shares, *times)
    report.console().print(table)


if __name__ == "__main__":
    start(main)
