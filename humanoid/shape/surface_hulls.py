"""Nodes on the visual or collision geometry of a URDF: the convex hull of every shape, with new nodes.

The triangles of such meshes are not suitable as nodes: they are large on flat sides and small on screw heads. Each hull
is therefore covered by the even nodes of a squarish superquadric of its own proportions, moved along the rays from its
middle onto the hull, which keeps the triangulation closed.
"""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np

from humanoid.kinematics.body import Body
from humanoid.shape.flesh import even_nodes, flesh_points
from humanoid.shape.solids import ConvexSolid, Geometry, solids_of
from humanoid.subject.subject import Flesh
from humanoid.support.errors import InputError

_SQUARISH = (0.5, 0.5)  # between the boxes and the cylinders that most links of robots resemble


class HullPart(NamedTuple):
    """A convex shape of a link.

    link: the link it covers. joint: the joint that moves it. area [m^2].
    R_joint_part (3, 3), centre (3,) [m]: a frame along its longest axes, in its middle. half (3,): its half-lengths.
    plane (F, 3), offset (F,): its sides in that frame, plane . x <= offset.
    """

    link: str
    joint: int
    area: float
    R_joint_part: np.ndarray
    centre: np.ndarray
    half: np.ndarray
    plane: np.ndarray
    offset: np.ndarray


def hull_parts(body: Body, geometry: Geometry) -> list[HullPart]:
    """The convex hulls of a body's shapes; "auto" takes the visual ones, and where there are none, the collision ones.

    Raises
    ------
    InputError: there is no shape, or a mesh cannot be read.
    """
    solids = _solids(body, geometry)
    if not solids:
        raise InputError(
            body.subject.source,
            "has no geometry" if geometry == "auto" else f"has no {geometry} geometry",
            place="surface",
            remedy="add <flesh>, <visual> or <collision> to its links",
        )
    return [_part(solid) for solid in solids]


def _solids(body: Body, geometry: Geometry) -> tuple[ConvexSolid, ...]:
    if geometry != "auto":
        return solids_of(body, geometry)
    try:
        visual = solids_of(body, "visual")
    except InputError:  # a picture for show may be flat; what others bump into is not
        collision = solids_of(body, "collision")
        if not collision:
            raise
        return collision
    return visual or solids_of(body, "collision")


def _part(solid: ConvexSolid) -> HullPart:
    import trimesh  # slow to import, and only needed for URDFs without flesh

    hull = trimesh.Trimesh(_corners(solid.geometry), process=False).convex_hull
    points = np.asarray(hull.vertices) @ solid.rotation.T + solid.translation
    mean = points.mean(axis=0)
    # axes by falling spread: the longest becomes z, and the frame stays right-handed
    z, y, _ = np.linalg.svd(points - mean, full_matrices=False)[2]
    R_joint_part = np.stack([np.cross(y, z), y, z], axis=-1)
    own = (points - mean) @ R_joint_part
    low, high = own.min(axis=0), own.max(axis=0)
    middle = (low + high) / 2.0
    corners = (own - middle)[np.asarray(hull.faces)]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1)
    kept = length > 1e-9 * length.max()
    plane = across[kept] / length[kept, None]
    offset = np.einsum("fi,fi->f", plane, corners[kept, 0])
    centre = mean + R_joint_part @ middle
    return HullPart(solid.link, solid.joint, float(hull.area), R_joint_part, centre, (high - low) / 2.0, plane, offset)


def _corners(shape: coal.CollisionGeometry) -> np.ndarray:
    """Points (N, 3) whose convex hull is the shape, or nearly so where it is round."""
    import trimesh

    if isinstance(shape, coal.ConvexBase):
        return np.array([shape.point(i) for i in range(shape.num_points)])
    if isinstance(shape, coal.Box):
        return np.asarray(trimesh.creation.box(extents=2.0 * np.array(shape.halfSide)).vertices)
    if isinstance(shape, coal.Cylinder):
        return np.asarray(trimesh.creation.cylinder(shape.radius, 2.0 * shape.halfLength, sections=48).vertices)
    return _round_corners(shape)


def _round_corners(shape: coal.CollisionGeometry) -> np.ndarray:
    import trimesh

    sphere = np.asarray(trimesh.creation.uv_sphere(radius=1.0, count=[24, 48]).vertices)
    if isinstance(shape, coal.Capsule):
        ends = np.where(sphere[:, 2:] < 0.0, -shape.halfLength, shape.halfLength)
        return np.concatenate([shape.radius * sphere[:, :2], shape.radius * sphere[:, 2:] + ends], axis=1)
    radii = np.array(shape.radii) if isinstance(shape, coal.Ellipsoid) else np.full(3, shape.radius)
    return sphere * radii


def hull_nodes(part: HullPart, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (N, 3) [m] about `spacing` [m] apart, their normals (N, 3), in the joint's frame, and triangles (F, 3)."""
    a, b, c = np.maximum(part.half, 1e-6).tolist()
    template = Flesh(part.link, "superquadric", (a, b, c), (0, 0, 0), (0, 0, 0), exponents=_SQUARISH)
    u, faces = even_nodes(template, spacing)
    rays = flesh_points(template, u)
    reach = np.max((rays @ part.plane.T) / np.maximum(part.offset, 1e-9), axis=1)  # 1 where the ray ends on the hull
    local = (rays / reach[:, None]) @ part.R_joint_part.T + part.centre
    return local, vertex_normals(local, faces), faces


def vertex_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (N, 3) at the nodes of a mesh: the mean of the triangles around each, weighted by area."""
    p = points[faces]
    across = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normal = np.zeros_like(points)
    for k in range(3):
        np.add.at(normal, faces[:, k], across)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))
