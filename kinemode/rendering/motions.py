"""The motion of a clip: an authored one, a captured one, a table of joints, or a random one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator import synthesis
from estimator.data.formats.motion_table import read_motion_table
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.motion_file import motion_of
from estimator.synthesis.motion_keys import MOTIONS, motion_named
from estimator.synthesis.random_motion import random_motion
from estimator.synthesis.retarget import retarget
from estimator.synthesis.settings import in_range
from humanoid.kinematics.body import ROOT_PLACE_Q, Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.joint_names import ROOT_POSITION

RANDOM = "random"
TABLES = (".csv", ".npz")
FILES = (".bvh", *TABLES)
_RANDOM_SECONDS = 4.0
_LONGEST = 3600.0  # [s]
_NODES = 500
_STREAM = 3  # of random numbers, beside those of the clip


def is_authored(motion: str | Path) -> bool:
    """Whether a motion is one of ours; a file is never called so. Raises InputError for a name that there is not."""
    name = str(motion)
    if name == RANDOM or (name not in MOTIONS and (Path(motion).suffix.lower() in FILES or Path(motion).exists())):
        return False
    return motion_named(name) is not None


def configurations(
    body: Body,
    motion: str | Path,
    fps: float,
    seconds: float | None,
    seed: int,
    unit: float | None = None,
    up: str | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """q (T, nq) and its times (T,) [s]; raises InputError, see `kinemode.render`."""
    if str(motion) == RANDOM:
        times = _times(fps, seconds, _LONGEST, _RANDOM_SECONDS)
        q = random_motion(body, times, np.random.default_rng((seed, _STREAM)))
        return _on_the_floor(body, q), times
    if is_authored(motion):
        keyed = motion_named(str(motion))
        times = _times(fps, seconds, keyed.seconds)
        return synthesis.authored_motion(body, times, keyed), times
    if Path(motion).suffix.lower() in TABLES:
        table = read_motion_table(Path(motion))
        times = _times(fps, seconds, float(table.time[-1] - table.time[0]) + 1.0 / fps)
        q = motion_of(body, table, times)
        return (q if any(name.startswith(ROOT_POSITION) for name in table.names) else _on_the_floor(body, q)), times
    mocap = load_mocap(motion, unit=unit, up=up)
    times = _times(fps, seconds, mocap.seconds)
    return retarget(body, mocap, times).q, times


def _times(fps: float, seconds: float | None, longest: float, usual: float | None = None) -> np.ndarray:
    """Times (T,) [s] of the frames of a motion that is so long, or of the seconds of it that are asked for."""
    if seconds is not None:
        in_range("seconds", seconds, 1.0 / fps, longest)
    return np.arange(max(1, round(fps * (seconds or usual or longest)))) / fps


def _on_the_floor(body: Body, q: np.ndarray) -> np.ndarray:
    """The same motion (T, nq), a free root moved up or down so that its lowest point of all is at z = 0."""
    if not body.has_free_root:
        return q
    surface = surface_of(body, nodes=_NODES)
    lowest = min(float(points_in_world(body.at(pose), surface.joint, surface.local)[:, 2].min()) for pose in q)
    lifted = q.copy()
    lifted[:, ROOT_PLACE_Q.stop - 1] -= lowest
    return lifted
