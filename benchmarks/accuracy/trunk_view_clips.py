"""Bending people as seen by a virtual phone: joint centres of a laboratory or of motion capture, projected exactly,
with white noise, or with a detector's errors; tracked, and how the trunk was read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kinemode as km
from benchmarks.accuracy.degrees import bands, columns_of, tabled
from benchmarks.support.result_store import Figures, ResultStore, removed
from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.numerics.stretches import stretches
from estimator.numerics.vectors import angle_between, unit
from estimator.retargeting.joint_arrays import load_joints
from estimator.runs.coordinate_errors import wrapped_degrees
from estimator.runs.run_reader import Run
from estimator.synthesis.detector import correlated_noise
from estimator.synthesis.mocap import load_mocap
from humanoid.subject.landmarks import without_side

EXACT, NOISE, DETECTOR = KINDS = ("exact", "noise", "detector")
"""Noise of keypoints: exact, with 3 px of white noise, or with errors as large as MediaPipe's on two phone films: a
place on the body that is constant for a person, an error that lasts 0.3 s, and a frame's."""
FPS = 30.0
DISTANCE, HEIGHT, FOCAL = 3.5, 1.2, 0.7  # m, m, of the longer side
SIZE = (720, 1280)
_NOISE_PX = 3.0
_CONSTANT, _LASTING, _FRAME, _LAST = 0.015, 0.01, 0.006, 0.3  # m, m, m, s: standard deviations and how long
_BELOW = {"heel": 0.035, "big_toe": 0.05}  # m: where a detector has these in the mean
_LIMBS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
_FAR, _FOR = 15.0, 0.3  # deg to the wrong side, for so many seconds
_LEG = 0.83  # m: thigh and shank of an adult
_SETTLED = 8.0  # deg: a trunk that leans less may be reported as square to the rays
_DEEP = 0.025  # m: depth of the shoulders beyond the hips from which a trunk has a reading


class Seen(NamedTuple):
    """Joint centres of a person. names (J). points (T, J, 3) [m]: world with z up. time (T,) [s]."""

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray

    def of(self, name: str) -> np.ndarray:
        """The points (T, 3) of a name, or the middle of its two sides."""
        if name in self.names:
            return self.points[:, self.names.index(name)]
        return 0.5 * (self.of(f"left_{name}") + self.of(f"right_{name}"))

    @property
    def trunk(self) -> np.ndarray:
        """From the hips to the shoulders (T, 3) [m]."""
        return self.of("shoulder") - self.of("hip")

    @property
    def forward(self) -> np.ndarray:
        """Where the hips face (T, 3), level unit vectors."""
        across = self.of("left_hip") - self.of("right_hip")
        forward = np.cross(across, [0.0, 0.0, 1.0])
        return np.asarray(forward / np.linalg.norm(forward, axis=1, keepdims=True))

    def cut(self, start: float, seconds: float) -> Seen:
        """Some seconds of it, at `FPS`."""
        time = np.arange(start, min(start + seconds, self.time[-1]), 1.0 / FPS)
        flat = self.points.reshape(len(self.points), -1)
        points = np.stack([np.interp(time, self.time, x) for x in flat.T], axis=1)
        return Seen(self.names, points.reshape(len(time), -1, 3), time - time[0])


def seen_person(path: Path) -> Seen:
    """The person of a BVH file, of SMPL's joints in an npz file, whose person is made as large as an adult, or of a
    folder with OpenCap's truth."""
    if path.is_dir():
        column = columns_of(path / "truth.csv.gz")
        names = {f"{s}_{j}": f"{s}_{j}" for s in ("left", "right") for j in (*_LIMBS, "heel")}
        names |= {f"{s}_toe": f"{s}_big_toe" for s in ("left", "right")}
        points = np.stack([np.stack([column[f"{n}_{a}"] for a in "xyz"], axis=1) for n in names], axis=1)
        return Seen(tuple(names.values()), points, column["time"] - column["time"][0])
    if path.suffix == ".npz":
        source = load_joints(path, up="z")
        known = [name for name in source.names if name not in ("neck", "head")]
        seen = Seen(tuple(known), source.points[:, [source.names.index(name) for name in known]], source.times)
        legs = [seen.of(f"left_{a}") - seen.of(f"left_{b}") for a, b in (("hip", "knee"), ("knee", "ankle"))]
        return seen._replace(points=_LEG / np.linalg.norm(legs, axis=2).sum(axis=0).mean() * seen.points)
    mocap = load_mocap(path)
    names = {f"{s}_{j}": f"{s}_{j}" for s in ("left", "right") for j in _LIMBS}
    names |= {"left_toe": "left_big_toe", "right_toe": "right_big_toe", "head_top": "head_top"}
    index = [mocap.names.index(name) for name in names]
    return Seen(tuple(names.values()), mocap.points[:, index], np.arange(len(mocap.points)) / mocap.fps)


