"""OpenSim's model files (.osim, version 4): bodies, joints, coordinates, couplings and markers as they are written.

Everything here is in OpenSim's axes (y up), metres, kilograms and radians. The elements are those of OpenSim's
reference pages (CustomJoint, SpatialTransform, PhysicalOffsetFrame, CoordinateCouplerConstraint); the program: A. Seth
et al., OpenSim: Simulating musculoskeletal dynamics and neuromuscular control to study human and animal movement, PLoS
Comput. Biol. 14(7), 2018.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

GROUND = "/ground"
_VERSION = "40500"  # of the format, as OpenSim 4.5 and 4.6 write it
_COLOUR = (0.86, 0.78, 0.70)
_GRAVITY = (0.0, -9.80665, 0.0)
_NO_NAME = re.compile(r"[\s/\\*+]+")  # what a component's name may not contain


@dataclass(frozen=True)
class OsimPlacement:
    """A frame in another: rotation (3, 3), translation (3,) [m]."""

    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True)
class OsimShape:
    """Displayed geometry of a segment: an ellipsoid with half-axes size (3,), or a cylinder along its own y axis with
    size (radius, half height) [m]; place: in the segment's frame."""

    size: tuple[float, ...]
    place: OsimPlacement


@dataclass(frozen=True)
class Segment:
    """A rigid body: mass [kg], centre (3,) of mass [m], inertia (3, 3) about it [kg m2], in the segment's frame."""

    name: str
    mass: float
    centre: np.ndarray
    inertia: np.ndarray
    shapes: tuple[OsimShape, ...] = ()


@dataclass(frozen=True)
class Axis:
    """A coordinate [rad or m] that turns about, or slides along, a direction (3,); it stays inside limits, None where
    there are none."""

    coordinate: str
    direction: np.ndarray
    default: float = 0.0
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Joint:
    """The joint of `child` on `parent` (names of segments, `GROUND` for the world).

    on_parent, on_child: the joint's frames in those of the segments. In on_parent the child first slides along
    `slides`, then turns about `turns`, each about its direction as the turns before have left it; three at most of
    either. Without any the child is welded.
    """

    name: str
    parent: str
    child: str
    on_parent: OsimPlacement
    on_child: OsimPlacement
    turns: tuple[Axis, ...] = ()
    slides: tuple[Axis, ...] = ()


@dataclass(frozen=True)
class Coupling:
    """A coordinate that follows another, of this joint or any: its value is slope times its leader's, plus intercept
    [rad or m]."""

    follower: str
    leader: str
    slope: float
    intercept: float


@dataclass(frozen=True)
class OsimMarker:
    """A named point (3,) [m] of a segment."""

    name: str
    segment: str
    place: np.ndarray


@dataclass(frozen=True)
class Model:
    """A whole model; segments and joints from the root outwards."""

    name: str
    credits: str
    segments: tuple[Segment, ...]
    joints: tuple[Joint, ...]
    markers: tuple[OsimMarker, ...]
    couplings: tuple[Coupling, ...] = ()


def component_name(text: str) -> str:
    """A name as OpenSim takes it: without blanks, slashes, stars and pluses."""
    return _NO_NAME.sub("_", text.strip()) or "_"


def write_osim(path: Path, model: Model) -> None:
    """Write a model file."""
    document = ET.Element("OpenSimDocument", Version=_VERSION)
    root = ET.SubElement(document, "Model", name=component_name(model.name))
    _text(root, "gravity", _numbers(_GRAVITY))
    _text(root, "credits", model.credits)
    _text(root, "length_units", "meters")
    _text(root, "force_units", "N")
    _add_set(root, "BodySet", "bodyset", map(_segment, model.segments))
    _add_set(root, "JointSet", "jointset", map(_joint, model.joints))
    if model.couplings:
        _add_set(root, "ConstraintSet", "constraintset", map(_coupling, model.couplings))
    _add_set(root, "MarkerSet", "markerset", map(_marker, model.markers))
    ET.indent(document, "  ")
    text = ET.tostring(document, encoding="unicode")
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', encoding="utf-8")


def _add_set(root: ET.Element, kind: str, name: str, members: Iterable[ET.Element]) -> None:
    objects = ET.SubElement(ET.SubElement(root, kind, name=name), "objects")
    objects.extend(list(members))


def _segment(segment: Segment) -> ET.Element:
    body = ET.Element("Body", name=segment.name)
    if segment.shapes:
        components = ET.SubElement(body, "components")
        for i, shape in enumerate(segment.shapes, 1):
            frame = _frame(f"{segment.name}_shape_{i}", "..", shape.place)
            frame.insert(0, _displayed(f"{segment.name}_geometry_{i}", shape))
            components.append(frame)
    _text(body, "mass", repr(float(segment.mass)))
    _text(body, "mass_center", _numbers(segment.centre))
    moments = segment.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    _text(body, "inertia", _numbers(moments))
    return body


def _displayed(name: str, shape: OsimShape) -> ET.Element:
    attached = ET.Element("attached_geometry")
    if len(shape.size) == 3:
        geometry = ET.SubElement(attached, "Ellipsoid", name=name)
        _text(geometry, "radii", _numbers(shape.size))
    else:
        geometry = ET.SubElement(attached, "Cylinder", name=name)
        _text(geometry, "radius", repr(float(shape.size[0])))
        _text(geometry, "half_height", repr(float(shape.size[1])))
    _text(geometry, "socket_frame", "..")
    _text(ET.SubElement(geometry, "Appearance"), "color", _numbers(_COLOUR))
    return attached


