"""Loose-limbed people on captured motion before four cameras: tracking, the annealed filter, start and recovery.

    python -m benchmarks loose_limbed --walk --annealed --start --recovery [--seeds 0 1 2 ...] [--jobs 2] [--work DIR]

Sigal et al. 2004, section 6 and Figures 6 to 8. Error: mean of 15 markers, expected absolute distance, nothing aligned.
"""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from benchmarks.papers_loose_limbed.loose_limbed_duel import write_duel
from benchmarks.papers_loose_limbed.loose_limbed_rival import LAYERS, PARTICLES, learned_noise
from benchmarks.papers_loose_limbed.loose_limbed_runs import LimbRun, clip_of
from benchmarks.support.common import Data, Json, Several, Work, captured_folder, check_known, save, work_folder
from benchmarks.support.result_store import Figures, ResultStore, all_done
from estimator.synthesis.limb_templates import train_templates
from estimator.trackers.loose_limbed.part_detectors.templates import save_templates
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

WALK, TURN, PUNCH = "walk_straight_07_01", "walk_turn_26_01", "punch_02_05"
BEGIN, END = 11, 70  # frames of the walk that are tracked
LOST = 250.0  # mm
NOTHING_LEFT: dict[str, Any] = {"assembly": {"left_over": 0.0}}
ALONE: dict[str, Any] = {"part_detectors": {"by_hull": False}, **NOTHING_LEFT}
AS_PRINTED: dict[str, Any] = {"propagation": {"product": {"image_weighted": False}}, "tied": 0.0, **ALONE}
WALKS: dict[str, dict[str, Any]] = {
    "part detectors": {},
    "no search in what is left over": NOTHING_LEFT,
    "no part detectors": ALONE,
    "no part detectors, smoothing": ALONE | {"smoothing": True},
    "as printed, past fixed": AS_PRINTED,
    "as printed": AS_PRINTED | {"smoothing": True},
    "as printed but for part detectors": AS_PRINTED | {"smoothing": True},
}
TEMPLATES = ("as printed, past fixed", "as printed")  # with the paper's part detectors
PARTS = ("head", "left_upper_arm", "left_shank")  # that have them, with those of the other side
STARTS = {WALK: (11, 20, 29, 38, 47, 56, 65), TURN: (10, 25, 40, 55, 70, 85, 100), PUNCH: (10, 30, 50, 70, 90, 110)}
FEW = 3  # seeds of secondary figures
BESIDE = ("no part detectors, smoothing", "as printed but for part detectors")
BLANK = (20, 21, 22, 23, 24)
RECOVERY_END = 35
Flag = Annotated[bool, Parameter(negative="")]


def main(
    *,
    walk: Flag = False,
    annealed: Flag = False,
    start: Flag = False,
    recovery: Flag = False,
    ways: Annotated[tuple[str, ...], Several] = tuple(WALKS),
    seeds: Annotated[tuple[int, ...], Several] = tuple(range(10)),
    jobs: int = 1,
    data: Data = None,
    work: Work = None,
    json: Json = None,
    figure: Path | None = None,
) -> None:
    """Run the requested measures.

    Parameters
    ----------
    walk
        Track walk_straight_07_01 from its true first pose, pictures alone: with part detectors, without, and as
        printed, by eigen-templates of head, upper arms and shanks, the frame before inferred again or fixed.
    annealed
        The annealed particle filter on the same likelihood from the same pose, also in as much time, and both with
        clothes of the wall's colour.
    start
        First frames of three clips, without any pose.
    recovery
        Five blank frames.
    ways
        Of --walk.
    seeds
        Of the trackers.
    jobs
        Runs at a time, each in a process of its own.
    figure
        Also draw the errors of --walk and --annealed over the frames here (Figure 8, right).
    """
    check_known("--ways", ways, WALKS)
    folder = captured_folder(data)
    if folder is None:
        return
    files = {name: str(folder / "mocap" / f"{name}.bvh") for name in (WALK, TURN, PUNCH)}
    figures: dict[str, Any] = {}
    with work_folder(work) as store_folder:
        store = ResultStore(store_folder)
        noise = str(store_folder / "noise.npy")
        if annealed or recovery:
            learned_noise(Body(load_subject("human34")), data, store_folder)
        if walk:
            runs = {label: walks(files[WALK], label, seeds, store_folder) for label in ways}
            figures["walk"] = _done("walk", store, runs, jobs)
            show_tracks("walk_straight_07_01, normal contrast", figures["walk"])
        if annealed:
            figures["annealed"] = _done("annealed", store, duels(files[WALK], noise, seeds), jobs)
            show_tracks("walk_straight_07_01 beside the annealed filter", figures["annealed"])
        if start:
            figures["start"] = _done("start", store, starts(files), jobs)
            show_starts(figures["start"])
        if recovery:
            figures["recovery"] = _done("recovery", store, recoveries(files[WALK], noise, seeds), jobs)
            show_recovery(figures["recovery"])
    save(json, {"measure": "loose-limbed", **figures})
    if figure is not None:
        loose = {"loose-limbed, normal contrast": figures["walk"]["part detectors"]} if walk else {}
        write_duel(figure, loose | figures.get("annealed", {}))


