"""The visual geometry of a URDF as solids: its own shapes and colours, with only as many triangles as can be seen."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import trimesh

from humanoid.body import Body
from humanoid.errors import InputError
from humanoid.surface_hulls import vertex_normals
from viz import palette
from viz.decimation import Triangles, clustered, creased, merged_vertices, oriented
from viz.mesh_files import ColouredMesh, MeshFile, mesh_file, read_mesh
from viz.palette import Rgb
from viz.solid import Solid, side_of
from viz.visual_shapes import Shape, shapes_of

FINE, COARSE = 18_000, 5_000  # triangles of a whole body
_FEW = 150  # a mesh with no more triangles stays as it is
_KEPT = 14  # cells along the longest side of a small mesh, which keep its shape
_FINER = 0.5  # but its cells are at least so large beside those of the other meshes
_LEAST = 4  # cells along any mesh, and faces of it
_ROUNDS = 6
_FACETS = 24


class VisualSolids(NamedTuple):
    """solids: what can be drawn. bare: links whose meshes are missing and that have nothing to stand in for them."""

    solids: tuple[Solid, ...]
    bare: tuple[str, ...]


class _Source(NamedTuple):
    """What a shape's triangles are made from: all that they depend on."""

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

    A link whose visual mesh is not where the URDF says gets its collision shapes instead. A URDF's material goes before
    the colours of a mesh; a body without any colours is coloured by its sides. coarse: fewer triangles, enough for a
    translucent hypothesis.

    Raises
    ------
    InputError: a mesh cannot be read, or its coordinates are not finite; it names the file and the link.
    """
    shapes, bare = _shapes(body)
    sources = [_source(shape) for shape in shapes]
    for shape, source in zip(shapes, sources, strict=True):
        _check(shape, source)
    pieces = _lightened(tuple(sources), COARSE if coarse else FINE)
    own = any(shape.colour or piece.colour for shape, found in zip(shapes, pieces, strict=True) for piece in found)
    placed = [_placed(body, s, p, own) for s, found in zip(shapes, pieces, strict=True) for p in found]
    return VisualSolids(tuple(placed), bare)


def missing_meshes(body: Body) -> tuple[Shape, ...]:
    """The visual meshes that are not, or not any more, where the URDF says."""
    return tuple(shape for shape in shapes_of(body.subject, "visual") if _missing(shape))


def _missing(shape: Shape) -> bool:
    return shape.kind == "mesh" and mesh_file(shape.file) is None


def _shapes(body: Body) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """What to draw, and the links that something should be drawn for but nothing is there."""
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


def _readable(shape: Shape) -> bool:
    """A shape that only stands in for another may be left out silently."""
    try:
        return not _missing(shape) and (shape.kind != "mesh" or _mesh(_source(shape)) is not None)
    except InputError:
        return False


def _source(shape: Shape) -> _Source:
    return _Source(shape.kind, shape.size, mesh_file(shape.file) if shape.kind == "mesh" else None)


def _check(shape: Shape, source: _Source) -> None:
    try:
        _mesh(source)
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
    """Every source's triangles by colour, together not many more than `most`; kept for this process."""
    meshes = {source: _mesh(source) for source in sources}
    light = {source: mesh.triangles for source, mesh in meshes.items()}
    cell = np.sqrt(3.0 * sum(light[source].area for source in sources) / most)
    for _ in range(_ROUNDS):
        count = sum(len(light[source].faces) for source in sources)
        if count <= 1.1 * most:
            break
        light = {source: _light(mesh.triangles, source, cell) for source, mesh in meshes.items()}
        count = sum(len(light[source].faces) for source in sources)
        cell *= np.sqrt(count / most)
    pieces = {source: _pieces(light[source], mesh.colours, oriented(mesh.triangles)) for source, mesh in meshes.items()}
    return tuple(pieces[source] for source in sources)


def _light(mesh: Triangles, source: _Source, cell: float) -> Triangles:
    if source.file is None or len(mesh.faces) <= _FEW:
        return mesh
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    cell = min(cell, max(longest / _KEPT, _FINER * cell), longest / _LEAST)
    while len((found := clustered(mesh, cell)).faces) < _LEAST and cell > 1e-3 * longest:  # thin, all of it in one cell
        cell *= 0.5
    return found if len(found.faces) >= _LEAST else mesh


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


def _placed(body: Body, shape: Shape, piece: _Piece, own: bool) -> Solid:
    frame = body.model.frames[body.model.getFrameId(shape.link, pin.FrameType.BODY)]
    T_joint_shape = frame.placement * shape.T_link_shape
    vertices = piece.vertices @ T_joint_shape.rotation.T + T_joint_shape.translation
    normals = piece.normals @ T_joint_shape.rotation.T
    colour = shape.colour or piece.colour or (palette.SIDES["trunk"] if own else None)
    return Solid(
        shape.link, int(frame.parentJoint), side_of(shape.link), vertices, piece.faces, colour, normals, piece.closed
    )