@dataclass(frozen=True)
class ViewRun:
    """A piece of work: a person seen from one side.

    source: see `seen_person`. start, seconds [s]: of it. azimuth [deg]: of the phone, 0 before the person, 90 at the
    left. kind: one of `KINDS`. changes: to the settings, as JSON.
    """

    source: Path
    start: float
    seconds: float
    azimuth: float
    kind: str
    seed: int
    changes: str = "{}"

    @property
    def name(self) -> str:
        """See `benchmarks.support.result_store.Piece`."""
        return f"{self.source.stem}_{self.start:g}_{self.azimuth:g}_{self.kind}_{self.seed}"

    @property
    def what(self) -> Mapping[str, Any]:
        """See `benchmarks.support.result_store.Piece`."""
        return {
            "view": self.source.stem, "start": self.start, "seconds": self.seconds, "azimuth": self.azimuth,
            "kind": self.kind, "seed": self.seed, "settings": self.changes,
        }  # fmt: skip

    def work(self, store: ResultStore) -> Figures:
        """The figures of `reading_errors`, and of a film `bands`: share of its joint angles inside the run's 90 %
        intervals."""
        truth = seen_person(self.source).cut(self.start, self.seconds)
        camera = phone(truth, self.azimuth)
        keypoints, out = store.scratch(self, ".json"), store.scratch(self, ".run")
        write_keypoints(keypoints, seen_by(truth, camera, self.kind, self.seed))
        run = km.track(
            "human34", keypoints=keypoints, focal=f"{FOCAL}", cues="off", seed=self.seed, out=out, overwrite=True,
            settings=json.loads(self.changes),
        )  # fmt: skip
        figures = reading_errors(run, truth, camera)
        if self.source.is_dir():
            known = tabled(self.source / "truth.csv.gz")
            figures["bands"] = bands(run, known._replace(time=known.time - known.time[0] - self.start))["90 %"]
        removed(out)
        keypoints.unlink()
        return figures


def phone(seen: Seen, azimuth: float) -> Camera:
    """A level phone facing the person's place in the middle of the clip."""
    return phone_before(seen.of("hip")[:, :2], seen.forward.mean(axis=0), azimuth)


def phone_before(path: np.ndarray, forward: np.ndarray, azimuth: float) -> Camera:
    """A level phone facing the middle of a path (T, 2) [m], from an azimuth [deg] about forward (3,)."""
    away = float(np.arctan2(forward[1], forward[0])) + np.radians(azimuth)
    return level_phone(path.mean(axis=0), DISTANCE + 0.5 * float(np.ptp(path, axis=0).max()), away)


def level_phone(place: np.ndarray, distance: float, azimuth: float) -> Camera:
    """One facing a place (2,) [m] from a distance [m], from a direction [rad] counted from x to y."""
    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    x = np.cross(-away, [0.0, 0.0, 1.0])
    R = np.stack([x, np.cross(-away, x), -away])
    centre = np.append(place, HEIGHT) + distance * away
    f = FOCAL * max(SIZE)
    K = np.array([[f, 0.0, (SIZE[0] - 1) / 2.0], [0.0, f, (SIZE[1] - 1) / 2.0], [0.0, 0.0, 1.0]])
    return Camera("phone", SIZE, K, np.zeros(5), R, -R @ centre)


def seen_by(seen: Seen, camera: Camera, kind: str, seed: int) -> KeypointTrack:
    """Keypoints of one of `KINDS`."""
    rng, points = np.random.default_rng((seed, 11)), seen.points
    if kind == DETECTOR:
        shape = points.shape
        constant = _CONSTANT * rng.normal(size=shape[1:])
        constant[:, 2] -= [_BELOW.get(without_side(name), 0.0) for name in seen.names]
        lasting = correlated_noise(rng, shape, float(np.exp(-1.0 / (FPS * _LAST))))
        points = points + constant + _LASTING * lasting + _FRAME * rng.normal(size=shape)
    pixels = camera.project(points)
    if kind == NOISE:
        pixels = pixels + _NOISE_PX * rng.normal(size=pixels.shape)
    return KeypointTrack(
        layout="joint centres", names=seen.names, pixels=pixels,
        confidence=np.full(pixels.shape[:2], 0.9), image_size=SIZE, fps=FPS, source="phone",
    )  # fmt: skip


