"""People moving in controlled ways before two phones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.rig_clips import FPS, SECONDS, RigClip, detector_errors, moved_to, phone, turned
from benchmarks.training.calibration_clips import person
from estimator.synthesis import detector
from humanoid.kinematics.body import ROOT_PLACE_Q, Body

_AWAY, _HEIGHT, _AIM = (3.7, 4.3), (1.2, 1.5), 1.0  # m: cameras from the middle and above the floor; where they look
_PACE, _PAUSE = (0.8, 1.2), (0.2, 0.9)  # m/s, the mean of a leg; s, between two legs
_REACH = (0.7, 1.0)  # of how far a leg may go
_STRIDE, _SWING, _BRISK = 1.2, 22.0, 0.5  # m; degrees of the hips; m/s from which strides are whole
_TURNING, _SWAYING = 0.25, 0.6  # s: of a turn; in which a sway forgets itself
_SWAY, _SWAY_ANGLES = 0.02, 2.0  # m; degrees
_REST, _LIFT = (0.3, 2.5), (1.2, 2.0)  # s: between two lifts of an arm, and of one
_HOP, _HOPS = 0.2, (0.7, 1.2)  # m; s, from hop to hop
_SOLES = ("heel", "big_toe", "small_toe")


@dataclass(frozen=True)
class MotionKind:
    """A motion. along, across [m]: how far it goes to each side along the bisector of the cameras, and across it."""

    name: str
    along: float = 0.0
    across: float = 0.0
    lifts_arms: bool = False
    hops: bool = False


WALK = MotionKind("to and fro, across, arms", along=0.9, across=0.9, lifts_arms=True)
MOTIONS = (
    WALK,
    MotionKind("straight along the bisector", along=0.9),
    MotionKind("straight across", across=0.9),
    MotionKind("jumping in place, arms", lifts_arms=True, hops=True),
    MotionKind("standing still"),
)


@dataclass(frozen=True)
class FilmedMotion:
    """What two phones film. angle [deg]: between them, seen from the person."""

    angle: float = 90.0
    motion: MotionKind = WALK
    seconds: float = SECONDS

    def clip(self, seed: int) -> RigClip:
        """By seed, of another person each, with other lenses."""
        rng = np.random.default_rng((seed, 43))
        body = Body(person(rng))
        q = motion_of(body, self.motion, self.seconds, rng)
        points = body.landmarks_of(body.placed(q))
        half = np.radians(0.5 * self.angle)
        cameras = []
        for name, azimuth in (("a", -half), ("b", half)):
            away, height = rng.uniform(*_AWAY), rng.uniform(*_HEIGHT)
            centre = np.array([away * np.cos(azimuth), away * np.sin(azimuth), height])
            back = centre - [0.0, 0.0, _AIM]
            cameras.append(moved_to(turned(phone(name, rng), back / np.linalg.norm(back), rng), centre))
        tracks = detector.keypoints(body, q, cameras, rng, detector_errors(cameras, points), fps=FPS)
        return RigClip(self.motion.name, tuple(cameras), tuple(tracks), body, q, np.zeros(2))


def motion_of(body: Body, kind: MotionKind, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """(T, nq) of a motion, x along the bisector; with human irregularity."""
    times = np.arange(round(FPS * seconds)) / FPS
    place, yaw = _path(kind, times, rng)
    hop = _bumps(times, (0.0, 0.0), _HOPS, rng) if kind.hops else np.zeros(len(times))
    q = np.tile(body.neutral, (len(times), 1))
    for name, values in _angles(kind, times, place, hop, rng).items():
        column = body.model.idx_qs[body.model.getJointId(name)]
        low, high = body.model.lowerPositionLimit[column], body.model.upperPositionLimit[column]
        q[:, column] = np.clip(np.radians(values + _SWAY_ANGLES * _sway(rng, len(times))), low, high)
    q[:, 3:7] = Rotation.from_euler("z", yaw[:, None]).as_quat()
    q[:, ROOT_PLACE_Q] = 0.0
    points = body.landmarks_of(body.placed(q))
    soles = [i for i, name in enumerate(body.landmark_names) if name.endswith(_SOLES)]
    place = place + _SWAY * np.stack([_sway(rng, len(times)) for _ in range(2)], axis=1)
    q[:, ROOT_PLACE_Q] = np.column_stack([place, _HOP * hop - points[:, soles, 2].min(axis=1)])
    return q


def _path(kind: MotionKind, times: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 2) [m] and headings (T,) [rad] of legs from side to side, with a turn before each."""
    reach = np.array([kind.along, kind.across])
    here = reach * rng.uniform(*_REACH, 2) * rng.choice([-1.0, 1.0], 2)
    place, yaw, heading = np.tile(here, (len(times), 1)), np.zeros(len(times)), 0.0
    t = -rng.uniform(0.0, 2.0)
    while t < times[-1] and reach.any():
        sides = ((-1, 1), (1, -1), (-1, -1))[int(rng.integers(3))] if reach.all() else (-1, -1)
        there = reach * np.sign(here) * sides * rng.uniform(*_REACH, 2)
        leg, t = there - here, t + rng.uniform(*_PAUSE)
        lasts = float(np.linalg.norm(leg)) / rng.uniform(*_PACE)
        done = np.clip((times - t) / lasts, 0.0, 1.0)
        place += leg * (done**2 * (3.0 - 2.0 * done))[:, None]
        turn = (np.arctan2(leg[1], leg[0]) - heading + np.pi) % (2.0 * np.pi) - np.pi
        yaw[times >= t] += turn
        here, heading, t = there, heading + turn, t + lasts
    return place, gaussian_filter1d(yaw, _TURNING * FPS, mode="nearest")


