"""The overhead of a batch: time per clip and memory of the process that leads, with jobs that do nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.robustness.batch_clips import Mappings, short_clips, write_csv
from benchmarks.robustness.batch_stubs import (
    FRAMES,
    LeaderCost,
    answer_alone,
    lead_alone,
    whole_batch,
    written_outcome,
)
from benchmarks.support.common import tell
from kinemode.terminal import report

MS, MEGABYTES = 5.0, 200.0  # targets, a clip and of the leader
_FEWER = 10  # times


def stub_rows(folder: Path, count: int) -> Mappings:
    """So many rows with the files of one clip."""
    (row,) = short_clips(folder, 1, FRAMES)
    return [{**row, "name": f"clip{i:05d}"} for i in range(count)]


def measure_overhead(folder: Path, rows: int) -> dict[str, Any]:
    """Print the table; the figures. Each batch is led by a process of its own."""
    mappings = stub_rows(folder / "inputs", rows)
    costs: dict[str, list[LeaderCost]] = {}
    for count in (max(1, rows // _FEWER), rows):
        manifest = write_csv(folder / f"{count}.csv", mappings[:count])
        roots = [folder / f"{kind}{count}" for kind in ("answers", "outcomes", "batch")]
        for name, work, given in (
            ("leader, jobs that only answer", lead_alone, (mappings[:count], roots[0], answer_alone)),
            ("leader, outcomes written", lead_alone, (mappings[:count], roots[1], written_outcome)),
            ("km.batch, outcomes written", whole_batch, (manifest, count, roots[2], written_outcome)),
            ("km.batch again, all finished", whole_batch, (manifest, count, roots[2], written_outcome)),
        ):
            cost = in_own_process(work, *given)
            tell(f"{name}, {count} rows: {cost.each:.2f} ms each, {cost.peak:.0f} MB")
            costs.setdefault(name, []).append(cost)
    show_costs(costs)
    return {
        name: {"batches": [{**asdict(cost), "ms": cost.each} for cost in listed], "ms of one more": more_ms(listed)}
        for name, listed in costs.items()
    }


def more_ms(listed: Sequence[LeaderCost]) -> float:
    """Time per additional clip of the larger batch [ms], without the start."""
    few, many = listed
    return 1e3 * (many.clock - few.clock) / max(1, many.rows - few.rows)


def in_own_process(work: Callable[..., LeaderCost], *given: Any) -> LeaderCost:
    """The result of a module's function in a process that does nothing else."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(work, *given).result()


def show_costs(costs: dict[str, list[LeaderCost]]) -> None:
    """A row for each batch."""
    columns = ("rows", "ms a clip", "of one more", "leader, processor [ms]", "memory before", "after", "peak [MB]")
    made = report.table("jobs that do nothing", "what", *columns)
    for name, listed in costs.items():
        for cost in listed:
            memories = (f"{value:.0f}" for value in (cost.before, cost.after, cost.peak))
            processor = f"{1e3 * cost.processor / cost.rows:.2f}"
            more = f"{more_ms(listed):.2f}" if cost is listed[-1] else ""
            made.add_row(name, str(cost.rows), f"{cost.each:.2f}", more, processor, *memories)
    out = report.console()
    out.print(made)
    out.print(f"target: at most {MS:g} ms a clip, at most {MEGABYTES:g} MB in the leader")
