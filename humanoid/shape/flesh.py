"""The parts of a body as triangle meshes in the frames of their joints, for pictures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.flesh_nodes import flesh_points, grid_nodes
from humanoid.subject.subject import Flesh


class FleshMesh(NamedTuple):
    """One part as triangles.

    link: the link it covers. joint: the Pinocchio joint that moves it.
    vertices (V, 3): in the joint's frame [m]. faces (F, 3) int: indices of vertices, counter-clockwise from outside.
    """

    link: str
    joint: int
    vertices: np.ndarray
    faces: np.ndarray


def solid_mesh(flesh: Flesh, around: int = 20, along: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a part in the frame of its link.

    `around` vertices on each ring about the part's z axis, `along` rings between the poles, evenly spaced on the
    surface. Returns vertices (around * along + 2, 3) [m] and faces (2 * around * along, 3).
    """
    nodes = grid_nodes(flesh, around, along)
    return flesh_points(flesh, nodes.u), nodes.faces


def flesh_meshes(body: Body, around: int = 20, along: int = 12) -> list[FleshMesh]:
    """Every part of the body's subject, in the file's order, in the frame of the joint that moves it."""
    meshes = []
    for flesh in body.subject.flesh:
        frame = body.model.frames[body.model.getFrameId(flesh.link, pin.FrameType.BODY)]
        vertices, faces = solid_mesh(flesh, around, along)
        placed = vertices @ frame.placement.rotation.T + frame.placement.translation
        meshes.append(FleshMesh(flesh.link, int(frame.parentJoint), placed, faces))
    return meshes
