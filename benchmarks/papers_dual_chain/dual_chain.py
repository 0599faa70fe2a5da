"""The dual-chain tracker against likelihood sampling and CONDENSATION, on three rendered clips of an upper body.

    python -m benchmarks dual_chain [--seeds 0 1 2 3 4] [--jobs 2] [--work FOLDER] [--recover] [--json FILE]

All weigh poses by the same blobs, outlines and silhouette, start from the same keypoints of the first frame, and differ
in where poses come from: dual-chain(1000), and (2000) as it is set, dual-chain-paper(1000), likelihood sampling
beside points as printed, likelihood-sampling(1000) without points and past, CONDENSATION with 5,000 and 15,000 whole
poses from the past; then all in the time of the first. The other ways are the first without one of its parts: without
points, with limbs that are neither drawn from the image nor updated towards it, without samples that look for limbs
elsewhere, without detections of several features, with these measured anew in every frame. A seed is one of the clip
(clothes, boards, noise) and of the tracker. Arms move out of the image plane, cross before the body and the face; one
clip is of 10 s.
"""

from __future__ import annotations

import json as json_module
import multiprocessing
import resource
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_dual_chain.dual_chain_recovery import Recovery, show_recovery
from benchmarks.papers_dual_chain.dual_chain_runs import ChainRun, Film, UpperClip, tracked
from benchmarks.support.common import Json, Several, Work, check_known, in_processes, save, tell, work_folder
from benchmarks.support.result_store import Figures, ResultStore, all_done
from kinemode.terminal import report

FRAMES = {"talk": 250, "reach_out": 160, "cross_arms": 160}
LOST = 250.0  # mm
DUAL, AS_SET = "dual-chain(1000)", "dual-chain(2000)"
SAMPLING, TEMPERED = "likelihood-sampling(1000)", "likelihood-sampling(1000), by powers"
AS_PRINTED = "dual-chain-paper(1000)"
CONDENSATION = "condensation({})"
NO_POINTS, BY_PAST = "dual-chain(1000), no chain of points", "dual-chain(1000), limbs from the past"
NO_SEARCH, NO_SHARING = "dual-chain(1000), no search for limbs", "dual-chain(1000), no shared detections"
ANEW = "dual-chain(1000), shared detections anew in every frame"
_THOUSAND: dict[str, Any] = {"particles": 1000}
_SAMPLING: dict[str, Any] = {"chain": False, "past": False, "pose": {**_THOUSAND, "tempering": {"powers": 1}}}


def condensation(particles: int) -> dict[str, Any]:
    """Settings of so many poses from the past."""
    return {"chain": False, "pose": {"draws": "past", "particles": particles}}


WAYS: dict[str, dict[str, Any]] = {
    DUAL: {"pose": _THOUSAND},
    AS_SET: {},
    AS_PRINTED: {**_SAMPLING, "chain": True, "exchange": "printed"},
    SAMPLING: _SAMPLING,
    TEMPERED: {"chain": False, "past": False, "pose": _THOUSAND},
    CONDENSATION.format(5000): condensation(5000),
    CONDENSATION.format(15000): condensation(15000),
    NO_POINTS: {"chain": False, "pose": _THOUSAND},
    BY_PAST: {"pose": {**_THOUSAND, "by_past": 1.0, "by_image": 0.0}},
    NO_SEARCH: {"pose": {**_THOUSAND, "lost": 0.0}},
    NO_SHARING: {"pose": _THOUSAND, "evidence": {"shared": 0.0}},
    ANEW: {"pose": _THOUSAND, "evidence": {"inside": 0.0}},
}
_TIMED = 8  # frames


def main(
    *,
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2, 3, 4),
    motions: Annotated[tuple[str, ...], Several] = tuple(FRAMES),
    ways: Annotated[tuple[str, ...], Several] = tuple(WAYS),
    frames: int | None = None,
    equal_time: bool = True,
    recover: bool = False,
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Render, track, compare.

    Parameters
    ----------
    seeds
        Of the clips and of the trackers.
    motions
        The clips' motions.
    ways
        The trackers.
    frames
        So many of each clip instead of all.
    equal_time
        The others also with as many samples as take the time of the first.
    recover
        Instead set poses wrong by 1 rad in every joint of the arms, and measure the time to recover.
    jobs
        So many runs at a time.
    """
    check_known("--motions", motions, FRAMES)
    check_known("--ways", ways, WAYS)
    with work_folder(work) as folder:
        store = ResultStore(folder)
        clips = [UpperClip(motion, seed) for seed in seeds for motion in motions]
        in_processes(_render, [(clip, folder) for clip in clips], jobs)
        if recover:
            pieces = [Recovery(clip, clip.seed, way, _text(WAYS[way])) for clip in clips for way in ways]
            show_recovery(pieces, all_done("recovery", store, pieces, jobs), ways, json)
            return
        chosen = {way: WAYS[way] for way in ways}
        if equal_time:
            chosen |= in_equal_time(store, clips[0], ways)
        runs = [
            ChainRun(clip, min(frames or FRAMES[clip.motion], FRAMES[clip.motion]), clip.seed, way, _text(settings))
            for clip in clips
            for way, settings in chosen.items()
        ]
        results = all_done("runs", store, runs, jobs)
        rows = show(runs, results, list(chosen))
        peak = _in_new_process(_peak_memory, clips[0], folder) if CONDENSATION.format(15000) in ways else float("nan")
        print(f"condensation(15000) peaks at {peak:.0f} MB with everything it loads")
        save(json, {"measure": "dual_chain", "seeds": seeds, "rows": rows, "peak_mb": peak})


def _text(settings: dict[str, Any]) -> str:
    return json_module.dumps(settings, sort_keys=True)


def _render(task: tuple[UpperClip, Path]) -> None:
    clip, folder = task
    clip.files(folder)


def in_equal_time(store: ResultStore, clip: UpperClip, ways: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The other ways with as many samples as take the time of dual-chain(1000)."""
    counts, made = store.of(EqualTime(clip)), dict[str, dict[str, Any]]()
    if CONDENSATION.format(5000) in ways:
        count = counts["condensation"]
        made[CONDENSATION.format(count) + " in equal time"] = condensation(count)
    if SAMPLING in ways:
        count = counts["sampling"]
        made[f"likelihood-sampling({count}) in equal time"] = _sampling(count)
    return made


