"""How much a robot's motion depends on where the clip begins, and on the pose that the first frame is searched from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmarks.retargeting.trials import RetargetTrial
from benchmarks.support.common import tell
from estimator.retargeting.motion import retarget_motion
from estimator.retargeting.source import SourceMotion
from humanoid.kinematics.body import Body
from kinemode.terminal import report

BEGINNINGS = (10, 20)
"""Frames from which the clip is followed, too."""
RANDOM_POSES = 2
INDEPENDENCE_LEGEND = (
    "Joint angles [deg] of the frames that both motions have, between the clip from its beginning and the same from a"
    " later frame, or searched from a random pose within the limits: RMS, largest RMS of a frame, largest.",
)


class Deviation(NamedTuple):
    """Of two motions' joint angles [deg]: RMS, the largest RMS of a frame, the largest."""

    rms: float
    worst_frame: float
    largest: float


def deviation_between(body: Body, a: np.ndarray, b: np.ndarray) -> Deviation:
    """Of configurations (T, nq), without the root."""
    angles = np.degrees([body.difference(*pair)[body.first_joint_dof :] for pair in zip(a, b, strict=True)])
    of_frames = np.sqrt(np.square(angles).mean(axis=1))
    return Deviation(float(np.sqrt(np.square(angles).mean())), float(of_frames.max()), float(np.abs(angles).max()))


def independence_of(body: Body, source: SourceMotion) -> dict[str, Deviation]:
    """The deviations of the motions that begin otherwise, by how they begin."""
    own, rng = retarget_motion(body, source).q, np.random.default_rng(0)
    deviations = {}
    for first in BEGINNINGS:
        if first < len(source.times):
            later = replace(source, points=source.points[first:], times=source.times[first:])
            deviations[f"frame {first}"] = deviation_between(body, own[first:], retarget_motion(body, later).q)
    low, high = body.lower[body.bounded_q], body.upper[body.bounded_q]
    for number in range(1, RANDOM_POSES + 1):
        pose = body.neutral.copy()
        pose[body.bounded_q] = rng.uniform(low, high)
        deviations[f"random pose {number}"] = deviation_between(body, own, retarget_motion(body, source, start=pose).q)
    return deviations


def measured_independence(body: Body, trials: Sequence[RetargetTrial]) -> dict[str, dict[str, dict[str, float]]]:
    """Deviations by clip and beginning, which are shown."""
    rows = {}
    made = report.table("independence of the beginning [deg]", "clip, beginning", "RMS", "worst frame", "largest")
    for trial in trials:
        deviations = independence_of(body, trial.source)
        rows[trial.name] = {beginning: deviation._asdict() for beginning, deviation in deviations.items()}
        for beginning, deviation in deviations.items():
            made.add_row(f"{trial.name}, {beginning}", *(f"{value:.2f}" for value in deviation))
        tell(f"independence: {trial.name}")
    report.console().print(made)
    report.print_lines(INDEPENDENCE_LEGEND)
    return rows
