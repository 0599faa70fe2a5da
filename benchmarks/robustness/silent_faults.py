"""Faults of files that users report, drawn at random: whether angles stay right, frames are marked hard, or the file is
refused. Angles that are wrong in frames called tracked are noted where a warning speaks of it, else silent."""

from __future__ import annotations

import tempfile
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from rich.table import Table

from benchmarks.robustness import keypoint_faults, point_faults, source_faults
from benchmarks.robustness.fault_verdicts import VERDICTS, Outcome, outcome_of
from benchmarks.robustness.floor_scenes import Scene, scenes
from benchmarks.robustness.place_faults import name_of
from benchmarks.support.common import Json, Several, captured_folder, save
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

SUBJECT, FRAMES = "human34", 30
Kind = Literal["points", "keypoints", "sources"]
Kinds = Annotated[tuple[Kind, ...], Several]
KINDS: tuple[Kind, ...] = ("points", "keypoints", "sources")
_TRIALS = {
    "points": (point_faults.FAULTS, point_faults.trial),
    "keypoints": (keypoint_faults.FAULTS, keypoint_faults.trial),
    "sources": (source_faults.FAULTS, source_faults.trial),
}


def main(*, runs: int = 300, kinds: Kinds = KINDS, data: Path | None = None, seed: int = 0, out: Json = None) -> None:
    """Print how many runs of faulty files are right, hard, refused, noted or silent.

    Parameters
    ----------
    runs
        How many faults are drawn, of all kinds together.
    kinds
        What the files are of: points in space, keypoints of one to three cameras, sources of `retarget`.
    data
        The evaluation data with `mocap` and `mocap_more`; made scenes alone without it.
    seed
        Of scenes, noise and faults.
    out
        A file for the figures.
    """
    body, outcomes = Body(load_subject(SUBJECT)), list[Outcome]()
    known = list(scenes(body, captured_folder(data)))
    for k, kind in enumerate(kinds):
        rng = np.random.default_rng((seed, 9, KINDS.index(kind)))
        own = [draw(body, known, kind, i, rng) for i in range(len(range(k, runs, len(kinds))))]
        report.console().print(_table(kind, own))
        outcomes += own
    for o in outcomes:
        if o.verdict == "silent":
            print(f"silent: {o.fault} of {o.of} in {o.scene}: {o.error:.1f} degrees, {o.faultless:.1f} without")
    save(out, {"outcomes": [o._asdict() for o in outcomes]})


def draw(body: Body, known: Sequence[Scene], kind: Kind, turn: int, rng: np.random.Generator) -> Outcome:
    """A fault in one of the scenes, beside the scene without it; faults of a kind take turns."""
    scene, (faults, trial) = known[int(rng.integers(len(known)))], _TRIALS[kind]
    first = int(rng.integers(0, len(scene.q) - FRAMES)) if len(scene.q) > FRAMES else 0
    fault = faults[turn % len(faults)]
    tried = trial(body, scene.q[first : first + FRAMES], fault, rng)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return outcome_of(tried, name_of(fault), scene.name, Path(folder))


def _table(kind: Kind, outcomes: Sequence[Outcome]) -> Table:
    """The number of verdicts of each kind, fault by fault."""
    table = report.table(f"faults of {kind}, drawn at random", "fault", *VERDICTS)
    for fault in sorted({o.fault for o in outcomes}):
        counts = Counter(o.verdict for o in outcomes if o.fault == fault)
        table.add_row(fault, *(str(counts[verdict]) for verdict in VERDICTS))
    every = Counter(o.verdict for o in outcomes)
    table.add_row("all", *(str(every[verdict]) for verdict in VERDICTS))
    return table