def _joint(joint: Joint) -> ET.Element:
    axes = (*joint.turns, *joint.slides)
    element = ET.Element("CustomJoint" if axes else "WeldJoint", name=joint.name)
    ends = {"parent": (joint.parent, joint.on_parent), "child": (joint.child, joint.on_child)}
    names = {end: f"{segment.strip('/')}_{end}_offset" for end, (segment, _) in ends.items()}
    for end, name in names.items():
        _text(element, f"socket_{end}_frame", name)
    if axes:
        coordinates = ET.SubElement(element, "coordinates")
        turning = [True] * len(joint.turns) + [False] * len(joint.slides)
        coordinates.extend([_coordinate(axis, turns) for axis, turns in zip(axes, turning, strict=True)])
    frames = ET.SubElement(element, "frames")
    for end, (segment, place) in ends.items():
        frames.append(_frame(names[end], GROUND if segment == GROUND else f"/bodyset/{segment}", place))
    if axes:
        transform = ET.SubElement(element, "SpatialTransform")
        for kind, chosen in (("rotation", joint.turns), ("translation", joint.slides)):
            for i, direction in enumerate(_three(chosen)):
                coordinate = chosen[i].coordinate if i < len(chosen) else ""
                transform.append(_transform_axis(f"{kind}{i + 1}", coordinate, direction))
    return element


def _coordinate(axis: Axis, turns: bool) -> ET.Element:
    element = ET.Element("Coordinate", name=axis.coordinate)
    free = np.pi if turns else 10.0  # where there is no limit: what a slider of the program shows
    _text(element, "default_value", repr(float(axis.default)))
    _text(element, "range", _numbers(axis.limits or (-free, free)))
    _text(element, "clamped", "false" if axis.limits is None else "true")
    _text(element, "locked", "false")
    return element


def _three(axes: Sequence[Axis]) -> np.ndarray:
    """The directions of up to three axes, completed to (3, 3): OpenSim requires three independent ones."""
    known = [np.asarray(axis.direction) / np.linalg.norm(axis.direction) for axis in axes]
    if not known:
        return np.eye(3)
    if len(known) == 1:
        aside = np.eye(3)[np.argmin(np.abs(known[0]))]
        known.append(np.cross(known[0], aside) / np.linalg.norm(np.cross(known[0], aside)))
    if len(known) == 2:
        across = np.cross(known[0], known[1])
        known.append(across / np.linalg.norm(across))
    return np.array(known)


def _transform_axis(name: str, coordinate: str, direction: np.ndarray) -> ET.Element:
    element = ET.Element("TransformAxis", name=name)
    _text(element, "coordinates", coordinate)
    _text(element, "axis", _numbers(direction))
    if coordinate:
        _linear(element, 1.0, 0.0)
    else:
        _text(ET.SubElement(element, "Constant", name="function"), "value", "0")
    return element


def _linear(parent: ET.Element, slope: float, intercept: float) -> None:
    _text(ET.SubElement(parent, "LinearFunction", name="function"), "coefficients", _numbers((slope, intercept)))


def _coupling(coupling: Coupling) -> ET.Element:
    """A constraint between coordinates: the axes of a joint can be functions of that joint's own coordinates alone."""
    element = ET.Element("CoordinateCouplerConstraint", name=f"{coupling.follower}_follows_{coupling.leader}")
    _text(element, "isEnforced", "true")
    _linear(ET.SubElement(element, "coupled_coordinates_function"), coupling.slope, coupling.intercept)
    _text(element, "independent_coordinate_names", coupling.leader)
    _text(element, "dependent_coordinate_name", coupling.follower)
    return element


def _frame(name: str, parent: str, place: OsimPlacement) -> ET.Element:
    element = ET.Element("PhysicalOffsetFrame", name=name)
    _text(element, "socket_parent", parent)
    _text(element, "translation", _numbers(place.translation))
    _text(element, "orientation", _numbers(body_xyz(place.rotation)))
    return element


def body_xyz(R: np.ndarray) -> np.ndarray:
    """Turns (3,) [rad] about x, y, z, each about the axis as the turns before have left it: Rx Ry Rz = R."""
    b = np.arctan2(R[0, 2], np.hypot(R[0, 0], R[0, 1]))
    if np.hypot(R[0, 0], R[0, 1]) < 1e-9:  # x and z then turn about one line: all of it is given to x
        return np.array([np.arctan2(R[2, 1], R[1, 1]), b, 0.0])
    return np.array([np.arctan2(-R[1, 2], R[2, 2]), b, np.arctan2(-R[0, 1], R[0, 0])])


def _marker(marker: OsimMarker) -> ET.Element:
    element = ET.Element("Marker", name=component_name(marker.name))
    _text(element, "socket_parent_frame", f"/bodyset/{marker.segment}")
    _text(element, "location", _numbers(marker.place))
    _text(element, "fixed", "true")
    return element


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(v) + 0.0) for v in values)  # + 0.0: no negative zeros
