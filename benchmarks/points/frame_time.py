"""Processor time of a frame of markers: one hypothesis, in sequence, without smoothing and files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.points.tracked_points import TRACKER
from benchmarks.support.stopwatch import Stopwatch
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import CompiledSeeker
from estimator.energy.descent.qp import ProxQP
from estimator.runs.run_reader import Run
from estimator.search.frame_search import FrameSearch
from estimator.search.mode_search import ModeSearch
from estimator.tracking.registry import make_tracker, settings_for
from humanoid.kinematics.body import Body
from kinemode.terminal import report

TARGET_MS = 1.0
PARTS: dict[str, list[tuple[type, str]]] = {
    "poses, in Python": [(Body, "at")],
    "searches, compiled": [(CompiledSeeker, "seek")],
    "ProxQP": [(ProxQP, "multipliers"), (ProxQP, "multipliers_of_few"), (ProxQP, "sharper")],
    "other evaluations": [(Cost, "of"), (Cost, "values")],
    "hypotheses: covariance, certificate": [(FrameSearch, "explore"), (FrameSearch, "refine")],
    "mixture, weights": [(ModeSearch, "mixture")],
}
REST = "all else"
_WARM_UP = 20  # frames
_REPEATS = 5


def stepped(body: Body, observations: Sequence[Observation], seed: int = 0) -> Iterator[float]:
    """Processor time [s] of every frame after the first."""
    tracker = make_tracker(TRACKER, body, settings_for(TRACKER, modes=1))
    rng = np.random.default_rng(seed)
    with threadpool_limits(limits=1):
        state, _ = tracker.init(rng, observations[0])
        for observation in observations[1:]:
            begin = process_time()
            state, _ = tracker.step(rng, state, observation)
            yield process_time() - begin


def seconds_of_frames(run: Run, seed: int = 0) -> np.ndarray:
    """Processor time [s] of a run's frames, tracked again with one hypothesis; the first has none."""
    measured = run.markers
    assert measured is not None
    observations = [replace(run.observation(i), markers=measured[i]) for i in run.index]
    return np.array([np.nan, *stepped(run.body, observations, seed)])


def measure_frame_time(body: Body, observations: Sequence[Observation], seed: int) -> dict[str, Any]:
    """Times of a trial: of a step, of its parts, and of one evaluation of kinematics and Jacobians."""
    list(stepped(body, observations[: _WARM_UP + 1], seed))  # what is compiled is loaded
    times = 1e3 * np.array([list(stepped(body, observations, seed)) for _ in range(_REPEATS)])
    middle = np.median(times, axis=0)
    figures = {
        "markers": len(body.marker_names), "frames": times.shape[1], "median_ms": float(np.median(middle)),
        "mean_ms": float(middle.mean()), "floor_ms": _floor(body), "parts_ms": _parts(body, observations, seed),
    }  # fmt: skip
    _show(figures)
    return figures


def _floor(body: Body, count: int = 2000) -> float:
    """The time of one pose with its Jacobians [ms]."""
    begin = process_time()
    for _ in range(count):
        body.at(body.neutral)
    return 1e3 * (process_time() - begin) / count


def _parts(body: Body, observations: Sequence[Observation], seed: int) -> dict[str, float]:
    """Each without those inside it [ms a frame]; the watch itself adds to them."""
    watch = Stopwatch()
    with watch.installed(PARTS):
        times = list(stepped(body, observations, seed))
    spent = {part: 1e3 * watch.seconds[part] / len(times) for part in PARTS}
    return {**spent, REST: 1e3 * float(np.mean(times)) - sum(spent.values())}


def _show(figures: dict[str, Any]) -> None:
    made = report.table(f"a frame of {figures['markers']} markers, one hypothesis", "processor time", "ms")
    for name, key in (("median", "median_ms"), ("mean", "mean_ms"), ("one pose with Jacobians", "floor_ms")):
        made.add_row(name, f"{figures[key]:.3f}")
    made.add_row("target", f"{TARGET_MS:.1f}")
    made.add_section()
    for part, ms in figures["parts_ms"].items():
        made.add_row(f"{part}, as timed", f"{ms:.3f}")
    report.console().print(made)
