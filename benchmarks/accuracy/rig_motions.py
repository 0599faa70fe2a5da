"""Motions before two phones from which their cameras can be found: by the angle between them, the motion, and
how long it is filmed.

Errors are those of `rigs`: of the second camera's rotation against the first, and of its place, after the scale that
suits best, in % of the first one's distance to the person. The predicted deviation of the place has its distance
besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.rig_clips import FPS
from benchmarks.accuracy.rig_motion_clips import MOTIONS, FilmedMotion
from benchmarks.accuracy.rig_motions_picture import TrialColumn, write_motions_picture
from benchmarks.accuracy.rigs import RigOutcome, RigTrial
from benchmarks.support.common import Json, in_processes, save, spread, tell
from humanoid.support.errors import InputError
from kinemode.terminal import report

SEEDS = 5
LATE = (0.2, 1.0)  # s: delay of the second camera where clocks are found
PARTS: dict[str, dict[str, FilmedMotion]] = {
    "angle between the cameras [deg]": {f"{a}": FilmedMotion(angle=a) for a in (10, 20, 40, 60, 90, 120, 150, 170)},
    "motion, 90 degrees apart": {kind.name: FilmedMotion(motion=kind) for kind in MOTIONS},
    "seconds filmed, 90 degrees apart": {f"{t}": FilmedMotion(seconds=t) for t in (3, 5, 10, 20, 40)},
}
ANGLES, MOTION, SECONDS = PARTS


@dataclass(frozen=True)
class MotionTrial:
    """A trial of one setting and seed. known: with clocks that are known. late: with an undeclared delay of a camera;
    None where that is not tried."""

    known: RigOutcome
    late: RigOutcome | None

    @property
    def clock(self) -> str:
        """The outcome for the clocks."""
        if self.late is None:
            return ""
        if self.late.refusal:
            return "refused"
        return "found" if self.late.clock * FPS <= 1.0 else "wrong"


def trial_of(task: tuple[FilmedMotion, bool, int]) -> MotionTrial:
    """The trial of a setting, whether clocks are found as well, and a seed."""
    filmed, both, seed = task
    clip, late = filmed.clip(seed), None
    known = RigTrial.of(clip, clip.name, clocks_known=True).outcome()
    if both:
        lag = round(FPS * np.random.default_rng((seed, 47)).uniform(*LATE))
        late = RigTrial.of(clip.begun_later(np.array([0, lag])), clip.name, clocks_known=False).outcome()
    tell(f"{filmed.angle:g} degrees, {clip.name}, {filmed.seconds:g} s, {seed}: {known.seconds:.1f} s")
    return MotionTrial(known, late)


def column_of(label: str, trials: Sequence[MotionTrial]) -> TrialColumn:
    """The column of a setting in the picture."""
    placed = [trial.known for trial in trials if not trial.known.refusal]
    turns, stds = ([value for o in placed for value in of(o)] for of in (lambda o: o.turns, lambda o: o.turn_stds))
    return TrialColumn(label, tuple(turns), tuple(stds), len(trials) - len(placed))


def cells(label: str, trials: Sequence[MotionTrial]) -> list[str]:
    """The table cells of a setting."""
    placed = [trial.known for trial in trials if not trial.known.refusal]
    columns = [[float(*getattr(o, name)) for o in placed] for name in ("turns", "turn_stds", "places", "place_stds")]
    clocks = [trial.clock for trial in trials]
    counts = [f"{clocks.count(kind)} {kind}" for kind in ("found", "refused", "wrong") if kind in clocks]
    unsure = sum(not outcome.sure for outcome in placed)
    figures = [spread(column) if column else "-" for column in columns]
    return [label, *figures, f"{unsure}", f"{len(trials) - len(placed)}", ", ".join(counts)]


def show(part: str, rows: dict[str, list[MotionTrial]]) -> None:
    """A table of a part."""
    heads = ("rotation [deg]", "predicted", "place [%]", "predicted", "unsure", "refused", "clocks")
    table = report.table("median (range)", part, *heads)
    for label, trials in rows.items():
        table.add_row(*cells(label, trials))
    report.console().print(table)


def measured(parts: Sequence[str], seeds: int, jobs: int) -> dict[str, dict[str, list[MotionTrial]]]:
    """Trials by part and setting; a setting that is in several parts is tried once."""
    late = {filmed for part in parts if part != ANGLES for filmed in PARTS[part].values()}
    settings = dict.fromkeys(filmed for part in parts for filmed in PARTS[part].values())
    tasks = [(filmed, filmed in late, seed) for filmed in settings for seed in range(seeds)]
    done = iter(in_processes(trial_of, tasks, jobs))
    by_setting = {filmed: [next(done) for _ in range(seeds)] for filmed in settings}
    return {part: {label: by_setting[filmed] for label, filmed in PARTS[part].items()} for part in parts}


def main(
    *,
    angles: bool = False,
    motions: bool = False,
    seconds: bool = False,
    seeds: int = SEEDS,
    jobs: int = 1,
    picture: Path | None = None,
    json: Json = None,
) -> None:
    """Print errors of two phones that are placed by a person, and their reported uncertainty; all three parts unless
    some are chosen.

    Parameters
    ----------
    angles
        10 to 170 degrees between the cameras, 20 s of walking to and fro, across, with arms that are lifted.
    motions
        90 degrees, 20 s: the same, walking straight, jumping, standing; clocks known, and clocks found.
    seconds
        90 degrees, the walk: 3 to 40 s; clocks known, and clocks found.
    seeds
        Persons, each with other lengths, lenses and noise.
    jobs
        Trials at a time, each in a process of its own.
    picture
        PNG to write: rotation errors and predicted deviations.
    """
    if seeds < 1:
        raise InputError("--seeds", f"is {seeds}", remedy="1 or more")
    chosen = [part for part, is_chosen in zip(PARTS, (angles, motions, seconds), strict=True) if is_chosen]
    rows = measured(chosen or list(PARTS), seeds, jobs)
    for part, by_label in rows.items():
        show(part, by_label)
    if picture is not None:
        columns = {part: [column_of(*of) for of in by_label.items()] for part, by_label in rows.items()}
        write_motions_picture(columns, picture)
        print(f"picture: {picture}")
    ratios = [
        turn / max(std, 1e-3)
        for trials in {id(t): t for by in rows.values() for t in by.values()}.values()
        for trial in trials
        for turn, std in zip(trial.known.turns, trial.known.turn_stds, strict=True)
    ]
    rms = float(np.sqrt(np.mean(np.square(ratios)))) if ratios else np.nan
    report.print_lines([f"rotation error over predicted deviation, root mean square: {rms:.2f}"])
    content: dict[str, Any] = {p: {k: [asdict(t) for t in of] for k, of in by.items()} for p, by in rows.items()}
    save(json, {"measure": "rig_motions", "how": {"seeds": seeds}, "ratio": rms, "parts": content})
