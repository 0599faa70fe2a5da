"""What the tests of the estimator share: bodies, cameras, poses, and observations of known poses."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import load_subject, subject_from_text
from kinemode.testing import slope

__all__ = [
    "BROWN",
    "MULTIPLIER",
    "OFFSET",
    "SUBJECTS",
    "bent",
    "body_of",
    "camera_at",
    "gripper",
    "inside",
    "observe",
    "random_pose",
    "slope",
]

SUBJECTS = ("human34", "arm8", "upper13")
BROWN = (-0.11, 0.05, 0.002, -0.003, 0.01)


MULTIPLIER, OFFSET = -0.5, 0.2
"""Of the gripper's finger that follows the other [1, rad]."""


def gripper(*, master: str = "drive", follower: str = "inner", kind: str = "revolute", extra: str = "") -> str:
    """A free hand with two fingers; by its name the follower comes before or after its master."""
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    limit = '<limit lower="-1" upper="0.9" effort="1" velocity="1"/>'
    follows = f'<mimic joint="{master}" multiplier="{MULTIPLIER}" offset="{OFFSET}"/>'
    return f"""<robot name="gripper">
      <link name="hand">{ball}</link><link name="wrist">{ball}</link><link name="a">{ball}</link>
      <link name="b">{ball}</link><link name="tip">{ball}</link>
      <joint name="bend" type="revolute"><parent link="hand"/><child link="wrist"/><origin xyz="0.3 0 0"/>
        <axis xyz="0 1 0"/>{limit}</joint>
      <joint name="{master}" type="revolute"><parent link="wrist"/><child link="a"/><origin xyz="0.2 0.15 0"/>
        <axis xyz="0 0.6 0.8"/>{limit}</joint>
      <joint name="{follower}" type="{kind}"><parent link="wrist"/><child link="b"/><axis xyz="0 -0.8 0.6"/>
        <origin xyz="0.2 -0.15 0" rpy="0.1 0.2 0.3"/>{"" if kind == "continuous" else limit}{follows}</joint>
      <joint name="outer" type="revolute"><parent link="b"/><child link="tip"/><origin xyz="0.25 0 0.02"/>
        <axis xyz="0 0 1"/>{limit}</joint>{extra}
      <landmark name="a" link="a" xyz="0.2 0.1 0"/><landmark name="b" link="b" xyz="0.1 0 0.1"/>
      <landmark name="tip" link="tip" xyz="0.2 0 0"/><landmark name="hand" link="hand" xyz="0 0.1 0"/>
      <proportion joint="outer" scale_min="0.8" scale_max="1.2" mean="1" std="0.1"/>
      <subject base="free"/></robot>"""


@cache
def body_of(name: str) -> Body:
    """A built-in subject's body, or the gripper's; one object for all tests."""
    if name == "gripper":
        return Body(subject_from_text(gripper(), source=name))
    return Body(load_subject(name))


def camera_at(
    azimuth: float,
    *,
    distance: float = 4.0,
    focal: float = 700.0,
    height: float = 0.3,
    aim: Sequence[float] = (0.0, 0.0, 0.0),
    distortion: Sequence[float] = (0.0,) * 5,
) -> Camera:
    """A 640 x 480 camera at `distance` [m] from the z axis, `azimuth` [deg] from x, `height` [m], facing `aim` [m]."""
    angle = np.radians(azimuth)
    centre = np.array([distance * np.cos(angle), distance * np.sin(angle), height])
    forward = np.asarray(aim) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R_camera_world = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal, 0.7, 318.0], [0.0, 1.02 * focal, 243.0], [0.0, 0.0, 1.0]])
    return Camera(f"at{azimuth:g}", (640, 480), K, np.array(distortion), R_camera_world, -R_camera_world @ centre)


def random_pose(body: Body, rng: np.random.Generator, *, share: float = 1.0, turn: float = np.pi) -> np.ndarray:
    """Joints drawn evenly from the middle `share` of their limits; a free root near the origin, turned up to `turn`."""
    q, i = body.neutral.copy(), body.bounded_q
    middle, half = 0.5 * (body.lower[i] + body.upper[i]), 0.5 * share * (body.upper[i] - body.lower[i])
    q[i] = rng.uniform(middle - half, middle + half)
    if body.has_free_root:
        axis = rng.normal(size=3)
        placed = np.concatenate([rng.normal(scale=0.2, size=3), rng.uniform(-turn, turn) * axis / np.linalg.norm(axis)])
        q = pin.integrate(body.model, q, np.concatenate([placed, np.zeros(body.nv - 6)]))
    return q


STANDING = {
    "knee_flexion": 0.5, "elbow_flexion": 0.62, "shoulder_elevation": 0.23, "shoulder_flexion": -0.1,
    "shoulder_rotation": -0.4, "clavicle_elevation": 0.0, "clavicle_protraction": 0.03, "neck_flexion": 0.1,
}  # fmt: skip
"""[rad] A standing person with bent limbs: tests must not depend on the learned rest positions."""


def bent(body: Body, start: np.ndarray | None = None, **angles: float) -> np.ndarray:
    """A standing pose (`STANDING`, the rest neutral), or start (nq,), with some joints at given angles [rad]."""
    q = (body.neutral if start is None else start).copy()
    stands = {name: STANDING[without_side(name)] for name in body.q_names if without_side(name) in STANDING}
    for joint, angle in ((stands if start is None else {}) | angles).items():
        q[body.q_names.index(joint)] = angle
    return body.clamp(q)


def observe(
    body: Body,
    q: np.ndarray,
    cameras: Sequence[Camera],
    *,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    index: int = 0,
    time: float = 0.0,
) -> Observation:
    """The projections of a known pose, with `noise` [px] of normal error."""
    points = body.landmarks(body.at(q))
    pixels = np.array([camera.project(points) for camera in cameras])
    if rng is not None:
        pixels = pixels + noise * rng.normal(size=pixels.shape)
    return Observation(index, time, tuple(cameras), pixels, np.ones(pixels.shape[:2]))


def inside(body: Body, q: np.ndarray) -> bool:
    """Whether every configuration (..., nq) is within the limits, to the last bit."""
    return bool(np.all(q >= body.lower) and np.all(q <= body.upper))
