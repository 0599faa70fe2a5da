"""The two readings of a trunk in one picture: beyond the hips it leads towards the camera, or away from it."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.search.jumps.anatomy import RigidPart, anatomy_of
from humanoid.kinematics.body import Body, batches
from humanoid.support.compiled import jit

TOWARDS, AWAY, ACROSS = READINGS = ("towards", "away", "across")
"""Readings in the only camera. `ACROSS`: the trunk is nearly square to the rays, where both readings are one."""


def trunk_readings(body: Body, q: np.ndarray, camera: Camera) -> np.ndarray:
    """The reading (N,) of each configuration (N, nq), one of `READINGS`; "" of a body without a trunk that turns."""
    anatomy = anatomy_of(body)
    if anatomy.trunk is None or not len(q):
        return np.full(len(q), "", dtype="U7")
    points = np.concatenate([body.landmarks_of(body.placed(some)) for some in batches(q)])
    return readings_of_points(body, points, camera)


def readings_of_points(body: Body, points: np.ndarray, camera: Camera) -> np.ndarray:
    """The same by the landmarks (N, L, 3) [m] of each configuration."""
    anatomy = anatomy_of(body)
    if anatomy.trunk is None:
        return np.full(len(points), "", dtype="U7")
    depth = _depths(anatomy.parts[anatomy.trunk], points, camera)
    # a trunk that is mirrored moves by twice its depth: nearer ones are the same pose
    away = np.where(depth > 0.5 * anatomy.same, AWAY, np.where(depth < -0.5 * anatomy.same, TOWARDS, ACROSS))
    return np.asarray(away)


def has_both(readings: np.ndarray) -> bool:
    """Whether some of these readings (N,) lead towards the camera and some away from it."""
    return {TOWARDS, AWAY} <= set(readings.tolist())


def trunk_depths(body: Body, q: np.ndarray, camera: Camera) -> np.ndarray:
    """Distances (N,) [m] by which the trunk leads away from the camera in each configuration (N, nq); raises ValueError
    for a body without a trunk that turns."""
    anatomy = anatomy_of(body)
    if anatomy.trunk is None:
        raise ValueError("the body has no trunk that turns about a pair of limbs")
    return _depths(anatomy.parts[anatomy.trunk], body.landmarks_of(body.placed(q)), camera)


def _depths(trunk: RigidPart, points: np.ndarray, camera: Camera) -> np.ndarray:
    """The distance of the trunk beyond the hips, along the rays to them, from landmarks (N, L, 3) [m]."""
    hips, way = np.empty((2, len(points), 3))
    _beyond_hips(points, *trunk.ends, hips, way)
    return np.asarray(np.einsum("ij,ij->i", way, camera.sight_lines(hips)[1]))


@jit
def _beyond_hips(points, about, beyond, hips, way):  # type: ignore[no-untyped-def]
    """Fill hips (N, 3) with the middle of the landmarks `about` (A,) of points (N, L, 3), and way (N, 3) with the way
    from there to the middle of those `beyond` (B,)."""
    for n in range(points.shape[0]):
        for c in range(3):
            near = far = 0.0
            for i in about:
                near += points[n, i, c]
            for i in beyond:
                far += points[n, i, c]
            hips[n, c] = near / about.shape[0]
            way[n, c] = far / beyond.shape[0] - hips[n, c]


def reading_shifts(readings: np.ndarray, energy: np.ndarray, rest: np.ndarray, share: float) -> np.ndarray:
    """Correction of the energies (K,) of a frame's modes, so that their part `rest` (K,) from the rest positions of
    joints counts between the two readings of the trunk only by this share: (K,), equal within a reading.

    readings (K,): see `trunk_readings`. Between modes of one reading, where one is missing, and where the best mode's
    trunk is square to the rays, nothing changes. Rest positions are learned joint by joint, while a trunk that is read
    the other way changes many joints together: on captured people their sum distinguishes right from wrong far less
    well than its size suggests (`python -m benchmarks trunk_evidence`).
    """
    shifts, evidence = np.zeros(len(energy)), energy - (1.0 - share) * rest
    sides = [readings == TOWARDS, readings == AWAY]
    if has_both(readings) and readings[np.argmin(energy)] != ACROSS:
        gaps = [float(values[sides[1]].min() - values[sides[0]].min()) for values in (evidence, energy)]
        other = sides[1] if gaps[1] >= 0.0 else sides[0]
        shifts[other] = (gaps[0] - gaps[1]) * (1.0 if gaps[1] >= 0.0 else -1.0)
    return shifts
