"""Frames a second by one core: in windows, frame by frame, and while the motion comes in; and where the time goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from time import process_time

import numpy as np

from benchmarks.retargeting.trials import RetargetTrial
from benchmarks.support.common import tell
from estimator.retargeting.correspondence import common_correspondence
from estimator.retargeting.following import best_branch, best_start, follow
from estimator.retargeting.motion import mend, problem_of
from estimator.retargeting.problem import Obstacles, RetargetSettings
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.streaming import MotionStream
from estimator.retargeting.windows import improve
from humanoid.kinematics.body import Body
from kinemode.terminal import report

PACE_LEGEND = (
    "Frames a second of processor time, the robot's model and its parts made before. in windows: all parts together;"
    " in frames: each from the one before; stream: frame by frame as it comes in. targets: contacts, targets and"
    " stances; start: the first frame; follow, windows, mend: as their modules [ms a frame].",
)
_PARTS = ("targets", "start", "follow", "windows", "mend")
_PACES = ("in windows", "in frames", "stream")


class _Stopwatch:
    """Processor time between calls."""

    def __init__(self) -> None:
        self._last = process_time()

    def seconds(self) -> float:
        """Since the call before."""
        before, self._last = self._last, process_time()
        return self._last - before


def pace_of(body: Body, source: SourceMotion) -> dict[str, float]:
    """Frames a second in windows, frame by frame and of the stream, and milliseconds a frame of each part."""
    settings, frames, seconds = RetargetSettings(), len(source.times), dict[str, float]()
    obstacles = Obstacles(body, settings, floor=True)
    watch = _Stopwatch()
    problem = problem_of(body, source, None, settings, obstacles=obstacles)
    seconds["targets"] = watch.seconds()
    start = best_start(problem, np.random.default_rng(0), settings.starts)
    seconds["start"] = watch.seconds()
    followed = best_branch(problem, start)
    seconds["follow"] = watch.seconds()
    improved = improve(problem, followed)
    seconds["windows"] = watch.seconds()
    mend(problem, improved)
    seconds["mend"] = watch.seconds()
    quick = problem_of(body, source, None, settings.frame_by_frame, obstacles=obstacles)
    mend(quick, follow(quick, best_start(quick, np.random.default_rng(0), settings.starts)).q)
    whole, without = sum(seconds.values()), watch.seconds()
    paces = dict(zip(_PACES, (frames / whole, frames / without, _stream_pace(body, source, settings)), strict=True))
    return {**paces, **{part: 1e3 * value / frames for part, value in seconds.items()}}


def _stream_pace(body: Body, source: SourceMotion, settings: RetargetSettings) -> float:
    """Frames a second after the first one that is given out."""
    match = common_correspondence(body.landmark_names, source.names)
    stream, watch, count = MotionStream(body, source.names, match, settings, look_ahead=0.2), None, 0
    for time, points in zip(source.times, source.points, strict=True):
        frame = stream.step(float(time), points)
        if watch is not None:
            count += 1
        elif frame is not None:
            watch = _Stopwatch()
    return count / watch.seconds() if watch is not None and count else float("nan")


def measured_pace(body: Body, trials: Sequence[RetargetTrial]) -> dict[str, dict[str, float]]:
    """Paces by clip, which are shown, with the ratio of all frames to all seconds."""
    beginning = trials[0].source
    pace_of(body, replace(beginning, points=beginning.points[:12], times=beginning.times[:12]))  # compiles
    rows = {}
    for trial in trials:
        rows[trial.name] = pace_of(body, trial.source)
        tell(f"speed: {trial.name}")
    made = report.table("frames a second, ms a frame", "clip", *_PACES, *(f"ms {part}" for part in _PARTS))
    counts = [len(trial.source.times) for trial in trials]
    together = {part: float(np.average([row[part] for row in rows.values()], weights=counts)) for part in _PARTS}
    together |= {p: sum(counts) / sum(n / row[p] for n, row in zip(counts, rows.values(), strict=True)) for p in _PACES}
    for name, row in [*rows.items(), ("all", together)]:
        made.add_row(name, *(f"{row[pace]:.0f}" for pace in _PACES), *(f"{row[part]:.2f}" for part in _PARTS))
    report.console().print(made)
    report.print_lines(PACE_LEGEND)
    return {**rows, "all": together}
