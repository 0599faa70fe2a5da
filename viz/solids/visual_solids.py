"""The visual geometry of a URDF as solids: its own shapes and colours, with only as many triangles as can be seen.

The visual and collision shapes of a URDF as its text gives them: kind, sizes, file, place, colour.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.surface_hulls import vertex_normals
from humanoid.subject.subject import Subject
from humanoid.subject.urdf_document import Document, elements, read_document
from humanoid.support.errors import InputError
from viz import palette
from viz.palette import Rgb
from viz.solids.decimation import Triangles, compact, creased, merged_vertices, oriented, simplified
from viz.solids.mesh_files import ColouredMesh, MeshFile, mesh_file, read_mesh
from viz.solids.solid import DrawnMesh, side_of

if TYPE_CHECKING:
    import trimesh


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


FINE, COARSE = 18_000, 5_000  # triangles of a whole body
_FACETS = 24


class VisualSolids(NamedTuple):
    """solids: what can be drawn. bare: links whose meshes are missing and that have nothing to stand in for them."""

    solids: tuple[DrawnMesh, ...]
    bare: tuple[str, ...]


class _Source(NamedTuple):
    """Key of a shape's triangles: all that they depend on."""

    kind: str
    size: tuple[float, ...]
    file: MeshFile | None


class _Piece(NamedTuple):
    """Triangles of one colour in the frame of their shape."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    colour: Rgb | None
    closed: bool


def visual_solids(body: Body, *, coarse: bool = False) -> VisualSolids:
    """A body's visual shapes, or where it has none its collision shapes, on their joints.

    A link whose visual mesh is missing gets its collision shapes instead. A URDF's material takes precedence over the
    colours of a mesh; a body without any colours is coloured by its sides. coarse: fewer triangles, enough for a
    translucent hypothesis.

    Raises
    ------
    InputError: a mesh cannot be read, or its coordinates are not finite; it names the file and the link.
    """
    shapes, bare = _shapes(body)
    if not shapes:
        return VisualSolids((), bare)
    sources = [_source(shape) for shape in shapes]
    for shape, source in zip(shapes, sources, strict=True):
        _check(shape, source)
    pieces = _lightened(tuple(sources), COARSE if coarse else FINE)
    own = any(
        shape.colour or piece.colour for shape, of_shape in zip(shapes, pieces, strict=True) for piece in of_shape
    )
    placed = [_placed(body, s, p, own) for s, of_shape in zip(shapes, pieces, strict=True) for p in of_shape]
    return VisualSolids(tuple(placed), bare)


def missing_meshes(body: Body) -> tuple[VisualShape, ...]:
    """The visual meshes that are missing."""
    return tuple(shape for shape in shapes_of(body.subject, "visual") if _missing(shape))


def _missing(shape: VisualShape) -> bool:
    return shape.kind == "mesh" and mesh_file(shape.file) is None


def _shapes(body: Body) -> tuple[tuple[VisualShape, ...], tuple[str, ...]]:
    """The solids to draw, and the links whose shapes are missing."""
    wanted = shapes_of(body.subject, "visual")
    lost = {shape.link for shape in wanted if _missing(shape)}
    if wanted and not lost:
        return wanted, ()
    collision = shapes_of(body.subject, "collision")
    if not wanted:
        return tuple(shape for shape in collision if _readable(shape)), ()
    stand_ins = [shape for shape in collision if shape.link in lost and _readable(shape)]
    bare = lost - {shape.link for shape in stand_ins}
    return (*(shape for shape in wanted if not _missing(shape)), *stand_ins), tuple(sorted(bare))


def _readable(shape: VisualShape) -> bool:
    """A shape that only stands in for another may be left out silently."""
    try:
        _check(shape, _source(shape))
    except InputError:
        return False
    return not _missing(shape)


def _source(shape: VisualShape) -> _Source:
    return _Source(shape.kind, shape.size, mesh_file(shape.file) if shape.kind == "mesh" else None)


def _check(shape: VisualShape, source: _Source) -> None:
    try:
        if source.file is not None:
            read_mesh(source.file)
    except InputError as error:
        raise InputError(error.source, error.problem, place=f"link {shape.link!r}", remedy=error.remedy) from error


def _mesh(source: _Source) -> ColouredMesh:
    """A shape's triangles in its own frame [m]."""
    if source.file is not None:
        mesh = read_mesh(source.file)
        scale = np.array(source.size)
        faces = mesh.triangles.faces if np.prod(scale) > 0.0 else mesh.triangles.faces[:, ::-1]  # mirrored: turned over
        return ColouredMesh(Triangles(mesh.triangles.vertices * scale, faces, mesh.triangles.label), mesh.colours)
    made = _primitive(source.kind, source.size)
    faces = np.asarray(made.faces, dtype=np.int64)
    triangles = Triangles(np.asarray(made.vertices), faces, np.zeros(len(faces), dtype=np.int64))
    return ColouredMesh(merged_vertices(triangles), (None,))


