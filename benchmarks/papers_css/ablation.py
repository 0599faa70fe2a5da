"""Ablation: CSS without one of its parts at a time, at an equal number of searches, beside the whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from benchmarks.papers_css.ablation_runs import SUITES, Measured, Wanted, parts, prepared
from benchmarks.papers_css.runs_plot import Difference, write_differences
from benchmarks.papers_css.summaries import Spread, TrackStatistics, gain, paired, track_statistics
from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    check_known,
    in_processes,
    nested,
    save,
    work_folder,
)
from benchmarks.support.result_store import ResultStore, all_done
from benchmarks.support.scores import LOST
from humanoid.support.errors import InputError
from kinemode.terminal import report

WHOLE = "css"
ROWS: dict[str, dict[str, Any]] = {
    WHOLE: {},
    "no samples": {"css": {"samples": 0}},
    "spherical samples": {"css": {"shape": "spherical"}},
    "no jumps": {"css": {"jumps": 0}},
    "no exchange": {"search": {"exchange": False}},
    "no momentum": {"css": {"momentum": 0.0}},
    "no limb searches": {"css": {"limb_searches": 0, "exchanges": 0}},
    "no flow in the covariance": {"search": {"flow_in_covariance": False}},
    "no transition": {"css": {"transition": False}},
}
"""Changes to the settings. What a source of proposals leaves of the budget goes to the others, so that all rows have as
many searches: a row shows what a part is worth against what its searches would do elsewhere."""
PICTURES_ALONE = ("no momentum", "no limb searches", "no flow in the covariance")
"""These act on pictures; without them the row would be the whole to the last bit."""
RIVALS = ("no samples", "spherical samples")
LEAST = 0.10
"""By how much samples by the covariance have to beat these, in error or in runs lost."""
LEGEND = (
    "filtered: best hypothesis of each frame as tracked; smoothed: the final trajectory; [mm] over the limb joints,"
    " with pictures alone in the world, from keypoints with the hips aligned. Mean over the runs ± standard error"
    " (deviation); the error is that of independent runs, or of independent clips where it is larger.\n"
    "more: than the whole on the same clips with the same seeds, mean ± standard error.\n"
    f"lost: runs with a lost frame: {LOST}.\n"
    "Every row has the same number of searches: those of a source that is off go to the others. A dash: the part has no"
    " effect without pictures."
)
COLUMNS = ("filtered [mm]", "more", "lost", "smoothed [mm]", "more ", "lost ", "ms a frame")


@dataclass(frozen=True)
class Row:
    """All runs of a suite without one part. more: errors beyond those of the whole in the same runs; lost_more: the
    same of being lost, in runs."""

    suite: str
    name: str
    filtered: TrackStatistics
    smoothed: TrackStatistics
    more: Difference
    lost_more: Difference
    cpu: float


def main(
    *,
    data: Data = None,
    suites: Annotated[tuple[str, ...], Several] = tuple(SUITES),
    rows: Annotated[tuple[str, ...], Several] = tuple(ROWS),
    clip_seeds: Annotated[tuple[int, ...], Several] = (1, 2, 3),
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2),
    motions: Annotated[tuple[str, ...], Several] = (),
    seconds: float | None = None,
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    markdown: Annotated[bool, Parameter(negative="")] = False,
    figures: Path | None = None,
    json: Json = None,
) -> None:
    """Track with CSS without one of its parts at a time: stand-ins and motion capture from pictures alone, motion
    capture and beam4cam from keypoints. Captured motions without the pose prior, which has seen these people.

    All of it is 540 runs, about six hours of one core. An interrupted measure resumes if its --work is given again;
    runs of css on the stand-ins are shared with `benchmarks.papers_css.failures` in the same folder.

    Parameters
    ----------
    suites
        Some of stand-ins, mocap-pictures, mocap-keypoints and beam4cam.
    rows
        Which parts are left out, in words as in the table; css, the whole, is always a row.
    clip_seeds
        Seeds of the stand-ins' clips; captured motions have one.
    seeds
        Seeds of the tracker.
    motions
        Only these stand-ins, captured clips and cameras; all by default.
    seconds
        Only so much of each rendered clip.
    changes
        Changes to the settings of all rows, as cost.nu=8 css.scale=4.
    jobs
        Runs at a time, each in a process of its own.
    markdown
        Also print the table of the documents.
    figures
        Also write a picture of the differences, ablation.png, into this folder.
    """
    check_known("--rows", rows, ROWS)
    check_known("--suites", suites, SUITES)
    chosen = [WHOLE, *(name for name in rows if name != WHOLE)]
    given = nested(changes)
    with work_folder(work) as folder:
        store, wanted = ResultStore(folder), Wanted(folder / "clips", data, motions, clip_seeds, seeds, seconds, given)
        every = [
            part
            for suite in suites
            for name in chosen
            if SUITES[suite].pictures or name not in PICTURES_ALONE
            for part in parts(suite, name, ROWS[name], wanted)
        ]
        if not every:
            raise InputError("--motions", "lists no clips of the suites")
        in_processes(prepared, list({(part.suite, part.clip): part for part in every}.values()), jobs)
        pieces = [part.piece for part in every]
        results = all_done("ablation", store, pieces, jobs)
        done, codes = [part.read(r) for part, r in zip(every, results, strict=True)], len(store.codes(pieces))
    table = summed(done)
    show(table)
    for line in (*verdicts(done), *([] if codes == 1 else [f"the runs are of {codes} states of the code"])):
        report.console().print(line, soft_wrap=True)
    if markdown:
        print(in_markdown(table))
    if figures is not None:
        write_differences(figures / "ablation.png", differences(table))
    save(json, {"measure": "ablation", "settings": given, "codes": codes,
                "rows": [figures_of(row) for row in table], "runs": [asdict(a) for a in done]})  # fmt: skip


def summed(done: Sequence[Measured]) -> list[Row]:
    """By suite a row for each part that was left out, the whole first."""
    return [
        _row(suite, name, done)
        for suite in dict.fromkeys(m.suite for m in done)
        for name in dict.fromkeys(m.row for m in done if m.suite == suite)
    ]


def _row(suite: str, name: str, done: Sequence[Measured]) -> Row:
    of, measure = [m for m in done if (m.suite, m.row) == (suite, name)], SUITES[suite].measure
    clips = [m.clip for m in of]

    def more(trajectory: str, by_loss: bool) -> Spread:
        ours, whole = (_values(done, (suite,), row, trajectory, by_loss) for row in (name, WHOLE))
        return paired(ours, whole, {m.key: m.clip for m in of})

    return Row(
        suite=suite,
        name=name,
        filtered=track_statistics([m.errors["filtered"] for m in of], clips, measure),
        smoothed=track_statistics([m.errors["smoothed"] for m in of], clips, measure),
        more=Difference(more("filtered", False), more("smoothed", False)),
        lost_more=Difference(more("filtered", True), more("smoothed", True)),
        cpu=float(np.mean([m.cpu for m in of])),
    )


def _values(
    done: Sequence[Measured], suites: Sequence[str], row: str, trajectory: str, by_loss: bool
) -> dict[tuple[str, str, int], float]:
    """By run, of a row: the error in its suite's measure, or 1 where it was lost and 0 where not."""
    of = {m.key: m for m in done if m.suite in suites and m.row == row}
    if by_loss:
        return {key: float(m.errors[trajectory].lost is not None) for key, m in of.items()}
    return {key: getattr(m.errors[trajectory], SUITES[m.suite].measure) for key, m in of.items()}