def walks(path: str, label: str, seeds: Sequence[int], folder: Path) -> list[LimbRun]:
    """The walk by the tracker with the settings of a label of WALKS; some of the ways a few times only."""
    file = ""
    if label in TEMPLATES:
        file = templates_of(path, folder)
    few = FEW if label in BESIDE else len(seeds)
    settings = json_module.dumps(WALKS[label])
    return [LimbRun(path, BEGIN, END, s, label, settings=settings, templates=file) for s in seeds[:few]]


def templates_of(path: str, folder: Path) -> str:
    """The file of the paper's part detectors for the cameras of a motion, trained unless it is there."""
    file = folder / f"templates_{Path(path).stem}.npz"
    if not file.is_file():
        clip = clip_of(path, LimbRun.clip_seed, END + 2, False, LimbRun.cameras)
        save_templates(train_templates(clip.body.subject, clip.renderer.cameras, limbs=PARTS), file)
    return str(file)


def duels(path: str, noise: str, seeds: Sequence[int]) -> dict[str, list[LimbRun]]:
    """Both trackers in low contrast, and the annealed filter in normal contrast; also, a few times, with as many
    particles as fill the time of the loose-limbed tracker."""
    equal = PARTICLES * 12
    runs: dict[str, list[LimbRun]] = {}
    for low in (False, True):
        text = "low contrast" if low else "normal contrast"
        for size in (PARTICLES, equal):
            label = f"annealed {LAYERS} x {size}, {text}"
            runs[label] = [
                LimbRun(path, BEGIN, END, s, label, low_contrast=low, noise=noise, particles=size)
                for s in (seeds if size == PARTICLES else seeds[:FEW])
            ]
        if low:
            label = f"loose-limbed, {text}"
            runs[label] = [LimbRun(path, BEGIN, END, s, label, low_contrast=True) for s in seeds]
    return runs


def starts(files: Mapping[str, str]) -> dict[str, list[LimbRun]]:
    """A first frame each, using two frames; with keypoints, too."""
    return {
        label: [
            LimbRun(files[name], frame, frame, 0, label, start="nothing", detected=detected)
            for name, frames in STARTS.items()
            for frame in frames
        ]
        for label, detected in (("pictures", False), ("pictures and keypoints", True))
    }


def recoveries(path: str, noise: str, seeds: Sequence[int]) -> dict[str, list[LimbRun]]:
    """Recoveries with and without part detectors, and of the annealed filter."""
    runs = {
        label: [
            LimbRun(path, BEGIN, RECOVERY_END, s, label, blank=BLANK, settings=json_module.dumps(changes))
            for s in seeds
        ]
        for label, changes in (("recovery, part detectors", {}), ("recovery, no part detectors", ALONE))
    }
    label = f"recovery, annealed {LAYERS} x {PARTICLES}"
    runs[label] = [
        LimbRun(path, BEGIN, RECOVERY_END, s, label, blank=BLANK, noise=noise, particles=PARTICLES) for s in seeds
    ]
    return runs


