"""People of several builds who stand, walk, squat, rise and jump, as seen by virtual rigs: the joint angles are those
of a laboratory's people, the keypoints have the three errors of a detector."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kinemode as km
from benchmarks.accuracy.trunk_view_clips import FPS, phone_before
from benchmarks.support.result_store import Figures, ResultStore, removed
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.runs.run_reader import Run
from estimator.synthesis.detector import correlated_noise
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.keypoint_places import with_layout_places
from humanoid.subject.landmarks import COCO17, FORMATS
from humanoid.subject.subject import load_subject

RIGS: dict[str, tuple[float, ...]] = {
    "front": (0.0,), "aside": (45.0,), "side": (90.0,), "two": (-30.0, 30.0), "three": (-60.0, 0.0, 60.0),
    "four": (-135.0, -45.0, 45.0, 135.0),
}  # fmt: skip
"""Azimuths [deg] of the phones, 0 before the person, 90 at the left."""
WINDOWS: tuple[tuple[str, float, float], ...] = (
    ("opencap/subject4/static1", 0.5, 2.0), ("opencap/subject4/squats1", 0.0, 3.0),
    ("opencap/subject4/squats1", 6.0, 3.0), ("opencap/subject4/STS1", 1.0, 3.0),
    ("opencap/subject4/walking1", 0.0, 1.3), ("forces/another/walking2", 0.0, 1.3),
    ("forces/another/DJ4", 0.0, 2.6), ("forces/light/walking1", 0.0, 1.4),
)  # fmt: skip
"""Trials of a laboratory, and where in them a window of so many seconds begins: standing, squats, rising from a chair,
walks, a jump from a box."""
LAYOUT = "mediapipe33"
NAMES = (*COCO17, "left_heel", "right_heel", "left_big_toe", "right_big_toe")
ON_BODY, OF_VIEW, LASTING, FRAME, LAST = 0.010, 0.011, 0.010, 0.006, 0.3
"""Standard deviations [m] of a keypoint's place on the body, of its place in one view, of what lasts so long [s], and
of a frame: in the mean those of MediaPipe on two phone films, drawn independently for every person, and but for the
first for every camera."""
JOINTS = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion", "elbow_flexion")
STANDS = 12.0  # deg: of both knees
_BUILD, _CONFIDENCE, _EVERY = 0.04, 0.9, 5


class FilmedMotion(NamedTuple):
    """body: of the person. q (T, nq). cameras (C) and their keypoints."""

    body: Body
    q: np.ndarray
    cameras: tuple[Camera, ...]
    tracks: tuple[KeypointTrack, ...]


@dataclass(frozen=True)
class BendRun:
    """A piece of work: one window by one rig.

    trial: file of poses (`q`, (T, nq) at `time`, (T,)), see `benchmarks.accuracy.bends`. label: of the window. start,
    seconds [s]: of it. rig: one of `RIGS`. seed: of the person, the errors and the tracker. changes: to the settings,
    as JSON.
    """

    trial: Path
    label: str
    start: float
    seconds: float
    rig: str
    seed: int
    changes: str = "{}"

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.label.replace('/', '_')}_{self.start:g}_{self.rig}_{self.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {
            "bend": self.label, "start": self.start, "seconds": self.seconds, "rig": self.rig, "seed": self.seed,
            "settings": self.changes,
        }  # fmt: skip

    def work(self, store: ResultStore) -> Figures:
        """See `bend_errors`."""
        filmed = self.filmed()
        out, cameras = store.scratch(self, ".run"), store.scratch(self, "_cameras.json")
        files = {track.source: store.scratch(self, f"_{track.source}.json") for track in filmed.tracks}
        for track in filmed.tracks:
            write_keypoints(files[track.source], track, names=_labels())
        known: dict[str, Any] = {"focal": "0.7"}
        if len(filmed.cameras) > 1:
            write_cameras(cameras, filmed.cameras)
            known = {"cameras": cameras}
        run = km.track(
            "human34", keypoints=files if len(files) > 1 else next(iter(files.values())), cues="off", seed=self.seed,
            out=out, overwrite=True, settings=json.loads(self.changes), **known,
        )  # fmt: skip
        figures = bend_errors(run, filmed.q)
        removed(out)
        for path in (cameras, *files.values()):
            path.unlink(missing_ok=True)
        return figures

    def filmed(self) -> FilmedMotion:
        """The person, drawn by the seed and the trial, and what the rig sees."""
        rng = np.random.default_rng([self.seed, *self.label.encode(), round(10 * self.start)])
        subject = with_layout_places(load_subject("human34"), LAYOUT)
        proportions = ProportionedBody(subject)
        scales = proportions.mean * (1.0 + _BUILD * rng.normal()) + proportions.std * rng.normal(
            size=len(proportions.mean)
        )
        scales = np.clip(scales, proportions.low, proportions.high)
        body, q = Body(subject.scaled(proportions.scales(scales))), self._window()
        index = [body.landmark_names.index(name) for name in NAMES]
        offsets = (body.keypoint_local - body.landmark_local)[index] + ON_BODY * rng.normal(size=(len(NAMES), 3))
        posed = [body.at(pose) for pose in q]
        points = np.array([body.landmarks(p)[index] for p in posed])
        turns = np.array([p.rotations[body.landmark_joint[index]] for p in posed])
        marked = points + np.einsum("tnij,nj->tni", turns, offsets)
        cameras, tracks = [], []
        for c, camera in enumerate(self._cameras(points)):
            errors = _errors(np.random.default_rng((self.seed, c, len(q))), len(q))
            pixels = camera.project(marked + errors @ camera.R_camera_world[:2])
            cameras.append(replace(camera, name=f"phone{c + 1}"))
            tracks.append(_track(pixels, cameras[-1]))
        return FilmedMotion(body, q, tuple(cameras), tuple(tracks))

    def _window(self) -> np.ndarray:
        with np.load(self.trial) as stored:
            time, q = stored["time"] - stored["time"][0], stored["q"]
        at = np.arange(self.start, min(self.start + self.seconds, time[-1]), 1.0 / FPS)
        return np.asarray(q[np.round(np.interp(at, time, np.arange(len(time)))).astype(int)])

    def _cameras(self, points: np.ndarray) -> list[Camera]:
        left, right = (points[:, NAMES.index(f"{side}_hip")] for side in ("left", "right"))
        forward = np.cross(left - right, [0.0, 0.0, 1.0]).mean(axis=0)
        return [phone_before(left[:, :2], forward, azimuth) for azimuth in RIGS[self.rig]]


def bend_errors(run: Run, truth: np.ndarray) -> Figures:
    """By joint, both sides: `errors` [deg] of the smoothed trajectory in each frame; `levels`, of every fifth, the
    probability below the truth by the run's posterior. `stands`: frames in which both knees are straight."""
    body, q = run.body, truth[run.index]
    errors, levels = dict[str, list[float]](), dict[str, list[float]]()
    names = [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]
    place = {name: body.model.getJointId(name) for name in names}
    for name in names:
        i = body.model.idx_qs[place[name]]
        errors[name] = np.degrees(run.q[:, i] - q[:, i]).tolist()
        levels[name] = []
    for t in range(0, len(run), _EVERY):
        posterior = run.posterior(t)
        below = posterior.marginals().cdf(body.difference(posterior.best, q[t]))
        for name in names:
            levels[name].append(float(below[body.model.idx_vs[place[name]]]))
    knees = q[:, [body.model.idx_qs[place[f"{side}_knee_flexion"]] for side in ("left", "right")]]
    stands = (np.degrees(knees) < STANDS).all(axis=1)
    return {"errors": errors, "levels": levels, "stands": stands.tolist(), "every": _EVERY}


