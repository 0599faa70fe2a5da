"""The solids of a body: its flesh, or the collision or visual geometry of a URDF without flesh, as coal shapes.

Flesh is for the eye, solids are for distances, so a superquadric is replaced by something simpler, and as a rule
slimmer (`Flesh.solid`): a limb for the capsule of `urdf_flesh.limb_capsule`, which leaves the joints at its ends free,
any other part for the ellipsoid of its solid's half-axes. Exponents, taper and bend do not count. Parts with
clearance="off" have no solid.

Heights of a body's points above the sole under them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import coal
import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.collada_check import check_collada, collada_unit
from humanoid.subject.subject import Flesh
from humanoid.subject.urdf_elements import parse
from humanoid.subject.urdf_flesh import limb_capsule
from humanoid.support.errors import InputError
from humanoid.support.per_object import per_object
from humanoid.support.quiet import quiet

Geometry = Literal["auto", "flesh", "collision", "visual"]
MOST_METRES = 1e4  # from a link's origin to a vertex of its meshes
LEAST_METRES = 1e-6  # of a mesh's thickness
_FLAT = 1e-6  # thickness over length


@dataclass(frozen=True)
class ConvexSolid:
    """A convex solid fixed to a joint, and a capsule around it.

    link: the link that carries it. joint: the joint that moves it.
    geometry: coal shape in the frame of the solid.
    rotation (3, 3), translation (3,) [m]: T_joint_solid.
    core_centre, core_half (3,), core_radius [m]: a capsule that contains the solid, in the frame of the solid: every
        point is within core_radius of the segment core_centre -+ core_half. For a capsule or a sphere it is the solid.
    radii (3,) [m]: of an ellipsoid along the solid's axes; zero for every other shape.
    """

    link: str
    joint: int
    geometry: coal.CollisionGeometry
    rotation: np.ndarray
    translation: np.ndarray
    core_centre: np.ndarray
    core_half: np.ndarray
    core_radius: float
    radii: np.ndarray


def solids_of(body: Body, geometry: Geometry = "auto") -> tuple[ConvexSolid, ...]:
    """Solids of a body.

    geometry: "flesh" (the URDF's flesh elements), "collision" or "visual" (the URDF's own geometry, meshes as their
    convex hulls), or "auto": flesh, and where the file has none, collision. Empty where there is none of the kind.

    Raises
    ------
    InputError: a mesh cannot be read, or has no convex hull.
    """
    if geometry not in ("auto", "flesh", "collision", "visual"):
        raise InputError(
            str(geometry), "unknown kind of geometry", place="geometry", remedy="auto, flesh, collision or visual"
        )
    if geometry == "flesh" or (geometry == "auto" and body.subject.flesh):
        return tuple(_flesh_solid(body.model, flesh) for flesh in body.subject.flesh if flesh.clearance)
    kind = pin.GeometryType.VISUAL if geometry == "visual" else pin.GeometryType.COLLISION
    return _urdf_solids(body, kind)


def _flesh_solid(model: pin.Model, flesh: Flesh) -> ConvexSolid:
    frame = model.frames[model.getFrameId(flesh.link, pin.FrameType.BODY)]
    placement = frame.placement * pin.SE3(pin.rpy.rpyToMatrix(*flesh.rpy), np.array(flesh.xyz))
    capsule = flesh.size[:2] if flesh.shape == "capsule" else limb_capsule(flesh)
    if capsule is not None:
        shape: Any = coal.Capsule(*capsule)
    else:
        shape = coal.Ellipsoid(*flesh.core.size)
    return _solid(flesh.link, frame.parentJoint, shape, placement)


@per_object
def _urdf_solids(body: Body, kind: pin.GeometryType) -> tuple[ConvexSolid, ...]:
    subject, model = body.subject, body.model
    tag = "visual" if kind == pin.GeometryType.VISUAL else "collision"
    for mesh in collada_meshes(subject.urdf, tag):
        check_collada(mesh)
    plain = in_metres(parse(subject.urdf, subject.source).plain_urdf)  # with all that Pinocchio's reader requires
    try:
        with quiet():  # Eigen complains of vertices that are not finite, which are refused below
            geometries = pin.buildGeomFromUrdfString(model, plain, kind)
    except ValueError as error:
        raise _unreadable(subject.source, str(error)) from error
    return tuple(
        _solid(model.frames[o.parentFrame].name, o.parentJoint, _convex(o, subject.source), o.placement)
        for o in geometries.geometryObjects
    )


def in_metres(urdf: str) -> str:
    """A URDF whose COLLADA meshes are scaled by their own units, as the URDF's readers do and coal's does not."""
    root = ET.fromstring(urdf)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if name.lower().endswith(".dae") and (unit := collada_unit(Path(name))) != 1.0:
            factors = (unit * float(text) for text in mesh.get("scale", "1 1 1").split())
            mesh.set("scale", " ".join(map(repr, factors)))
    return ET.tostring(root, encoding="unicode")


def collada_meshes(urdf: str, tag: str) -> list[Path]:
    """The COLLADA files of a checked URDF's visual or collision shapes."""
    names = {mesh.get("filename", "") for mesh in ET.fromstring(urdf).iterfind(f"link/{tag}/geometry/mesh")}
    return [Path(name) for name in sorted(names) if name.lower().endswith(".dae")]


def _unreadable(source: str, report: str) -> InputError:
    """The error message of coal's mesh loader, without the place in its own code."""
    said = [line.strip() for line in report.split("message:")[-1].splitlines()]
    said = [line for line in said if line and not line.startswith("Hint")]
    problem = ": ".join(said).replace("Could not load resource", "the mesh cannot be read") or "a mesh cannot be read"
    remedy = "give intact STL, OBJ or DAE meshes of triangles, or leave the shape out"
    return InputError(source, problem, place="geometry", remedy=remedy)


