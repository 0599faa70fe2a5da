"""Events of captured walks and runs from landmarks with noise, against the same landmarks without."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.accuracy.gait_events import COLUMNS, KINDS, WAYS, EventErrors, events_by
from benchmarks.accuracy.unseen_clips import action_of
from benchmarks.support.mocap_person import FPS
from benchmarks.support.pose_prior_clips import captured_files
from estimator.inference.contacts import FootPoints
from estimator.runs.contact import Contact
from estimator.runs.events import Event
from estimator.synthesis.detector import correlated_noise
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

ACTIONS = ("walk", "run")
NOISE = 0.01  # m, along each axis
LASTS = 0.3  # s, correlation time of the noise
_LONGEST = 10.0  # s of a clip
_MORE_EDGE = 0.05  # s: noise may move events over the edge that gait keeps to
_UP = np.array([0.0, 0.0, 1.0])
LEGEND = (
    f"{1e3 * NOISE:.0f} mm of noise along each axis that lasts {LASTS:g} s, at {FPS:g} frames/s. gait: as km.gait has"
    " them; of contact, pelvis: by that alone. The truth is the same without noise."
)

Errors = dict[tuple[str, str], EventErrors]


def captured_errors(motion: Path, seeds: Sequence[int]) -> Errors:
    """The errors of a clip retargeted to human34, by way and kind of event."""
    body, mocap = Body(load_subject("human34")), load_mocap(motion)
    time = np.arange(0.0, min(mocap.seconds, _LONGEST) - 1e-6, 1.0 / FPS)
    points = body.landmarks_of(body.placed(retarget(body, mocap, time).q))
    truth, span = _events(body, time, points), (time[0] + _MORE_EDGE, time[-1] - _MORE_EDGE)
    several = [_events(body, time, points + lasting(points.shape, np.random.default_rng(seed))) for seed in seeds]
    return {
        (way, kind): EventErrors.joined([EventErrors.of(told[way], truth[way], kind, span) for told in several])
        for way in WAYS
        for kind in KINDS
    }


def lasting(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Noise [m] along the first axis, time: of the first order, `NOISE` in every frame."""
    return NOISE * correlated_noise(rng, shape, float(np.exp(-1.0 / (LASTS * FPS))))


def _events(body: Body, time: np.ndarray, points: np.ndarray) -> dict[str, list[Event]]:
    feet = FootPoints.of(body)
    assert feet is not None  # human34 has them
    own = points[:, feet.landmark]
    standing, floor, _ = feet.contact(own, time, _UP, None)
    contact = Contact(time, feet.names, own, standing, floor, np.ones(len(feet.names)))
    return events_by(contact, points[:, body.landmark_names.index("mid_hip")])


def print_captured(data: Path | None, seeds: Sequence[int], figures: dict[str, dict[str, object]]) -> None:
    """A table of every action, kind and way; nothing where the captured motion is not here."""
    files = [path for path in captured_files(data) if action_of(path.stem) in ACTIONS]
    of_clip = {path.stem: captured_errors(path, seeds) for path in files}
    table = report.table(f"events of {len(files)} captured clips", "action, kind, source", *COLUMNS)
    for action in ACTIONS:
        clips = [errors for name, errors in of_clip.items() if action_of(name) == action]
        for kind in KINDS if clips else ():
            for way in WAYS:
                errors = EventErrors.joined([of[way, kind] for of in clips])
                table.add_row(f"{action}, {kind}, {way}", *errors.cells())
                figures[f"captured {action} {kind} {way}"] = {
                    "events": len(errors.off), "within": errors.within, "extra": errors.extra,
                }  # fmt: skip
        table.add_section()
    report.console().print(table)
    report.print_lines([LEGEND])