def _errors(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Of a camera's keypoints (T, N, 2) [m], along its picture's axes at the person."""
    shape = (frames, len(NAMES), 2)
    lasting = correlated_noise(rng, shape, float(np.exp(-1.0 / (FPS * LAST))))
    return np.asarray(OF_VIEW * rng.normal(size=shape[1:]) + LASTING * lasting + FRAME * rng.normal(size=shape))


def _track(pixels: np.ndarray, camera: Camera) -> KeypointTrack:
    """Keypoints (T, N, 2) of `NAMES` as a file of MediaPipe's layout has them."""
    layout = FORMATS[LAYOUT]
    every, confidence = np.full((len(pixels), len(layout), 2), np.nan), np.zeros((len(pixels), len(layout)))
    for k, name in enumerate(layout):
        if name in NAMES:
            every[:, k], confidence[:, k] = pixels[:, NAMES.index(name)], _CONFIDENCE
    return KeypointTrack(
        layout=LAYOUT, names=tuple(_labels()), pixels=every, confidence=confidence, image_size=camera.image_size,
        fps=FPS, source=camera.name,
    )  # fmt: skip


def _labels() -> tuple[str, ...]:
    return tuple(name or f"keypoint_{k}" for k, name in enumerate(FORMATS[LAYOUT]))