@dataclass(frozen=True)
class EqualTime:
    """The number of samples that take the time of dual-chain(1000) on the first frames of a clip: time goes up with the
    number on a straight line, through two numbers. Measured once for a folder, so that a resumed measure compares the
    same."""

    clip: UpperClip

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return "equal_time"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {"measure": self.name, **asdict(self)}

    def work(self, store: ResultStore) -> Figures:
        """Numbers of samples: condensation, sampling."""
        film = Film(self.clip.files(store.folder))
        target = _seconds(film, WAYS[DUAL])
        return {
            "condensation": _count(target, film, 5000, 15000, condensation),
            "sampling": _count(target, film, 1000, 2000, _sampling),
        }


def _sampling(particles: int) -> dict[str, Any]:
    return {**_SAMPLING, "pose": {**_SAMPLING["pose"], "particles": particles}}


def _count(target: float, film: Film, low: int, high: int, settings: Any) -> int:
    few, many = (_seconds(film, settings(n)) for n in (low, high))
    count = low + (target - few) * (high - low) / max(many - few, 1e-3)
    tell(f"{target:.2f} s: {low} take {few:.2f}, {high} take {many:.2f} s")
    return max(100, int(round(count, -2)))


def _seconds(film: Film, settings: dict[str, Any]) -> float:
    """Processor time per frame, median."""
    return float(np.median([s for _, r, s in tracked(film, settings, _TIMED, 0) if r.index > 1]))


def _in_new_process(work: Any, *arguments: Any) -> Any:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def _peak_memory(clip: UpperClip, folder: Path) -> float:
    """Peak memory of CONDENSATION with 15,000 poses [MB], a few frames in a process of its own."""
    for _ in tracked(Film(clip.files(folder)), condensation(15000), 5, 0):
        pass
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def figures(results: Sequence[Figures]) -> dict[str, float]:
    """The figures of several runs: means over frames, and counts of frames."""

    def all_of(name: str) -> np.ndarray:
        return np.concatenate([np.asarray(r[name], dtype=float) for r in results])

    return {
        "expected": float(all_of("expected").mean()),
        "of_mean": float(all_of("of_mean").mean()),
        "lost": float((all_of("expected") > LOST).sum()),
        "none": float((all_of("samples") == 0.0).sum()),
        "distinct": float(all_of("distinct").mean()),
        "apart": float(all_of("apart").mean()),
        "seconds": float(np.median(all_of("seconds"))),
    }


def show(runs: Sequence[ChainRun], results: Sequence[Figures], ways: Sequence[str]) -> list[dict[str, Any]]:
    """A row a way and clip, and a row of all; deviations are over seeds."""
    table = report.table(
        "arm joints in the world [mm]", "way", "clip", "expected", "of the mean", "lost", "without samples",
        "distinct of 40", "10 mm apart", "s a frame",
    )  # fmt: skip
    seeds = sorted({run.seed for run in runs})
    motions = list(dict.fromkeys(run.clip.motion for run in runs))
    rows = []
    for way in ways:
        for motion in (*motions, "all"):
            mine = [
                [r for run, r in zip(runs, results, strict=True)
                 if run.label == way and run.seed == seed and motion in (run.clip.motion, "all")]
                for seed in seeds
            ]  # fmt: skip
            each = [figures(results_of) for results_of in mine]
            row: dict[str, Any] = {"way": way, "clip": motion}
            row |= {name: float(np.mean([f[name] for f in each])) for name in each[0]}
            row |= {f"{name}_std": float(np.std([f[name] for f in each])) for name in ("expected", "of_mean")}
            rows.append(row)
            table.add_row(
                way if motion == motions[0] else "", motion,
                f"{row['expected']:.1f} ± {row['expected_std']:.1f}",
                f"{row['of_mean']:.1f} ± {row['of_mean_std']:.1f}",
                f"{row['lost']:.1f}", f"{row['none']:.1f}", f"{row['distinct']:.1f}", f"{row['apart']:.1f}",
                f"{row['seconds']:.2f}",
            )  # fmt: skip
    report.console().print(table)
    return rows
