"""How long joints of captured people stay away from rest: the time of the setting `cost.rest_time`.

    python -m benchmarks rest_times

A joint that goes back to rest in a time T, as a process without other memory, has a correlation of exp(-lag / T) of its
distances from its rest position. People have equal weights, and so have the clips of a person.
"""

from __future__ import annotations

import numpy as np

from benchmarks.support.common import Data, Json, save
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from benchmarks.training.pose_learning import captured_motion, joints_of
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

FPS = 30.0
LAGS = (3, 8, 15)  # frames
_CLIPS = 6  # of a person
_LEAST = 60  # frames


def main(*, data: Data = None, json: Json = None) -> None:
    """Measure the times in which joints of captured people go back to rest."""
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    body = Body(load_subject("human34"))
    joints = joints_of(body)
    rests = {s.joint: s.rest for s in body.subject.stabilisers}
    rest = np.array([rests[joint] for joint in joints])
    people: dict[str, list[np.ndarray]] = {}
    for path in files:
        clips = people.setdefault(subject_of(path.stem), [])
        if len(clips) < _CLIPS:
            away = captured_motion(body, path, FPS)[1][:, -len(joints) :] - rest
            clips += [away] if len(away) >= _LEAST else []
    times = {lag: np.median([rest_times(clips, lag) for clips in people.values() if clips], axis=0) for lag in LAGS}
    table = report.table(
        "back at rest after [s], median of people", "joint", *(f"at a lag of {lag / FPS:.2f} s" for lag in LAGS)
    )
    for k, joint in enumerate(joints):
        if not joint.startswith("right_"):
            table.add_row(without_side(joint), *(f"{own[k]:.2f}" for own in times.values()))
    for label, share in (("lower quartile", 0.25), ("median", 0.5), ("upper quartile", 0.75)):
        table.add_row(label, *(f"{np.quantile(own, share):.2f}" for own in times.values()))
    report.console().print(table)
    rows = {f"{lag / FPS:.2f}": dict(zip(joints, own.tolist(), strict=True)) for lag, own in times.items()}
    save(json, {"measure": "rest_times", "people": len(people), "times": rows})


def rest_times(clips: list[np.ndarray], lag: int) -> np.ndarray:
    """Times [s] (D,) in which a person's joints go back, by the correlation of clips (T, D), distances from rest [rad],
    at a lag in frames."""
    together = np.sum([(x[:-lag] * x[lag:]).mean(axis=0) for x in clips], axis=0)
    alone = np.sum([0.5 * (np.square(x[:-lag]) + np.square(x[lag:])).mean(axis=0) for x in clips], axis=0)
    return np.asarray(-lag / FPS / np.log(np.clip(together / alone, 1e-3, 1.0 - 1e-3)))
