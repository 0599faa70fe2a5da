"""Captured motions on people of random proportions, as files of markers with noise, outliers and gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.data.formats.opensim import write_trc
from estimator.fitting.measures import standing_pose
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import ROOT_V, Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.marker_set import marker_set
from humanoid.subject.subject import Marker, Subject, load_subject

SET, FPS = "plug-in-gait", 60.0
CLIPS = ("walk_straight_07_01", "punch_02_05", "jump_16_01", "dance_05_10", "bend_scoop_lift_02_06")
_SPREAD, _MOST = 0.06, 0.15  # of a scale from 1: standard deviation, and the most
_STANDING = 1.0  # s
_SURE = 1e-4  # m: of places that are known


@dataclass(frozen=True)
class MarkerFaults:
    """Faults of measured markers. noise [m]: standard deviation along each axis. outliers: share of the
    measurements that lie `far` [m], RMS, along each axis elsewhere. gaps: share that is missing, in bursts of 1 to
    `longest` frames. places [m]: RMS length of how far the markers sit from where the set has them. standing [deg]:
    standard deviation of the joints from upright standing in a static trial, None where there is none."""

    noise: float = 0.005
    outliers: float = 0.05
    far: float = 0.1
    gaps: float = 0.1
    longest: int = 10
    places: float = 0.01
    standing: float | None = None


@dataclass(frozen=True)
class CapturedTrial:
    """person: the true one, markers at their true places, which are known. q (T, nq): true poses. names (M), time (T,)
    and points (T, M, 3) [m]: what is measured, NaN where it is missing. static (S, M, 3) [m]: the same while the person
    stands, None where there is no static trial."""

    person: Subject
    q: np.ndarray
    names: tuple[str, ...]
    time: np.ndarray
    points: np.ndarray
    static: np.ndarray | None = None

    def write_static(self, path: Path) -> Path | None:
        """The static trial as a TRC file, where there is one."""
        if self.static is None:
            return None
        write_trc(path, self.names, self.static, np.arange(len(self.static)) / FPS)
        return path

    def write(self, path: Path) -> Path:
        """As a TRC file."""
        write_trc(path, self.names, self.points, self.time)
        return path


def captured_trial(clip: Path, seed: int, faults: MarkerFaults, seconds: float, fps: float) -> CapturedTrial:
    """The first seconds of a captured motion; every clip and seed has its own person, independent of the faults."""
    rng = np.random.default_rng((seed, *clip.stem.encode()))
    person = random_person(rng, faults.places)
    body, mocap = Body(person), load_mocap(clip)
    time = np.arange(0.0, min(seconds, mocap.seconds), 1.0 / fps)
    q = retarget(body, mocap, time).q
    points = body.markers_of(body.placed(q))
    measured = spoilt(points, rng, faults)
    return CapturedTrial(person, q, body.marker_names, time, measured, standing_points(body, rng, faults))


def standing_points(body: Body, rng: np.random.Generator, faults: MarkerFaults) -> np.ndarray | None:
    """Measured points (S, M, 3) [m] of a person standing still; None without a static trial."""
    if faults.standing is None:
        return None
    away = np.radians(faults.standing) * rng.normal(size=body.nv)
    away[ROOT_V] = 0.0
    q = body.integrate(standing_pose(body, body.neutral), away)
    points = body.markers_of(body.placed(np.tile(q, (round(_STANDING * FPS), 1))))
    return spoilt(points, rng, faults)


def random_person(rng: np.random.Generator, places: float) -> Subject:
    """human34 with random proportions, its markers off their places by an isotropic error of such a length, RMS [m]."""
    subject, markers = load_subject("human34"), marker_set(SET).markers
    proportions = ProportionedBody(subject)
    factors = 1.0 + np.clip(_SPREAD * rng.normal(size=len(proportions.names)), -_MOST, _MOST)
    moved = [_moved(marker, rng.normal(size=3) * places / np.sqrt(3.0)) for marker in markers]
    return subject.with_markers(moved).scaled(proportions.scales(factors))


def _moved(marker: Marker, by: np.ndarray) -> Marker:
    x, y, z = (np.array(marker.xyz) + by).tolist()
    return replace(marker, xyz=(x, y, z), std=_SURE)


def spoilt(points: np.ndarray, rng: np.random.Generator, faults: MarkerFaults) -> np.ndarray:
    """Measured points (T, M, 3) [m]."""
    T, M = points.shape[:2]
    seen = points + faults.noise * rng.normal(size=points.shape)
    wrong = rng.random((T, M)) < faults.outliers
    seen[wrong] += faults.far * rng.normal(size=(int(wrong.sum()), 3))
    seen[missing(rng, T, M, faults)] = np.nan
    return np.asarray(seen)


def missing(rng: np.random.Generator, frames: int, count: int, faults: MarkerFaults) -> np.ndarray:
    """Which measurements (T, M) are missing: bursts at random, until as large a share of each marker's is gone."""
    gone = np.zeros((frames, count), dtype=bool)
    wanted = round(faults.gaps * frames)
    for marker in gone.T:
        while (left := wanted - int(marker.sum())) > 0:
            length = min(left, int(rng.integers(1, faults.longest + 1)))
            begin = int(rng.integers(0, frames))
            marker[begin : begin + length] = True
    return gone
