"""Motions of persons on robots: limits, collisions, standing feet and likeness of ours and of peers'."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from threadpoolctl import threadpool_limits

from benchmarks.retargeting.independence import measured_independence
from benchmarks.retargeting.methods import METHODS, FollowedMotion, standing_floor
from benchmarks.retargeting.pace import measured_pace
from benchmarks.retargeting.trials import ASAP, CAPTURED, G1, RetargetTrial, trials_of
from benchmarks.support.common import Data, Json, Several, check_known, data_folder, save, tell
from estimator.retargeting.metrics import RetargetMeter, RetargetMetrics
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.terminal import report

Flag = Annotated[bool, Parameter(negative="")]
TALOS = "example-robot-data:talos"
CLIPS = (*ASAP, *CAPTURED)
_SECONDS = "seconds"
_COLUMNS: dict[str, tuple[tuple[str, float, str], ...]] = {  # column: figures, factors and formats of mean and worst
    "limits": (("over_limits", 100.0, "{:.0f}%"), ("furthest_over", 1.0, "{:.3f}")),
    "speed": (("too_fast", 100.0, "{:.0f}%"), ("speed_ratio", 1.0, "{:.2f}")),
    "collision": (("colliding", 100.0, "{:.0f}%"), ("overlap", 1e3, "{:.1f}")),
    "below": (("below_floor", 100.0, "{:.0f}%"), ("deepest", 1e3, "{:.1f}")),
    "slip": (("median_slip", 1e3, "{:.0f}"), ("slip", 1e3, "{:.0f}")),
    "penetr.": (("penetrating", 100.0, "{:.0f}%"),),
    "skating": (("skating", 100.0, "{:.0f}%"),),
    "contact": (("near", 100.0, "{:.0f}%"),),
    "limbs": (("limb_angle", 1.0, "{:.1f}"), ("worst_limb_angle", 1.0, "{:.0f}")),
    "root": (("root_rms", 100.0, "{:.1f}"), ("root_worst", 100.0, "{:.1f}")),
    "acc.": (("acceleration", 1.0, "{:.1f}"),),
    "ms": ((_SECONDS, 1e3, "{:.1f}"),),
}
_WORST = ("furthest_over", "speed_ratio", "overlap", "deepest", "slip", "worst_limb_angle", "root_worst")
LEGEND = (
    "limits: frames with a joint beyond its position limit, furthest [rad]; speed: steps faster than a velocity limit,"
    " largest ratio; collision: frames with parts over 1 mm in each other, deepest [mm]; below: frames with parts over"
    " 5 mm under the floor, deepest [mm]; slip: of points of the soles while the source's stand, median and largest of"
    " a stance [mm]. OmniRetarget's: frames below the floor, standing points over 1 cm in 1/30 s, within 2 cm of the"
    " floor. limbs: mean and largest angle from the source's [deg]; root: RMS and largest distance from the scaled path"
    " [cm]; acc.: RMS of joints [rad/s^2]; ms: processor time of a frame. Means over clips, of the second numbers the"
    " worst. Peers stand on the floor that suits each motion best: under nine tenths of what is to stand.",
)


def main(
    *,
    clips: Annotated[tuple[str, ...], Several] = CLIPS,
    robots: Annotated[tuple[str, ...], Several] = (G1, TALOS),
    methods: Annotated[tuple[str, ...], Several] = tuple(METHODS),
    seconds: float = 60.0,
    independence: Flag = False,
    speed: Flag = False,
    data: Data = None,
    json: Json = None,
) -> None:
    """Follow motions of persons by robots and measure what becomes of them.

    Parameters
    ----------
    clips
        The motions.
    robots
        Subjects that follow them.
    methods
        ours; asap: the peer's own motions of G1, where there are some; pink: inverse kinematics frame by frame.
    seconds
        Of each clip, from its beginning.
    independence
        Measure instead how much ours depends on the frame and the pose that it begins with.
    speed
        Measure instead how many frames a second ours makes, by processor time of one core.
    """
    check_known("--clips", clips, CLIPS)
    check_known("--methods", methods, METHODS)
    folder = data_folder(data)
    if folder is None:
        remedy = "--data DIR or KINEMODE_DATA names the folder that has asap, mocap and mocap_more"
        raise InputError("data", "the evaluation data is not here", remedy=remedy)
    trials = trials_of(folder, clips, seconds)
    figures: dict[str, Any] = {"measure": "retarget", _SECONDS: seconds}
    with threadpool_limits(limits=1):
        for robot in robots:
            body = Body(load_subject(robot))
            if independence or speed:
                figures[robot] = measured_ours(body, trials, independence=independence, speed=speed)
                continue
            figures[robot] = rows = measured_rows(body, robot, trials, methods)
            show(robot, rows)
    if not (independence or speed):
        report.print_lines(LEGEND)
    save(json, figures)


def measured_ours(
    body: Body, trials: Sequence[RetargetTrial], *, independence: bool, speed: bool
) -> dict[str, dict[str, Any]]:
    """Independence of the beginning, and speed, by clip, of the requested measures."""
    figures = dict[str, dict[str, Any]]()
    if independence:
        figures["independence"] = measured_independence(body, trials)
    if speed:
        figures["speed"] = measured_pace(body, trials)
    return figures


def measured_rows(
    body: Body, robot: str, trials: Sequence[RetargetTrial], methods: Sequence[str]
) -> dict[str, dict[str, dict[str, float]]]:
    """Figures by method and clip."""
    meter, rows = RetargetMeter(body), dict[str, dict[str, dict[str, float]]]()
    for method in methods:
        for trial in trials:
            motion = METHODS[method](body, robot, trial)
            if motion is None:
                continue
            rows.setdefault(method, {})[trial.name] = figures_of(meter, trial, motion)
            tell(f"{robot}, {method}, {trial.name}" + (f": {motion.note}" if motion.note else ""))
        if method not in rows:
            tell(f"{robot}: {method} has no motion of it")
    return rows


def figures_of(meter: RetargetMeter, trial: RetargetTrial, motion: FollowedMotion) -> dict[str, float]:
    """Those of `RetargetMetrics`, and the time of a frame [s]."""
    floor = standing_floor(meter.body, motion.q, trial.contacts) if motion.floor is None else motion.floor
    metrics = meter.metrics(
        motion.q, trial.source.times, source=trial.source, contacts=trial.contacts, floor=floor, scale=motion.scale
    )
    return {**metrics._asdict(), _SECONDS: motion.seconds}


def show(robot: str, rows: dict[str, dict[str, dict[str, float]]]) -> None:
    """A line of each method over all clips, then each clip's."""
    shared = [name for name in CLIPS if rows and all(name in of for of in rows.values())]
    made = report.table(f"{robot}: clips together", "method, clips", *_COLUMNS)
    for method, by_clip in rows.items():
        for what, names in (("all", list(by_clip)), ("those of every method", shared)):
            if names and (what == "all" or len(names) < len(by_clip)):
                figures = together([by_clip[name] for name in names])
                made.add_row(f"{method}, {len(names)}", *_cells(figures))
    report.console().print(made)
    made = report.table(f"{robot}: clip by clip", "clip, method", *_COLUMNS)
    for name in CLIPS:
        for method, by_clip in rows.items():
            if name in by_clip:
                made.add_row(f"{name}, {method}", *_cells(by_clip[name]))
    report.console().print(made)


def together(figures: Sequence[dict[str, float]]) -> dict[str, float]:
    """Means, and the worst of the worst; of those that are known."""
    combined = {}
    for key in (*RetargetMetrics._fields, _SECONDS):
        known = [of[key] for of in figures if np.isfinite(of[key])]
        combine = np.max if key in _WORST else np.mean
        combined[key] = float(combine(known)) if known else float("nan")
    return combined


def _cells(figures: dict[str, float]) -> list[str]:
    return [" ".join(form.format(by * figures[key]) for key, by, form in of) for of in _COLUMNS.values()]
