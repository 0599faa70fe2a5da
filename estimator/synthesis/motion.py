"""Motions with known truth: authored ones, splines through keys on feet that stay where they stand, and smooth random
ones of any body, within its limits and without overlaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from estimator.synthesis.keyed_motion import KeyedMotion
from estimator.synthesis.motion_keys import REACH
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_V, Body
from humanoid.support.errors import InputError

MOTION_SECONDS = REACH.seconds
_GRID_RATE = 120.0  # the root's path is computed on a grid of its own, for any requested times
_FLOOR_SMOOTHING = 0.04  # [s]
_SOLES = ("heel", "big_toe", "small_toe")
_LEVEL = 28.0  # [deg] how far the ankles go to keep the soles level


def authored_motion(body: Body, times: np.ndarray, motion: KeyedMotion = REACH) -> np.ndarray:
    """Configurations (T, nq) at `times` (T,) [s], 0 to `motion.seconds`, held before and after.

    World of a free body: z up, the floor at z = 0; the person stands near the origin, and faces x at a yaw of zero.
    Angles stay inside the limits. The carrying foot stays where it is.

    Raises
    ------
    InputError: the body lacks one of the motion's joints, or has another base than it needs.
    """
    _check(body, motion)
    times = np.clip(times, 0.0, motion.seconds)
    q = _pose(body, times, motion)
    if motion.yaw:
        grid = np.linspace(0.0, motion.seconds, round(motion.seconds * _GRID_RATE) + 1)
        q[:, :3] = CubicSpline(grid, _root_path(body, grid, motion))(times)
    return q


def _check(body: Body, motion: KeyedMotion) -> None:
    missing = [name for name in motion.angles if not body.model.existJointName(name)]
    base = "free" if motion.yaw else "fixed"
    if missing or body.subject.base != base:
        problem = f"has no joint {', '.join(missing)}" if missing else f"has no {base} base"
        raise InputError(body.subject.source, problem, remedy=f"the authored motion is one of {motion.subject}")


def _spline(motion: KeyedMotion, values: Sequence[float], times: np.ndarray) -> np.ndarray:
    return cast(np.ndarray, CubicSpline(motion.times, values, bc_type="clamped")(times))


def _pose(body: Body, times: np.ndarray, motion: KeyedMotion) -> np.ndarray:
    """Configurations with a free root turned but at the origin."""
    model = body.model
    q = np.tile(body.neutral, (len(times), 1))
    angles = {name: _of_joint(model, name, _spline(motion, values, times)) for name, values in motion.angles.items()}
    if motion.yaw:
        pitch, yaw = (np.radians(_spline(motion, values, times)) for values in (motion.pitch, motion.yaw))
        for side in ("left", "right"):
            level = angles[f"{side}_knee_flexion"] - angles[f"{side}_hip_flexion"] - pitch
            angles[f"{side}_ankle_dorsiflexion"] = np.radians(_LEVEL) * np.tanh(level / np.radians(_LEVEL))
        for i in range(len(times)):
            q[i, :3] = 0.0
            q[i, 3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, pitch[i], yaw[i])).coeffs()
    for name, angle in angles.items():
        q[:, model.idx_qs[model.getJointId(name)]] = angle
    return q


def _of_joint(model: pin.Model, name: str, values: np.ndarray) -> np.ndarray:
    """Entries (T,) of q: keys of sliding joints are metres, of all others degrees."""
    kind = model.joints[model.getJointId(name)].shortname()
    return values if kind.startswith("JointModelP") else np.radians(values)


def _root_path(body: Body, grid: np.ndarray, motion: KeyedMotion) -> np.ndarray:
    """Root positions (N, 3) that keep the carrying foot in its place and the lowest sole on the floor."""
    points = np.array([body.landmarks(body.at(q)) for q in _pose(body, grid, motion)])
    names = body.landmark_names
    left, right = (points[:, names.index(f"{side}_ankle"), :2] for side in ("left", "right"))
    stance = np.clip(_spline(motion, motion.left_stance, 0.5 * (grid[1:] + grid[:-1])), 0.0, 1.0)[:, None]
    slide = stance * np.diff(left, axis=0) + (1.0 - stance) * np.diff(right, axis=0)
    soles = [i for i, name in enumerate(names) if name.endswith(_SOLES)]
    height = -points[:, soles, 2].min(axis=1)
    path = np.zeros((len(grid), 3))
    path[:, :2] = np.array(motion.start) - np.concatenate([np.zeros((1, 2)), np.cumsum(slide, axis=0)])
    path[:, 2] = gaussian_filter1d(height, _FLOOR_SMOOTHING * _GRID_RATE, mode="nearest")
    return path


_KEY = 0.8  # [s] from one key pose to the next
_STEP = 1.0 / 120.0  # [s] between the poses that are checked for overlaps
_FASTEST = 3.0  # rad/s, or a third of it in m/s
_PEAK = 1.875  # highest speed of a way of least jerk over its mean
_WANDER = 1.2  # [rad] to either side, of a joint without limits
_TURN, _PLACE = 0.5, 0.15  # [rad], [m] to either side, of a free root
_TRIES, _WHOLE = 24, 12  # of a key: how many at all, and with the whole way


def random_motion(body: Body, times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Configurations (T, nq) at rising times (T,) [s] from 0 on.

    From the rest pose every 0.8 s towards another pose drawn within the limits, by ways of least jerk (T. Flash and N.
    Hogan, The coordination of arm movements, Journal of Neuroscience 5, 1985), no faster than 3 rad/s and the limits of
    the URDF. A way on which parts would overlap, or deeper than any do at rest (a robot's hulls may touch there), is
    drawn again, then shortened. A free root stays near where it began.
    """
    collision = SelfCollision(body)
    deepest = collision.penetration(body.at(body.neutral))
    q = np.empty((len(times), body.nq))
    pose, start = body.neutral, 0.0
    while start <= times[-1]:
        frames = np.flatnonzero((times >= start) & (times < start + _KEY))
        checked_times = np.concatenate([np.arange(0.0, _KEY + 0.5 * _STEP, _STEP), times[frames] - start])
        way = _way(body, (collision, deepest), pose, checked_times, rng)
        for i in frames:
            q[i] = body.integrate(pose, _share(times[i] - start) * way)
        pose, start = body.integrate(pose, way), start + _KEY
    return q