def show(table: Sequence[Row]) -> None:
    """A table for each suite."""
    out = report.console()
    for suite in dict.fromkeys(row.suite for row in table):
        of = {row.name: row for row in table if row.suite == suite}
        made = report.table(f"{SUITES[suite].title}: {of[WHOLE].filtered.runs} runs", "without", *COLUMNS)
        for name in ROWS:
            if name in of:
                made.add_row(name, *_cells(of[name]))
            elif name in PICTURES_ALONE and any(row.name == name for row in table):
                made.add_row(name, *["-"] * len(COLUMNS))
        out.print(made)
    out.print(LEGEND, soft_wrap=True)


def _cells(row: Row) -> list[str]:
    cells = []
    for j, more in ((row.filtered, row.more.filtered), (row.smoothed, row.more.smoothed)):
        cells += [j.mean_and_error, "" if row.name == WHOLE else _more(more), f"{j.lost} of {j.runs}"]
    return [*cells, f"{1e3 * row.cpu:.0f}"]


def _more(more: Spread) -> str:
    return f"{more.mean:+.1f} ± {more.error:.1f}" if np.isfinite(more.error) else f"{more.mean:+.1f}"


def verdicts(done: Sequence[Measured]) -> list[str]:
    """Whether samples by the covariance beat spherical ones and none, with pictures alone: in the mean error or in runs
    lost, filtered, over all runs of these suites together."""
    suites = [name for name, suite in SUITES.items() if suite.pictures]
    verdicts_found = []
    for rival in RIVALS:
        whole, other = (_values(done, suites, row, "filtered", False) for row in (WHOLE, rival))
        if not other:
            continue
        clips = {m.key: (m.suite, m.clip) for m in done}
        errors = gain(whole, other, clips)
        lost_there, lost_here = (_values(done, suites, row, "filtered", True) for row in (rival, WHOLE))
        lost = paired(lost_there, lost_here, clips)
        good = errors.shown(LEAST) or (lost.mean >= LEAST and lost.mean > 2.0 * lost.error)
        verdicts_found.append(
            f"pictures alone, {len(other)} runs, samples by the covariance beside {rival}: error {errors}; lost in"
            f" {lost.mean:+.0%} ± {lost.error:.0%} fewer of the runs; target {LEAST:.0%} and two standard errors in"
            f" either: {'reached' if good else 'not reached'}"
        )
    return verdicts_found