def reading_errors(run: Run, truth: Seen, camera: Camera) -> Figures:
    """The errors of the smoothed trajectory, with frames' means but for `wrong`.

    lean: absolute error of the trunk's lean forwards [deg]. trunk: of its direction [deg]. hips, knees: of the angles
    that joint centres have there [deg]. wrong: longest time for which it leans over 15 degrees to the wrong side [s].
    among, best: share of frames that have the right reading among the hypotheses, and as the one that is reported;
    `online`: as the hypothesis of most weight. hard: share of frames that are.
    """
    rows, names = np.arange(len(run)), run.body.landmark_names
    known = Seen(truth.names, truth.points[rows], truth.time[rows])
    R_truth_run = camera.R_camera_world.T @ run.header.cameras[0].R_camera_world
    ours = Seen(tuple(names), run.landmarks @ R_truth_run.T, run.time)
    leans = [_lean(seen.trunk, known.forward) for seen in (ours, known)]
    wrong = (np.sign(leans[0]) != np.sign(leans[1])) & (np.abs(leans[0]) > _FAR) & (np.abs(leans[1]) < 90.0)
    right = _depth_side(known.trunk, known.of("hip"), camera)
    modes = run.mode_landmarks @ R_truth_run.T
    trunks = Seen(tuple(names), modes.reshape(-1, *modes.shape[2:]), np.zeros(0))
    there = run.header.cameras[0].origin_world @ R_truth_run.T - camera.origin_world
    sides = _depth_side(trunks.trunk, trunks.of("hip") - there, camera).reshape(modes.shape[:2])
    agrees = (sides == right[:, None]) | (right[:, None] == 0) | ((sides == 0) & (np.abs(leans[1]) < _SETTLED)[:, None])
    reported = _depth_side(ours.trunk, ours.of("hip") - there, camera)
    best = (reported == right) | (right == 0) | ((reported == 0) & (np.abs(leans[1]) < _SETTLED))
    return {
        "lean": _mean(wrapped_degrees(leans[0] - leans[1])),
        "trunk": _mean(np.degrees(angle_between(ours.trunk, known.trunk))),
        "hips": _mean([_bend(ours, s, "hip") - _bend(known, s, "hip") for s in ("left", "right")]),
        "knees": _mean([_bend(ours, s, "knee") - _bend(known, s, "knee") for s in ("left", "right")]),
        "wrong": max((after - first for first, after in stretches(wrong)), default=0) / FPS,
        "among": float(np.mean(agrees.any(axis=1))), "best": float(np.mean(best)),
        "online": float(np.mean(agrees[rows, np.nanargmax(run.mode_weight, axis=1)])),
        "hard": float(np.mean(run.status == "hard")), "most": float(np.abs(leans[1]).max()),
    }  # fmt: skip


def lean_of(seen: Seen) -> np.ndarray:
    """The forward lean of the trunk [deg], (T,)."""
    return _lean(seen.trunk, seen.forward)


def _lean(trunk: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """The forward lean of a trunk (T, 3) [deg], (T,)."""
    return np.asarray(np.degrees(np.arctan2(np.sum(trunk * forward, axis=1), trunk[:, 2])))


def _depth_side(trunk: np.ndarray, hips: np.ndarray, camera: Camera) -> np.ndarray:
    """1 where a trunk (N, 3) leads away from the camera, -1 towards it, 0 where its depth is less than `_DEEP`."""
    depth = np.sum(trunk * unit(hips - camera.origin_world), axis=1)
    return np.where(np.abs(np.nan_to_num(depth)) > _DEEP, np.sign(depth), 0.0)


def _bend(seen: Seen, side: str, joint: str) -> np.ndarray:
    """Angle (T,) [deg] of thigh and trunk, or of thigh and shank, 0 where they are in line."""
    thigh = seen.of(f"{side}_knee") - seen.of(f"{side}_hip")
    other = -seen.trunk if joint == "hip" else seen.of(f"{side}_ankle") - seen.of(f"{side}_knee")
    return np.asarray(np.degrees(angle_between(thigh, other)))


def _mean(errors: Any) -> float:
    return float(np.nanmean(np.abs(errors)))
