"""Which way is up in the world of the given cameras, and that world turned so that z points there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.data.cameras.camera import UPS, Camera, axis_of, in_world, nearest_axis, world_with_up
from estimator.data.cameras.epipolar import seen_points
from estimator.data.observation import Observation
from estimator.data.people.up_direction import UpDirection, up_direction
from estimator.numerics.vectors import angle_between
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, shown

_MOST = 400  # instants that are used
_NEAREST, _FARTHEST, _DOUBTFUL = (float(np.radians(a)) for a in (3.0, 12.0, 20.0))  # from an axis that is taken
_DEVIATIONS, _QUIET = 2.5, np.radians(5.0)  # off z, up to which there is no note
_LEVEL = np.radians(70.0)  # between the cameras' own up and the world's, at most
_LIKE_Z = np.radians(25.0)
_ASKED = "give which way is up with --up AXIS: exports, gait and previews depend on it, joint angles do not"


def upright_turn(
    body: Body, observations: Sequence[Observation], up: str | None, *, given: bool
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """R_upright_given (3, 3), None where z points up already or up is undeterminable; and notes.

    up: the user's axis or the camera file's, else it is found: from balance and floor where several cameras
    see the person, and z where one does. A world with z up is unchanged to the last bit. given: whether the
    cameras are, and not guessed.

    Raises InputError: up is not an axis, or there is no camera whose world it could be of.
    """
    if up is not None:
        return _by_word(up, given)
    if not given or not body.has_free_root or not observations:
        return None, ()
    level = _level(observations[0].cameras)
    return _by_person(_of_person(body, observations), level)


def turned(observations: Sequence[Observation], R_upright_given: np.ndarray) -> list[Observation]:
    """The same in a world that is turned."""
    cameras = tuple(in_world(camera, R_upright_given) for camera in observations[0].cameras)
    return [replace(observation, cameras=cameras) for observation in observations]


def _by_word(up: str, given: bool) -> tuple[np.ndarray | None, tuple[str, ...]]:
    direction = _direction(up)
    if not given:
        raise InputError("--up", "is of the cameras' world, and none is given", remedy="leave it out")
    return (None if direction[2] == 1.0 else world_with_up(direction)), ()


def _direction(up: str) -> np.ndarray:
    """A unit vector (3,) from an axis or three numbers."""
    if up in UPS:
        return axis_of(up)
    try:
        direction = np.array([float(number) for number in up.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not np.linalg.norm(direction) > 1e-6:
        remedy = f"one of {', '.join(UPS)}, or a direction as three numbers: 0.1,0.97,0.2"
        raise InputError("--up", f"{shown(up)} is not an axis", remedy=remedy)
    return np.asarray(direction / np.linalg.norm(direction))


def _level(cameras: Sequence[Camera]) -> np.ndarray:
    """Where the cameras' pictures have up, in the mean (3,): cameras are held more or less level."""
    upward = -np.mean([camera.R_camera_world[1] for camera in cameras], axis=0)
    return np.asarray(upward / max(float(np.linalg.norm(upward)), 1e-12))


def _of_person(body: Body, observations: Sequence[Observation]) -> UpDirection | None:
    """Up by the person whom several cameras see, None where they do not, or the person does not stand."""
    cameras = observations[0].cameras
    if len(cameras) < 2 or any(camera.parallel for camera in cameras):
        return None
    picked = np.unique(np.linspace(0, len(observations) - 1, min(len(observations), _MOST)).astype(int))
    points = np.stack([seen_points(cameras, observations[i].known_pixels) for i in picked])
    return up_direction(body.landmark_names, points, np.array([observations[i].time for i in picked]))


def _nearest(direction: np.ndarray) -> tuple[str, float]:
    """The nearest axis and how far it is [rad]."""
    axis = nearest_axis(direction)
    return axis, float(angle_between(direction, axis_of(axis)))


def _by_person(up: UpDirection | None, level: np.ndarray) -> tuple[np.ndarray | None, tuple[str, ...]]:
    if up is None or angle_between(up.direction, level) > _LEVEL:
        return _by_cameras(level)
    axis, off = _nearest(up.direction)
    tolerance = min(max(_NEAREST, _DEVIATIONS * up.std), _FARTHEST) if up.agree else _DOUBTFUL
    degrees = f"{np.degrees(off):.0f} degrees"
    if axis == "z" and off < max(tolerance, _LIKE_Z):
        kept = f"which way is up? The person stands {degrees} off z, which is kept. {_ASKED}"
        return None, () if off < min(tolerance, _QUIET) else (kept,)
    if off < tolerance:
        held = f"{axis} is used as up in the cameras' world: the person stands along it (within {degrees})"
        return world_with_up(axis_of(axis)), (f"{held}. {_ASKED}",)
    numbers = ",".join(f"{x:.3f}" for x in up.direction)
    known = f"to about {max(np.degrees(up.std), 1.0):.0f} degrees" if up.sure else "without certainty"
    source = "balance and floor" if up.agree else "the person's balance alone"
    note = f"up in the cameras' world, along none of its axes, is found from {source}, {known}: {numbers}. {_ASKED}"
    return world_with_up(up.direction), (note,)


def _by_cameras(level: np.ndarray) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Where the person does not determine it: z, in doubt where the cameras are held across it (from a ceiling,
    too)."""
    if angle_between(level, axis_of("z")) < _LEVEL:
        return None, ()
    return None, (f"which way is up in the cameras' world? z is taken, across which the cameras are held. {_ASKED}",)