def _primitive(kind: str, size: tuple[float, ...]) -> trimesh.Trimesh:
    import trimesh  # slow to import, and only needed for URDFs without flesh

    if kind == "box":
        return trimesh.creation.box(extents=size)
    if kind == "sphere":
        return trimesh.creation.uv_sphere(radius=size[0], count=[_FACETS // 2, _FACETS])
    if kind == "cylinder":
        return trimesh.creation.cylinder(radius=size[0], height=size[1], sections=_FACETS)
    capsule = trimesh.creation.capsule(radius=size[0], height=size[1], count=[_FACETS, _FACETS])
    capsule.vertices -= capsule.bounds.mean(axis=0)
    return capsule


@lru_cache(maxsize=16)
def _lightened(sources: tuple[_Source, ...], most: int) -> tuple[tuple[_Piece, ...], ...]:
    """Every source's triangles by colour, together about `most`; kept for this process."""
    meshes = {source: _mesh(source) for source in sources}
    light = _light(sources, most)
    pieces = {source: _pieces(light[source], mesh.colours, oriented(mesh.triangles)) for source, mesh in meshes.items()}
    return tuple(pieces[source] for source in sources)


@lru_cache(maxsize=16)
def _light(sources: tuple[_Source, ...], most: int) -> dict[_Source, Triangles]:
    names = list(dict.fromkeys(sources))
    # the coarse ones are made from the fine ones, which are there already
    before = [_mesh(name).triangles for name in names] if most >= FINE else list(_light(sources, FINE).values())
    whole = _together(before)
    counts = {name: len(mesh.faces) for name, mesh in zip(names, before, strict=True)}
    most = most * len(whole.faces) // sum(counts[source] for source in sources)  # what is used twice counts twice
    return dict(zip(names, _apart(simplified(whole, most), before), strict=True))


def _together(meshes: Sequence[Triangles]) -> Triangles:
    """All in one, so that triangles stay where they show most; labels become different ones."""
    vertices = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    labels = np.cumsum([0, *(int(mesh.label.max()) + 1 for mesh in meshes)])
    return Triangles(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, vertices, strict=False)]),
        np.concatenate([mesh.label + start for mesh, start in zip(meshes, labels, strict=False)]),
    )


def _apart(mesh: Triangles, before: Sequence[Triangles]) -> list[Triangles]:
    """The opposite of `_together`; a mesh of which nothing is left stays as it was."""
    labels = np.cumsum([0, *(int(part.label.max()) + 1 for part in before)])
    parts = []
    for part, low, high in zip(before, labels, labels[1:], strict=False):
        own = (mesh.label >= low) & (mesh.label < high)
        parts.append(compact(mesh.vertices, mesh.faces[own], mesh.label[own] - low) if own.any() else part)
    return parts


def _pieces(mesh: Triangles, colours: Sequence[Rgb | None], closed: bool) -> tuple[_Piece, ...]:
    sharp = creased(mesh)
    normals = vertex_normals(sharp.vertices, sharp.faces)
    pieces = []
    for colour in dict.fromkeys(colours):
        chosen = np.isin(sharp.label, [i for i, c in enumerate(colours) if c == colour])
        if chosen.any():
            used, faces = np.unique(sharp.faces[chosen], return_inverse=True)
            pieces.append(_Piece(sharp.vertices[used], faces.reshape(-1, 3), normals[used], colour, closed))
    return tuple(pieces)


def _placed(body: Body, shape: VisualShape, piece: _Piece, own: bool) -> DrawnMesh:
    frame = body.model.frames[body.model.getFrameId(shape.link, pin.FrameType.BODY)]
    T_joint_shape = frame.placement * shape.T_link_shape
    vertices = piece.vertices @ T_joint_shape.rotation.T + T_joint_shape.translation
    normals = piece.normals @ T_joint_shape.rotation.T
    colour = shape.colour or piece.colour or (palette.SIDES["trunk"] if own else None)
    return DrawnMesh(
        shape.link, int(frame.parentJoint), side_of(shape.link), vertices, piece.faces, colour, normals, piece.closed
    )
