"""Faults of files that users report, drawn at random: whether angles stay right, frames are marked hard, or the file is
refused. Angles that are wrong in frames called tracked are noted where a warning says what is missing, else silent."""

from __future__ import annotations

import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import kinemode as km
from benchmarks.robustness.floor_scenes import FPS, Scene, scenes
from benchmarks.support.common import Json, captured_folder, save
from estimator.runs.run_file import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.terminal import report

SUBJECT, FRAMES = "human34", 30
NOISE = 0.003  # m
RIGHT, LEAST = 1.2, 0.2  # of the faultless run's error; degrees that are none
Fault = Callable[[np.random.Generator, np.ndarray, list[str]], None]
"""Changes points (T, L, 3) [m], z up, and their names, in place."""


class Outcome(NamedTuple):
    """kind, scene: of the fault. error, faultless [degrees]: mean of the joints that something shows, in frames called
    tracked. verdict: right, hard, refused, noted or silent."""

    kind: str
    scene: str
    error: float
    faultless: float
    verdict: str


def _stretch(rng: np.random.Generator, count: int) -> slice:
    length = int(rng.integers(4, count // 2))
    first = int(rng.integers(0, count - length))
    return slice(first, first + length)


def _some(rng: np.random.Generator, names: list[str], share: float) -> np.ndarray:
    return rng.permutation(len(names))[: max(1, round(share * len(names)))]


def gap_filled(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    frames = _stretch(rng, len(points))
    for k in _some(rng, names, rng.uniform(0.02, 0.3)):
        points[frames, k] = points[frames.start, k]


def zeros(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    points[_stretch(rng, len(points)), _some(rng, names, rng.uniform(0.1, 1.0))[:, None]] = 0.0


def elsewhere_at_first(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    points[: int(rng.integers(1, 4))] += rng.normal(size=3) * rng.uniform(0.8, 3.0)


def labels_jump(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    frames, some = _stretch(rng, len(points)), _some(rng, names, rng.uniform(0.3, 0.7))
    points[frames, some[:, None]] = points[frames, rng.permutation(some)[:, None]]


def pictures_twice(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    every = int(rng.integers(2, 6))
    points[every::every] = points[every - 1 : -1 : every][: len(points[every::every])]


def legs_missing(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    points[:, [i for i, n in enumerate(names) if n.endswith(("knee", "ankle", "heel", "toe"))]] = np.nan


def sides_exchanged(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    frames, mirrored = _stretch(rng, len(points)), {"left": "right", "right": "left"}
    other = [names.index(mirrored[n.split("_")[0]] + n[n.index("_") :]) if n[:4] in ("left", "righ") else i
             for i, n in enumerate(names)]  # fmt: skip
    points[frames] = points[frames][:, other]


def millimetres(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    points *= 1e3


def point_stuck(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    for k in _some(rng, names, 0.05):
        points[:, k] = points[0, k]


def turned_over(rng: np.random.Generator, points: np.ndarray, names: list[str]) -> None:
    points[...] = points[..., rng.permutation(3)] * rng.choice([-1.0, 1.0], size=3)


FAULTS: tuple[Fault, ...] = (
    gap_filled, zeros, elsewhere_at_first, labels_jump, pictures_twice, legs_missing, sides_exchanged, millimetres,
    point_stuck, turned_over,
)  # fmt: skip


def main(*, runs: int = 300, data: Path | None = None, seed: int = 0, out: Json = None) -> None:
    """Print how many runs of faulty files by points are right, hard, refused, noted or silent.

    Parameters
    ----------
    runs
        How many faults are drawn.
    data
        The evaluation data with `mocap` and `mocap_more`; made scenes alone without it.
    seed
        Of scenes, noise and faults.
    out
        A file for the figures.
    """
    body, rng = Body(load_subject(SUBJECT)), np.random.default_rng((seed, 9))
    known = list(scenes(body, captured_folder(data)))
    outcomes = [outcome(body, known[int(rng.integers(len(known)))], FAULTS[i % len(FAULTS)], rng) for i in range(runs)]
    verdicts = ("right", "hard", "refused", "noted", "silent")
    table = report.table("faults of points, drawn at random", "fault", *verdicts)
    for fault in FAULTS:
        counts = Counter(o.verdict for o in outcomes if o.kind == fault.__name__)
        table.add_row(fault.__name__.replace("_", " "), *(str(counts[v]) for v in verdicts))
    report.console().print(table)
    for o in outcomes:
        if o.verdict == "silent":
            print(f"silent: {o.kind} in {o.scene}: {o.error:.1f} degrees, {o.faultless:.1f} without")
    save(out, {"outcomes": [o._asdict() for o in outcomes]})


def outcome(body: Body, scene: Scene, fault: Fault, rng: np.random.Generator) -> Outcome:
    """One fault in one scene, beside the scene without it."""
    first = int(rng.integers(0, len(scene.q) - FRAMES)) if len(scene.q) > FRAMES else 0
    q = scene.q[first : first + FRAMES]
    points = body.landmarks_of(body.placed(q)) + np.array([0.3, 0.2, 0.1])
    points += NOISE * rng.normal(size=points.shape)
    wrong = points.copy()
    fault(rng, wrong, list(body.landmark_names))
    sound = _tracked(points, "z")
    try:
        run = _tracked(wrong, None if fault is turned_over else "z")
    except InputError:
        return Outcome(fault.__name__, scene.name, float("nan"), _error(sound, sound, q), "refused")
    error, faultless = _error(run, run, q), _error(sound, run, q)
    right = not error > max(RIGHT * faultless, faultless + LEAST)
    hard = bool((run.status != "tracked").any())
    noted = any("taken for missing" in note for note in run.header.notes)
    verdict = ("hard" if hard else "right") if right else "noted" if noted else "silent"
    return Outcome(fault.__name__, scene.name, error, faultless, verdict)


def _tracked(points: np.ndarray, up: str | None) -> Run:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path, names = Path(folder) / "points.npz", np.array([mark.name for mark in load_subject(SUBJECT).landmarks])
        np.savez(path, points=points, names=names, fps=FPS, unit="m")
        run: Run = km.track(SUBJECT, points=path, up=up, fit="off")
    return run


def _error(run: Run, faulty: Run, q: np.ndarray) -> float:
    """Mean error [degrees] of the joints that something shows, in frames called tracked, of the faulty run."""
    trusted = np.flatnonzero((faulty.status == "tracked") & np.isfinite(faulty.q).all(axis=1))
    joints = [i for i in run.body.bounded_q if run.body.q_names[i] not in faulty.unseen_joints]
    rows = trusted if run is faulty else np.searchsorted(run.time, faulty.time[trusted])
    apart = np.abs(run.q[rows][:, joints] - q[run.index[rows]][:, joints])
    return float(np.degrees(apart.mean())) if apart.size else float("nan")
