"""Triangle meshes made lighter, and their normals kept sharp at edges."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

_REGULARISATION = 3e-3  # of the quadrics, as a share of their trace: what keeps flat places from sliding along
_SHARP = 0.7  # cosine; faces that meet at more than about 45 degrees meet at an edge


class Triangles(NamedTuple):
    """vertices (V, 3) [m], faces (F, 3) int, counter-clockwise from outside, and a number for every face, (F,) int."""

    vertices: np.ndarray
    faces: np.ndarray
    label: np.ndarray

    @property
    def area(self) -> float:
        """Area of all faces [m^2]."""
        return float(np.linalg.norm(_across(self), axis=1).sum() / 2.0)


def clustered(mesh: Triangles, cell: float) -> Triangles:
    """All vertices within a cube of `cell` [m] made one, where the planes of the faces around them meet best.

    Faces keep their orientation and label. The place is the least-squares one of P. Lindstrom, "Out-of-core
    simplification of large polygonal models", SIGGRAPH 2000, pulled to the middle of its vertices where it is not
    determined.
    """
    cells = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    _, cluster = np.unique(_number(cells), return_inverse=True)
    faces = cluster[mesh.faces]
    places = _meeting_points(mesh, faces, int(faces.max()) + 1, cell)
    return _compact(places, *_proper(faces, mesh.label))


def merged_vertices(mesh: Triangles) -> Triangles:
    """Vertices at the same place made one, faces without extent left out."""
    size = float(np.ptp(mesh.vertices, axis=0).max())
    rounded = np.round((mesh.vertices - mesh.vertices.min(axis=0)) / max(1e-6 * size, 1e-12)).astype(np.int64)
    _, first, same = np.unique(_number(rounded), return_index=True, return_inverse=True)
    return _compact(mesh.vertices[first], *_proper(same[mesh.faces], mesh.label))


def creased(mesh: Triangles) -> Triangles:
    """The mesh with its vertices parted along sharp edges, so that mean normals at vertices shade them as edges."""
    count = len(mesh.faces)
    across = _across(mesh)
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    start, end = _directed_edges(mesh)
    corner = np.arange(3 * count)  # corner k of face f is 3 f + k; each begins an edge and the next corner ends it
    after = np.roll(corner.reshape(-1, 3), -1, axis=1).reshape(-1)
    low, high = np.where(start < end, corner, after), np.where(start < end, after, corner)
    edge = _number(np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1))
    order = np.argsort(edge, kind="stable")
    a, b = order[:-1], order[1:]
    smooth = (edge[a] == edge[b]) & (np.einsum("ni,ni->n", normal[a // 3], normal[b // 3]) > _SHARP)
    a, b = a[smooth], b[smooth]
    rows, columns = np.concatenate([low[a], high[a]]), np.concatenate([low[b], high[b]])
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(3 * count, 3 * count))
    groups, group = connected_components(links, directed=False)
    vertices = np.empty((groups, 3))
    vertices[group] = mesh.vertices[start]
    return Triangles(vertices, group.reshape(-1, 3).astype(np.int64), mesh.label)


def oriented(mesh: Triangles) -> bool:
    """The mesh is nearly closed and nearly all faces agree with their neighbours on which side is outside."""
    start, end = _directed_edges(mesh)
    directed = len(np.unique(_number(np.stack([start, end], axis=1))))
    edges = len(np.unique(_number(np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1))))
    p = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    volume = np.einsum("fi,fi->", p[:, 0], np.cross(p[:, 1], p[:, 2]))
    agree, closed = directed > 0.98 * len(start), 2 * edges < 1.02 * len(start)
    return bool(volume > 0.0 and agree and closed)


def _directed_edges(mesh: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """First and last vertex of every side of every face, (3 F,) each."""
    return mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)


def _number(rows: np.ndarray) -> np.ndarray:
    """One number for each row of small whole numbers (N, 2 or 3): quicker to compare than the rows."""
    sizes = rows.max(axis=0, initial=0) + 1
    number = rows[:, 0]
    for column, size in zip(rows.T[1:], sizes[1:], strict=True):
        number = number * size + column
    return np.asarray(number)


def _across(mesh: Triangles) -> np.ndarray:
    """Normals as long as twice the areas, (F, 3)."""
    p = mesh.vertices[mesh.faces]
    return np.asarray(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))


def _meeting_points(mesh: Triangles, faces: np.ndarray, count: int, cell: float) -> np.ndarray:
    across = _across(mesh)
    area = np.linalg.norm(across, axis=1)
    normal = across / np.maximum(area, 1e-300)[:, None]
    area = np.maximum(area, 1e-9 * cell**2)  # so that a cluster of slivers has a middle too
    corner, weight = faces.reshape(-1), np.repeat(area, 3)
    total = np.bincount(corner, weight, count)
    middle = _summed(corner, weight[:, None] * mesh.vertices[mesh.faces].reshape(-1, 3), count) / total[:, None]
    outer = np.repeat(area[:, None] * (normal[:, :, None] * normal[:, None, :]).reshape(-1, 9), 3, axis=0)
    A = _summed(corner, outer, count).reshape(-1, 3, 3)
    distance = np.einsum("fi,fi->f", normal, mesh.vertices[mesh.faces[:, 0]])
    b = _summed(corner, np.repeat((area * distance)[:, None] * normal, 3, axis=0), count)
    residual = b - np.einsum("nij,nj->ni", A, middle)
    A += _REGULARISATION * total[:, None, None] * np.eye(3)
    step = np.linalg.solve(A, residual[:, :, None])[:, :, 0]
    return np.asarray(middle + np.clip(step, -cell, cell))


def _summed(where: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Rows of values (N, D) summed by the place they belong to, (count, D)."""
    return np.stack([np.bincount(where, column, count) for column in values.T], axis=1)


def _proper(faces: np.ndarray, label: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces with three different corners, each once."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces, label = faces[proper], label[proper]
    first = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    _, kept = np.unique(_number(turned), return_index=True)
    return faces[np.sort(kept)], label[np.sort(kept)]


def _compact(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray) -> Triangles:
    used, index = np.unique(faces, return_inverse=True)
    return Triangles(vertices[used], index.reshape(-1, 3).astype(np.int64), label)
