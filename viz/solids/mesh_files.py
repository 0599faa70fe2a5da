"""Mesh files as triangles with their own colours."""

from __future__ import annotations

import logging
import warnings
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from humanoid.shape.collada_check import collada_unit
from humanoid.support.errors import InputError
from viz.palette import Rgb
from viz.solids.decimation import Triangles, merged_vertices

if TYPE_CHECKING:
    import trimesh

_KINDS = (".stl", ".dae", ".obj", ".ply", ".off", ".glb", ".gltf")  # not archives, which trimesh would unpack
_LARGEST = 200_000_000  # bytes
_FARTHEST = 1e9  # of coordinates, in any unit
_SHADES = 12  # colours of one mesh; where it has more it gets their mean
_REMEDY = "fix or replace the file, or leave this shape out of the URDF"

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # its complaints, with tracebacks, are not for users


class ColouredMesh(NamedTuple):
    """triangles in metres if the file declares its unit (COLLADA), else in its own; their labels are places in
    `colours`, where None means no colour."""

    triangles: Triangles
    colours: tuple[Rgb | None, ...]


class MeshFile(NamedTuple):
    """A file as it was at one moment: path, time of its last change [ns] and size [bytes]."""

    path: str
    changed: int
    size: int


def mesh_file(path: str) -> MeshFile | None:
    """The file's current content; None without a file."""
    try:
        about = Path(path).stat()
    except (OSError, ValueError):
        return None
    return MeshFile(path, about.st_mtime_ns, about.st_size) if Path(path).is_file() else None


@lru_cache(maxsize=256)
def read_mesh(file: MeshFile) -> ColouredMesh:
    """All triangles of a mesh file, see `ColouredMesh`; read once as long as it does not change.

    Raises
    ------
    InputError: it is of another kind, too large, cannot be read, has no triangles, or absurd coordinates.
    """
    if Path(file.path).suffix.lower() not in _KINDS:
        raise InputError(file.path, "is not a mesh format that can be drawn", remedy="one of " + " ".join(_KINDS))
    if file.size > _LARGEST:
        raise InputError(file.path, f"is larger than {_LARGEST // 1_000_000} MB", remedy="give a lighter mesh")
    import trimesh  # slow to import, and only needed for URDFs without flesh

    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # errors of a file are reported below, once
            loaded = trimesh.load(file.path, process=False)
        pieces = [piece for piece in _pieces(loaded) if len(piece[0])]
    except Exception as error:  # each of trimesh's readers raises what its parsing meets
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(file.path, f"the mesh cannot be read ({reason})", remedy=_REMEDY) from error
    if not pieces:
        raise InputError(file.path, "the mesh has no triangles", remedy=_REMEDY)
    if not all(np.isfinite(corners).all() for corners, _, _ in pieces):
        raise InputError(file.path, "the mesh has coordinates that are not finite", remedy=_REMEDY)
    if not all(np.abs(corners).max() < _FARTHEST for corners, _, _ in pieces):
        raise InputError(file.path, "the mesh has coordinates out of range", remedy="metres or millimetres are meant")
    unit = collada_unit(Path(file.path)) if file.path.lower().endswith(".dae") else 1.0
    mesh = _joined([(unit * corners, label, colours) for corners, label, colours in pieces])
    if len(mesh.triangles.faces) == 0:
        raise InputError(file.path, "the mesh has no triangles with an extent", remedy=_REMEDY)
    return mesh


def _pieces(loaded: Any) -> list[tuple[np.ndarray, np.ndarray, tuple[Rgb | None, ...]]]:
    """Corners (F, 3, 3), label (F,) and colours of everything in a file that has triangles."""
    import trimesh

    scene = loaded if isinstance(loaded, trimesh.Scene) else trimesh.Scene(loaded)
    pieces = []
    for node in scene.graph.nodes_geometry:
        T_file_piece, name = scene.graph[node]
        piece = scene.geometry[name]
        if isinstance(piece, trimesh.Trimesh):
            vertices = np.asarray(piece.vertices) @ T_file_piece[:3, :3].T + T_file_piece[:3, 3]
            pieces.append((vertices[np.asarray(piece.faces)], *_colours(piece)))
    return pieces


def _colours(piece: trimesh.Trimesh) -> tuple[np.ndarray, tuple[Rgb | None, ...]]:
    """Label (F,) and colours of one piece."""
    visual: Any = piece.visual
    single = np.zeros(len(piece.faces), dtype=np.int64)
    if not visual.defined:
        return single, (None,)
    if visual.kind in ("face", "vertex"):
        shades, label = np.unique(np.asarray(visual.face_colors)[:, :3], axis=0, return_inverse=True)
        if len(shades) <= _SHADES:
            return label.reshape(-1), tuple(_rgb(shade) for shade in shades)
        return single, (_rgb(np.asarray(visual.face_colors)[:, :3].mean(axis=0)),)
    material = visual.material
    colour = getattr(material, "main_color", None)
    colour = np.full(3, 255.0) if colour is None else np.asarray(colour, dtype=np.float64)[:3]
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None:
        colour = np.asarray(image.convert("RGB"), dtype=np.float64).mean(axis=(0, 1))
    return single, (_rgb(colour),)


def _rgb(colour: np.ndarray) -> Rgb:
    r, g, b = np.clip(np.round(colour[:3]), 0, 255).astype(int).tolist()
    return r, g, b


def _joined(pieces: list[tuple[np.ndarray, np.ndarray, tuple[Rgb | None, ...]]]) -> ColouredMesh:
    starts = np.cumsum([0] + [len(colours) for _, _, colours in pieces])
    corners = np.concatenate([piece[0] for piece in pieces]).reshape(-1, 3)
    label = np.concatenate([piece[1] + start for piece, start in zip(pieces, starts, strict=False)])
    triangles = Triangles(corners, np.arange(len(corners)).reshape(-1, 3), label)
    return ColouredMesh(merged_vertices(triangles), tuple(c for _, _, colours in pieces for c in colours))