def _convex(part: pin.GeometryObject, source: str) -> coal.CollisionGeometry:
    """Meshes become their convex hulls, primitives stay."""
    shape = part.geometry
    if not hasattr(shape, "buildConvexHull"):
        return shape

    def fault(problem: str, remedy: str) -> InputError:
        return InputError(source, f"the mesh {part.meshPath} cannot be used: {problem}", place=part.name, remedy=remedy)

    _check_vertices(shape, fault)
    try:
        shape.buildConvexHull(True, "Qt")
    except (RuntimeError, ValueError) as error:
        raise fault("it has no convex hull", "give it some thickness") from error
    return shape.convex


def _check_vertices(mesh: Any, fault: Callable[[str, str], InputError]) -> None:
    """Qhull ends the process on vertices that are not finite or lie in a plane, and is lost among absurd ones."""
    points = mesh.vertices()
    size = float(np.abs(points).max(initial=0.0))
    if not size <= MOST_METRES:
        problem = "a vertex is not finite" if not np.isfinite(size) else f"a vertex lies {size:.1e} m out"
        raise fault(problem, "repair it, and check its unit: metres times the URDF's scale")
    centred = points - points.mean(axis=0)
    thickness = np.ptp(centred @ np.linalg.svd(centred, full_matrices=False)[2].T, axis=0)
    if len(thickness) < 3 or thickness.min() < max(LEAST_METRES, _FLAT * thickness.max()):
        raise fault("it has no convex hull, because it is flat", "give it some thickness")


def _solid(link: str, joint: int, shape: Any, placement: pin.SE3) -> ConvexSolid:
    radii = np.zeros(3)
    if isinstance(shape, coal.Ellipsoid):
        radii = np.array(shape.radii)
        centre, half, radius = _capsule_around_ellipsoid(radii)
    elif isinstance(shape, coal.Capsule):
        centre, half, radius = np.zeros(3), np.array([0.0, 0.0, shape.halfLength]), float(shape.radius)
    elif isinstance(shape, coal.Sphere):
        centre, half, radius = np.zeros(3), np.zeros(3), float(shape.radius)
    else:
        centre, half, radius = _capsule_around_points(_hull_points(shape))
    rotation, translation = np.array(placement.rotation), np.array(placement.translation)
    return ConvexSolid(link, int(joint), shape, rotation, translation, centre, half, radius, radii)


def farthest(solid: ConvexSolid, direction: np.ndarray) -> float:
    """Reach of a solid along a unit vector (3,) from its joint's origin, in the joint's frame [m]."""
    along = solid.rotation.T @ direction
    offset = float(solid.translation @ direction)
    if solid.radii.any():
        return offset + float(np.linalg.norm(solid.radii * along))
    if isinstance(solid.geometry, (coal.Capsule, coal.Sphere)):
        return offset + abs(float(solid.core_half @ along)) + solid.core_radius
    return offset + float((_hull_points(solid.geometry) @ along).max())


def _capsule_around_ellipsoid(radii: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Along the longest axis, as thick as the second: the half-length longest - second is just enough."""
    longest = int(np.argmax(radii))
    second = float(np.sort(radii)[1])
    half = np.zeros(3)
    half[longest] = radii[longest] - second
    return np.zeros(3), half, second


def _hull_points(shape: Any) -> np.ndarray:
    """Points (N, 3) whose convex hull contains the shape: its corners, or those of its bounding box."""
    if isinstance(shape, coal.ConvexBase):
        return np.array([shape.point(i) for i in range(shape.num_points)])
    shape.computeLocalAABB()
    low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    return cast(np.ndarray, low + corners * (high - low))


def _capsule_around_points(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The smallest of three capsules, one along each principal axis of the points' spread."""
    mean = points.mean(axis=0)
    axes = np.linalg.svd(points - mean, full_matrices=False)[2]
    capsules = [_capsule_along(points, mean, axis) for axis in axes]
    return min(capsules, key=lambda c: c[2] ** 2 * (2.0 * np.linalg.norm(c[1]) + 4.0 / 3.0 * c[2]))


def _capsule_along(points: np.ndarray, mean: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    along = (points - mean) @ axis
    across = points - mean - along[:, None] * axis
    middle = (across.min(axis=0) + across.max(axis=0)) / 2.0
    off = np.linalg.norm(across - middle, axis=1)
    radius = float(off.max())
    reach = np.sqrt(np.maximum(radius**2 - off**2, 0.0))  # how far beyond the segment's end a point may lie
    high, low = float((along - reach).max()), float((along + reach).min())
    centre = mean + middle + axis * (high + low) / 2.0
    return centre, axis * max(high - low, 0.0) / 2.0, radius


def heights_above_soles(body: Body, landmarks: Sequence[int], up: np.ndarray | None = None) -> np.ndarray:
    """Heights (P,) [m] of landmarks (P,) above the lowest point of what their own joint moves, where the foot is level:
    with all joints at zero, along the root's upright axis, or another unit vector up (3,). 0 where that joint has no
    solids, or the upright axis is unknown."""
    upright, heights = body.subject.upright, np.zeros(len(landmarks))
    if up is None:
        if upright is None:
            return heights
        up = np.array(upright.axis)
    posed, solids = body.at(pin.neutral(body.model)), solids_of(body)
    for k, index in enumerate(landmarks):
        joint = body.landmark_joint[index]
        up_joint = posed.placements[joint, :9].reshape(3, 3) @ up  # stored column by column: the transpose
        depths = [farthest(solid, -up_joint) for solid in solids if solid.joint == joint]
        if depths:
            heights[k] = max(depths) + body.landmark_local[index] @ up_joint
    return heights
