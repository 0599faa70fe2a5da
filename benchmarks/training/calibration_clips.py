"""Clips with known truth for the calibration: bodies, motions, cameras and keypoint errors of many kinds, tracked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.support.common import data_folder
from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.data.sequence import assemble
from estimator.fitting.person import fit_person
from estimator.runs.posterior import Posterior, PosteriorCalibration
from estimator.synthesis import detector
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import motion_named
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.trackers.base import capabilities_of
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from estimator.tracking.smoothing import Smoothed, smooth_track
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import COCO17, landmark_spread
from humanoid.subject.subject import Subject, load_subject, subject_from_text
from humanoid.support.errors import InputError

AUTHORED = ("reach", "turn_reach")
TRAINING = ("walk_turn_26_01", "dance_05_10", "bend_scoop_lift_02_06", "wave_hello_fair1", "turn_reach")
HELD_OUT = ("walk_straight_07_01", "run_02_03", "jump_16_01", "arms_high_05_12", "punch_02_05", "reach")
STABILISED_BY = (
    "walk_turn_26_01", "dance_05_10", "bend_scoop_lift_02_06", "wave_hello_fair1", "walk_straight_07_01", "run_02_03",
    "jump_16_01", "arms_high_05_12", "punch_02_05",
)  # fmt: skip
"""The captured motions that the stabilisers' rests and deviations were set by, with beam4cam: held out from fitting the
calibration is not unseen."""
UNSEEN = ("cmu_08_03", "cmu_10_04", "cmu_12_03", "cmu_35_20", "cmu_49_03", "cmu_49_09")
"""Captured motions, of mocap_more, of people none of whose motions set anything."""
FPS = 30.0
_STATURE_STD, _LENGTH_STD = 0.03, 0.03  # of the bodies drawn, as ratios


LASTING = {"bias": 0.015, "correlation": 0.25, "reach": 0.25}
"""A detector's errors that many frames do not average out: bias [m] of every landmark of a person; time [s] in which
and distance [m] over which the noise is alike."""


@dataclass(frozen=True)
class Condition:
    """cameras: how many. noise_px, outliers, missing: see `estimator.synthesis.settings.DetectorSettings`."""

    cameras: int
    noise_px: float
    outliers: float = 0.01
    missing: float = 0.02

    @property
    def name(self) -> str:
        """The displayed name."""
        plural = "s" if self.cameras > 1 else ""
        return f"{self.cameras} camera{plural}, {self.noise_px:g} px, {100 * self.outliers:g} % outliers"


CONDITIONS = (
    Condition(1, 1.5),
    Condition(1, 3.0),
    Condition(1, 6.0, 0.05, 0.1),
    Condition(2, 3.0),
    Condition(2, 6.0, 0.05, 0.1),
    Condition(4, 3.0),
)


@dataclass(frozen=True)
class Task:
    """One clip to make and to track.

    motion: a BVH file, or the name of an authored motion. seconds, every: so much of it, and so many-th frames are
    used. known_body, known_noise: the tracker is given the body's lengths, else fits them, and the true standard
    deviation of every keypoint instead of its own estimate. lasting: the detector has the errors `LASTING`. smooth:
    the track is smoothed. changes: to the tracker's settings.
    """

    motion: Path
    condition: Condition
    seed: int
    seconds: float
    every: int = 6
    tracker: str = "css"
    known_body: bool = False
    known_noise: bool = False
    lasting: bool = True
    smooth: bool = True
    changes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def errors(self) -> DetectorSettings:
        """The errors of the detector."""
        c = self.condition
        return DetectorSettings(c.noise_px, c.outliers, c.missing, **LASTING if self.lasting else {})


@dataclass(frozen=True)
class Tracked:
    """A tracked clip, N of its frames: the tracker's results, and the true configurations (N, nq).

    smoothed: the trajectory in these frames; None where not requested. urdf: of the tracked
    body. truth_landmarks (N, L, 3) [m]: of the true one. seen_by: the only camera, where the body's
    size is not known.
    """

    motion: str
    condition: Condition
    urdf: str
    results: tuple[FrameResult, ...]
    smoothed: Smoothed | None
    truth: np.ndarray
    truth_landmarks: np.ndarray
    seen_by: Sequence[Camera]

    def posterior(self, body: Body, i: int, calibration: PosteriorCalibration) -> Posterior:
        """The posterior of the i-th used frame, around the smoothed trajectory where there is one."""
        if self.smoothed is None:
            return Posterior.of(body, self.results[i], calibration, self.seen_by)
        return Posterior.of_trajectory(body, self.results[i], self.smoothed, i, calibration, self.seen_by)

    def tracked_body(self) -> Body:
        """The body that was tracked, built again, as objects sent between processes must not carry one."""
        return Body(subject_from_text(self.urdf, source=self.motion, base="free"))


def motions(data: Path | None, names: Sequence[str]) -> list[Path]:
    """Files of the captured motions and names of the authored ones; without the data only the latter."""
    folder = data_folder(data)
    files = []
    for name in names:
        kept = "mocap_more" if name in UNSEEN else "mocap"
        file = Path(name) if name in AUTHORED or folder is None else folder / kept / f"{name}.bvh"
        if name in AUTHORED or file.is_file():
            files.append(file)
        elif folder is not None:
            raise InputError(file, "no such motion", remedy=f"--data DIR or KINEMODE_DATA names the folder with {kept}")
    return files


def tracked(task: Task) -> Tracked:
    """Make the clip's keypoints, track and, on request, smooth them."""
    rng = np.random.default_rng((task.seed, task.condition.cameras, round(10 * task.condition.noise_px)))
    body = Body(person(rng))
    q, times = _motion(body, task)
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    view = ViewSettings(count=task.condition.cameras, azimuth=float(rng.uniform(-180.0, 180.0)))
    cameras = framing_cameras(points, view)
    observations = _observed(body, q, times, cameras, task.errors, rng)
    subject = body.subject if task.known_body else fit_person(load_subject("human34"), observations).subject
    settings = settings_for(task.tracker, changes=task.changes)
    if task.known_noise:
        noise = _true_noise(observations, task.condition)
        settings = replace(settings, cost=replace(settings.cost, keypoint_noise=noise, keypoint_place=0.0))
        observations = [replace(o, jitter=()) for o in observations]
    tracker = make_tracker(task.tracker, Body(subject), settings)
    results = [result for result, _ in run(tracker, observations, task.seed)]
    chosen = [t for t in range(task.every // 2, len(q), task.every) if len(results[t].weight)]
    seen_by = cameras if len(cameras) == 1 and not task.known_body else []
    kept = tuple(results[t] for t in chosen)
    smoothed, energy = None, capabilities_of(tracker).energy
    if task.smooth and energy is not None:
        smoothed = smooth_track(energy, observations, results, settings.smooth).frames(chosen)
    return Tracked(task.motion.stem, task.condition, subject.urdf, kept, smoothed, q[chosen], points[chosen], seen_by)


def _true_noise(observations: Sequence[Observation], condition: Condition) -> float:
    """`CostSettings.keypoint_noise` that gives keypoints the standard deviations they were made with."""
    extents = np.concatenate([o.extents for o in observations])
    shoulder = condition.noise_px * landmark_spread(("left_shoulder",))[0] / landmark_spread(COCO17).mean()
    return float(shoulder / np.median(extents))


def person(rng: np.random.Generator) -> Subject:
    """human34 with another stature, and other lengths for it."""
    subject = load_subject("human34")
    stature = np.exp(_STATURE_STD * rng.normal())
    scales = stature * np.exp(_LENGTH_STD * rng.normal(size=len(subject.proportions)))
    return subject.scaled({p.joint: float(s) for p, s in zip(subject.proportions, scales, strict=True)})


def _motion(body: Body, task: Task) -> tuple[np.ndarray, np.ndarray]:
    if task.motion.name in AUTHORED:
        keyed = motion_named(task.motion.name)
        times = np.arange(round(FPS * min(task.seconds, keyed.seconds))) / FPS
        return authored_motion(body, times, keyed), times
    mocap = load_mocap(task.motion)
    times = np.arange(round(FPS * min(task.seconds, mocap.seconds))) / FPS
    return retarget(body, mocap, times).q, times


def _observed(
    body: Body,
    q: np.ndarray,
    times: np.ndarray,
    cameras: Sequence[Camera],
    errors: DetectorSettings,
    rng: np.random.Generator,
) -> list[Observation]:
    tracks = detector.keypoints(body, q, cameras, rng, errors, fps=FPS)
    names = [camera.name for camera in cameras]
    return assemble(body, dict(zip(names, tracks, strict=True)), dict(zip(names, cameras, strict=True)), times)