def _way(
    body: Body,
    allowed: tuple[SelfCollision, float],
    pose: np.ndarray,
    checked_times: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """A tangent (nv,) from a pose to the next key along which nothing overlaps, or no deeper than is allowed [m]; zero
    where none was found."""
    collision, deepest = allowed
    for attempt in range(_TRIES):
        way = _random_tangent(body, pose, rng) * 0.5 ** max(0, attempt - _WHOLE)
        posed = (body.at(body.integrate(pose, _share(t) * way)) for t in checked_times)
        if not any(collision.penetration(p) > deepest for p in posed):
            return way
    return np.zeros(body.nv)


def _random_tangent(body: Body, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A tangent (nv,) to a pose drawn within the limits, no longer than there is time for."""
    wanted = rng.uniform(-_WANDER, _WANDER, body.nv) + body.difference(pose, body.neutral)
    share = rng.uniform(0.05, 0.95, len(body.bounded_q))
    low, high = body.lower[body.bounded_q], body.upper[body.bounded_q]
    wanted[body.bounded_v] = low + share * (high - low) - pose[body.bounded_q]
    if body.has_free_root:
        home = body.difference(pose, body.neutral)[ROOT_V]
        wanted[ROOT_V] = home + rng.uniform(-1.0, 1.0, 6) * np.repeat([_PLACE, _TURN], 3)
    urdf = np.asarray(body.model.velocityLimit)
    fastest = np.where((urdf > 0.0) & np.isfinite(urdf), np.minimum(urdf, _FASTEST), _FASTEST)
    longest = fastest * _KEY / _PEAK
    return np.asarray(np.clip(wanted, -longest, longest))


def _share(time: float) -> float:
    """The share of a minimum-jerk path covered at a time [s] after its start."""
    s = min(max(time / _KEY, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
