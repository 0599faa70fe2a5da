"""The visual and collision shapes of a URDF as its text gives them: kind, sizes, file, place, colour."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from humanoid.subject.subject import Subject
from humanoid.subject.urdf_document import Document, elements, read_document
from viz.palette import Rgb

Kind = Literal["visual", "collision"]
_SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}


@dataclass(frozen=True)
class VisualShape:
    """One <visual> or <collision>.

    link: the link that carries it. kind: box, sphere, cylinder, capsule or mesh. size: box (x, y, z), sphere (radius),
    cylinder and capsule (radius, length) [m], mesh (its scale). file: of a mesh, else empty.
    T_link_shape. colour: of its material, None where the URDF gives it none.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    file: str
    T_link_shape: pin.SE3
    colour: Rgb | None


def shapes_of(subject: Subject, kind: Kind) -> tuple[VisualShape, ...]:
    """All shapes of one kind that can be seen, in the file's order; raises InputError where the text is damaged."""
    document = read_document(subject.urdf, subject.source)
    materials = _materials(document)
    shapes = []
    for link in elements(document.root, "link"):
        for element in elements(link, kind):
            shape = _shape(document, link, element, materials)
            if shape is not None:
                shapes.append(shape)
    return tuple(shapes)


def _shape(
    document: Document, link: ET.Element, element: ET.Element, materials: dict[str, tuple[Rgb, float]]
) -> VisualShape | None:
    geometry = element.find("geometry")
    shape = next(elements(geometry), None) if geometry is not None else None
    if shape is None:
        return None
    if shape.tag == "mesh":
        size: tuple[float, ...] = document.triple(shape, "scale", "1 1 1")
    else:
        size = tuple(v for key in _SIZES[shape.tag] for v in document.numbers(shape, key, 3 if key == "size" else 1))
    material = element.find("material")
    look = None if material is None else _look(material) or materials.get(material.get("name", ""))
    if look is not None and look[1] == 0.0:  # wholly transparent
        return None
    place = element.find("origin")
    T_link_shape = pin.SE3.Identity()
    if place is not None:
        rpy, xyz = document.triple(place, "rpy"), document.triple(place, "xyz")
        T_link_shape = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    name, file = link.get("name", ""), shape.get("filename", "")
    return VisualShape(name, shape.tag, size, file, T_link_shape, None if look is None else look[0])


def _materials(document: Document) -> dict[str, tuple[Rgb, float]]:
    """Colour and opacity by name; a material may be defined anywhere and used anywhere."""
    looks: dict[str, tuple[Rgb, float]] = {}
    for material in document.root.iter("material"):
        look, name = _look(material), material.get("name", "")
        if look is not None and name:
            looks.setdefault(name, look)
    return looks


def _look(material: ET.Element) -> tuple[Rgb, float] | None:
    """Colour and opacity; None where the element has no valid colour."""
    colour = material.find("color")
    try:
        parts = [float(part) for part in colour.get("rgba", "").split()] if colour is not None else []
    except ValueError:
        return None
    if len(parts) not in (3, 4) or not all(math.isfinite(part) for part in parts):
        return None
    r, g, b = (round(255.0 * min(max(part, 0.0), 1.0)) for part in parts[:3])
    return (r, g, b), (parts[3] if len(parts) == 4 else 1.0)