def differences(table: Sequence[Row]) -> dict[str, dict[str, Difference]]:
    """For the picture: by suite, what each row has more than the whole."""
    return {
        SUITES[suite].title: {row.name: row.more for row in table if row.suite == suite and row.name != WHOLE}
        for suite in dict.fromkeys(row.suite for row in table)
    }


def in_markdown(table: Sequence[Row]) -> str:
    """The table of the documents: a line for each row, filtered and smoothed of each suite."""
    suites = list(dict.fromkeys(row.suite for row in table))
    head = ["without", *(f"{SUITES[s].title}: {kind}" for s in suites for kind in ("filtered", "smoothed"))]
    lines = [head, ["---"] * len(head)]
    for name in dict.fromkeys(row.name for row in table):
        of = {row.suite: row for row in table if row.name == name}
        lines.append([name, *(cell for s in suites for cell in _short(of.get(s)))])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _short(row: Row | None) -> list[str]:
    if row is None:
        return ["-", "-"]
    pairs = (row.filtered, row.more.filtered), (row.smoothed, row.more.smoothed)
    if row.name == WHOLE:
        return [f"{j.mean_and_error}; {j.lost} of {j.runs}" for j, _ in pairs]
    return [f"{_more(more)}; {j.lost} of {j.runs}" for j, more in pairs]


def figures_of(row: Row) -> dict[str, object]:
    """A row as JSON, its named tuples with their names."""
    plain: dict[str, object] = {"suite": row.suite, "row": row.name, "cpu": row.cpu}
    for kind in ("filtered", "smoothed"):
        j: TrackStatistics = getattr(row, kind)
        plain[kind] = j._asdict() | {
            "error": j.error._asdict(),
            "more": getattr(row.more, kind)._asdict(),
            "lost_more": getattr(row.lost_more, kind)._asdict(),
        }
    return plain