def _done(label: str, store: ResultStore, runs: Mapping[str, Sequence[LimbRun]], jobs: int) -> dict[str, list[Figures]]:
    every = all_done(label, store, [run for of in runs.values() for run in of], jobs)
    results = iter(every)
    return {name: [next(results) for _ in of] for name, of in runs.items()}


def show_tracks(title: str, figures: Mapping[str, Sequence[Figures]]) -> None:
    """Errors over frames and seeds."""
    made = report.table(f"{title}: mm", "tracker", "beliefs", "by likelihood", "assembled", "expected", "worst frame",
                        "frames 4 to 13", "last ten", "lost from", "s a frame")  # fmt: skip
    for label, runs in figures.items():
        loose = "beliefs" in runs[0]
        own = np.array([r["beliefs"] if loose else r["expected"] for r in runs], dtype=float)
        best, expected = (np.array([r[key] for r in runs], dtype=float) for key in ("assembled", "expected"))
        likely = np.array([r["likely"] for r in runs], dtype=float) if loose else best
        lost = [
            next((r["frame"][k] for k, e in enumerate(x) if e > LOST), None) for r, x in zip(runs, own, strict=True)
        ]
        made.add_row(
            label, *((mean_and_std(own), mean_and_std(likely)) if loose else ("", "")), mean_and_std(best),
            mean_and_std(expected),
            f"{np.nanmax(own):.0f}, {np.nanmax(best):.0f}", f"{np.nanmean(own[:, 3:13]):.1f}",
            f"{np.nanmean(own[:, -10:]):.1f}", ", ".join("-" if f is None else str(f) for f in lost),
            f"{np.mean([r['seconds'][1:] for r in runs]):.2f}",
        )  # fmt: skip
    out = report.console()
    out.width = max(out.width, 170)
    out.print(made)
    out.print("mean over frames, and standard deviation of that over seeds; worst frame: of beliefs or expected, best")


def mean_and_std(errors: np.ndarray) -> str:
    """Mean and deviation of the seeds' means, errors (seeds, frames)."""
    means = np.nanmean(errors, axis=1)
    return f"{means.mean():.1f} +- {means.std(ddof=1) if len(means) > 1 else 0.0:.1f}"


def show_starts(figures: Mapping[str, Sequence[Figures]]) -> None:
    """First frames."""
    made = report.table("first frames, no pose given: mm", "from", "frames", "beliefs", "assembled", "at most 80",
                        "at most 40", "sides right", "worst", "s")  # fmt: skip
    for label, runs in figures.items():
        own, best = (np.array([r[key][0] for r in runs], dtype=float) for key in ("beliefs", "assembled"))
        made.add_row(
            label, str(len(runs)), f"{np.median(own):.1f}", f"{np.median(best):.1f}", str(int((best <= 80.0).sum())),
            str(int((best <= 40.0).sum())), str(sum(bool(r["sides"][0]) for r in runs)), f"{best.max():.0f}",
            f"{np.mean([r['seconds'][0] for r in runs]):.1f}",
        )  # fmt: skip
    report.console().print(made)


def show_recovery(figures: Mapping[str, Sequence[Figures]]) -> None:
    """Print the time until the error returns to that before the blank frames."""
    made = report.table("five blank frames", "tracker", "before [mm]", "first after [mm]", "back in 5 frames", "frames")
    for label, runs in figures.items():
        key = "assembled" if "beliefs" in runs[0] else "expected"
        before, first, needed = [], [], []
        for r in runs:
            error = np.array(r[key], dtype=float)
            shown = dict(zip(r["frame"], error, strict=True))
            usual = np.mean([shown[f] for f in range(BLANK[0] - 8, BLANK[0])])
            after = [shown[f] for f in range(BLANK[-1] + 1, RECOVERY_END + 1)]
            before.append(usual)
            first.append(after[0])
            needed.append(next((k + 1 for k, e in enumerate(after) if e <= 1.2 * usual), None))
        back = sum(n is not None and n <= 5 for n in needed)
        made.add_row(label, f"{np.mean(before):.1f}", f"{np.mean(first):.1f}", f"{back} of {len(runs)}",
                     ", ".join("-" if n is None else str(n) for n in needed))  # fmt: skip
    report.console().print(made)