def _bumps(
    times: np.ndarray, rest: tuple[float, float], lasting: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:  # fmt: skip
    """(T,) from 0 to 1 and back, again and again, of drawn lengths after drawn rests [s]."""
    values, t = np.zeros(len(times)), -rng.uniform(0.0, 2.0)
    while t < times[-1]:
        begin = t + rng.uniform(*rest)
        t = begin + rng.uniform(*lasting)
        values += np.sin(np.pi * np.clip((times - begin) / (t - begin), 0.0, 1.0)) ** 2
    return values


def _sway(rng: np.random.Generator, count: int) -> np.ndarray:
    """Noise (count,) of deviation 1 that changes slowly."""
    wide = round(_SWAYING * FPS)
    noise = gaussian_filter1d(rng.normal(size=count + 8 * wide), wide)[4 * wide : count + 4 * wide]
    return np.asarray(noise * np.sqrt(2.0 * np.sqrt(np.pi) * wide))


def _angles(
    kind: MotionKind, times: np.ndarray, place: np.ndarray, hop: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:  # fmt: skip
    """Of the joints (T,) [deg], without sway: legs keep the feet nearly where they stand along places (T, 2) [m]."""
    speed = np.linalg.norm(np.gradient(place, 1.0 / FPS, axis=0), axis=1)
    step = 2.0 * np.pi * np.cumsum(speed) / FPS / _STRIDE + rng.uniform(0.0, 2.0 * np.pi)
    size, crouch = np.minimum(1.0, speed / _BRISK), 1.0 - hop if kind.hops else hop
    angles = {name: np.zeros(len(times)) for name in ("lumbar_flexion", "lumbar_axial", "neck_flexion", "neck_axial")}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = sign * size * np.arcsin(0.97 * np.sin(step)) / np.arcsin(0.97)
        lift = _bumps(times, _REST, _LIFT, rng) if kind.lifts_arms else np.zeros(len(times))
        angles |= {
            f"{side}_hip_flexion": 6.0 + _SWING * swing + 30.0 * crouch,
            f"{side}_hip_abduction": np.full(len(times), 4.0),
            f"{side}_knee_flexion": 8.0 + 50.0 * size * np.maximum(0.0, sign * np.cos(step)) ** 2 + 55.0 * crouch,
            f"{side}_ankle_dorsiflexion": 25.0 * crouch,
            f"{side}_shoulder_elevation": 14.0 + 125.0 * lift,
            f"{side}_shoulder_flexion": 5.0 - 20.0 * swing + 15.0 * lift,
            f"{side}_elbow_flexion": 20.0 + 10.0 * swing * swing,
        }
    return angles
