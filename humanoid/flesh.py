"""The solids of a body as triangle meshes in the frames of their joints, for pictures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.body import Body
from humanoid.subject import Flesh


class FleshMesh(NamedTuple):
    """One solid as triangles.

    link: the link it covers. joint: the Pinocchio joint that moves it.
    vertices (V, 3): in the joint's frame [m]. faces (F, 3) int: indices of vertices, counter-clockwise from outside.
    """

    link: str
    joint: int
    vertices: np.ndarray
    faces: np.ndarray


def solid_mesh(flesh: Flesh, around: int = 20, along: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a capsule or an ellipsoid in the frame of its link.

    `around` vertices on each ring about the solid's z axis, `along` rings between the poles (even, so that a capsule
    is cut at its middle). Returns vertices (around * along + 2, 3) [m] and faces (2 * around * along, 3).
    """
    rings = along + along % 2
    polar = np.pi * (np.arange(rings) + 0.5) / rings  # from the +z pole to the -z pole, none on it
    if flesh.shape == "capsule":
        polar = np.concatenate([np.linspace(0.0, np.pi / 2, rings // 2 + 1)[1:], _lower_half(rings)])
    azimuth = 2.0 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(around)], axis=-1)
    sphere = np.sin(polar)[:, None, None] * ring + np.cos(polar)[:, None, None] * np.array([0.0, 0.0, 1.0])
    unit = np.concatenate([sphere.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    if flesh.shape == "capsule":
        radius, length, _ = flesh.size
        upper = np.concatenate([np.repeat(np.arange(rings) < rings // 2, around), [True, False]])
        vertices = unit * radius
        vertices[:, 2] += np.where(upper, 0.5, -0.5) * length
    else:
        vertices = unit * np.array(flesh.size)
    T_link_solid = pin.SE3(pin.rpy.rpyToMatrix(np.array(flesh.rpy)), np.array(flesh.xyz))
    return vertices @ T_link_solid.rotation.T + T_link_solid.translation, _faces(rings, around)


def _lower_half(rings: int) -> np.ndarray:
    return np.linspace(np.pi / 2, np.pi, rings // 2 + 1)[:-1]


def _faces(rings: int, around: int) -> np.ndarray:
    """Quads between neighbouring rings, split in two, and a fan at each pole."""
    here = np.arange(around)
    following = (here + 1) % around
    faces = []
    for ring in range(rings - 1):
        a, b = ring * around + here, ring * around + following
        c, d = a + around, b + around
        faces += [np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)]
    top, bottom, last = np.full(around, rings * around), np.full(around, rings * around + 1), (rings - 1) * around
    faces += [np.stack([top, here, following], axis=-1), np.stack([bottom, last + following, last + here], axis=-1)]
    return np.concatenate(faces)


def flesh_meshes(body: Body, around: int = 20, along: int = 12) -> list[FleshMesh]:
    """Every solid of the body's subject, in the file's order, in the frame of the joint that moves it."""
    meshes = []
    for flesh in body.subject.flesh:
        frame = body.model.frames[body.model.getFrameId(flesh.link, pin.FrameType.BODY)]
        vertices, faces = solid_mesh(flesh, around, along)
        placed = vertices @ frame.placement.rotation.T + frame.placement.translation
        meshes.append(FleshMesh(flesh.link, int(frame.parentJoint), placed, faces))
    return meshes
