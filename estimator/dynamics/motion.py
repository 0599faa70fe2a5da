"""Velocities and accelerations of a trajectory."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from estimator.numerics.stretches import stretches
from humanoid.kinematics.body import ROOT_JOINT, Body
from humanoid.shape.segment_masses import forward_of

_DEGREE = 5  # of the splines: accelerations are then smooth curves of third degree
_FEWEST = 8  # poses in a row
_FAR = 3.5  # standard deviations: frames farther away do not count
_GAP = 2.5  # frames, over the median: across a longer pause nothing is interpolated
_FACES = 0.25  # s, over which the way a body faces is a mean


class Motion(NamedTuple):
    """Poses over time with their derivatives, in Pinocchio's conventions.

    time (T,) [s], q (T, nq). v, a (T, nv): velocity and acceleration in the tangent space at each pose, those of a free
    root linear and angular, in its own frame, `a` as the derivative of the entries of `v`. NaN where there is no pose,
    or fewer than eight in a row. parts: first frame and the one after the last of each stretch between gaps. lift (T,)
    [m/s2]: acceleration of the trunk along its axis beside that of the joints, None of a rigid one (`Trunk`).
    """

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    parts: tuple[tuple[int, int], ...]
    lift: np.ndarray | None = None

    @property
    def known(self) -> np.ndarray:
        """Whether each frame (T,) has accelerations."""
        return np.asarray(np.isfinite(self.a).all(axis=1))


def motion_of(body: Body, time: np.ndarray, q: np.ndarray, stretch: np.ndarray | None = None) -> Motion:
    """The motion through poses q (T, nq), NaN where there is none, at times (T,) [s], rising. stretch (T,) [m]: how
    much longer the trunk is than the body's.

    Each coordinate is interpolated by a spline of fifth degree, without any smoothing: how smooth the accelerations are
    is decided by where the poses come from. Turns of a root or a ball joint are added up from frame to frame in their
    tangent space, whose slope is the velocity there.
    """
    v, a = (np.full((len(q), body.nv), np.nan) for _ in range(2))
    lift = None if stretch is None else np.full(len(q), np.nan)
    parts = []
    for first, after in _stretches(time, q):
        if after - first < _FEWEST:
            continue
        parts.append((first, after))
        rows = slice(first, after)
        spline = make_interp_spline(time[rows], _coordinates(body, q[rows]), k=_DEGREE)
        v[rows], a[rows] = (spline(time[rows], order) for order in (1, 2))
        if lift is not None and stretch is not None:
            lift[rows] = make_interp_spline(time[rows], stretch[rows], k=_DEGREE)(time[rows], 2)
        if body.has_free_root:
            _turn_into_root(body, q[rows], v[rows], a[rows])
    return Motion(time, q, v, a, tuple(parts), lift)


def _stretches(time: np.ndarray, q: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of poses without gaps."""
    posed, dt = np.isfinite(q).all(axis=1), np.diff(time)
    breaks = 1 + np.flatnonzero(dt > _GAP * np.median(dt)) if len(dt) else np.zeros(0, dtype=int)
    parts = []
    for first, after in stretches(posed):
        ends = [first, *(int(b) for b in breaks if first < b < after), after]
        parts += list(pairwise(ends))
    return parts


def _coordinates(body: Body, q: np.ndarray) -> np.ndarray:
    """Coordinates (T, nv) whose slopes are velocities: the root's position in the world, all others summed up."""
    steps = [body.difference(before, after) for before, after in pairwise(q)]
    summed = np.cumsum([np.zeros(body.nv), *steps], axis=0)
    if body.has_free_root:
        summed[:, :3] = q[:, :3]
    return np.asarray(summed)


def _turn_into_root(body: Body, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
    """Turn the linear part of v, a (T, nv) from the world into the root's frame, in place."""
    R_world_root = body.placed(q).rotations_of(ROOT_JOINT)
    v[:, :3] = np.einsum("tji,tj->ti", R_world_root, v[:, :3])
    a[:, :3] = np.einsum("tji,tj->ti", R_world_root, a[:, :3]) - np.cross(v[:, 3:6], v[:, :3])


def facing(body: Body, motion: Motion) -> np.ndarray:
    """Level unit vectors (T, 2) of the way the pelvis faces, over about half a second; NaN of a body without feet."""
    forward = forward_of(body) if body.has_free_root else None
    if forward is None:
        return np.full((len(motion.time), 2), np.nan)
    known = np.isfinite(motion.q).all(axis=1)
    level = np.zeros((len(motion.time), 2))
    R_world_root = body.placed(motion.q[known]).rotations_of(ROOT_JOINT)
    level[known] = (R_world_root @ forward)[:, :2]
    mean = near_mean(motion.time, level, _FACES)
    return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9))


def near_mean(time: np.ndarray, values: np.ndarray, std: float) -> np.ndarray:
    """Means of values (T, ...) over the frames near each, weighed by a normal density of their distance in time."""
    out = np.empty_like(values, dtype=float)
    low, high = (np.searchsorted(time, time + side * _FAR * std) for side in (-1.0, 1.0))
    for t, (first, after) in enumerate(zip(low, high, strict=True)):
        rows = slice(min(first, t), max(after, t + 1))
        near = np.exp(-0.5 * np.square((time[rows] - time[t]) / std))
        out[t] = near @ values[rows] / near.sum()
    return out
