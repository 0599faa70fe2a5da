"""Triangle meshes: vertices joined and parted, what is outside, edges kept sharp."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

_SHARP = 0.7  # cosine; faces that meet at more than about 45 degrees meet at an edge


class Triangles(NamedTuple):
    """vertices (V, 3) [m], faces (F, 3) int, counter-clockwise from outside, and a number for every face, (F,) int."""

    vertices: np.ndarray
    faces: np.ndarray
    label: np.ndarray


def merged_vertices(mesh: Triangles) -> Triangles:
    """Vertices at the same place made one, faces without extent left out."""
    size = float(np.ptp(mesh.vertices, axis=0).max())
    rounded = np.round((mesh.vertices - mesh.vertices.min(axis=0)) / max(1e-6 * size, 1e-12)).astype(np.int64)
    _, first, same = np.unique(numbered(rounded), return_index=True, return_inverse=True)
    return compact(mesh.vertices[first], *proper(same[mesh.faces], mesh.label))


def creased(mesh: Triangles) -> Triangles:
    """The mesh with its vertices parted along sharp edges, so that mean normals at vertices shade them as edges."""
    count = len(mesh.faces)
    normal = across(mesh.vertices, mesh.faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    start, end = directed_edges(mesh)
    corner = np.arange(3 * count)  # corner k of face f is 3 f + k; each begins an edge and the next corner ends it
    after = np.roll(corner.reshape(-1, 3), -1, axis=1).reshape(-1)
    low, high = np.where(start < end, corner, after), np.where(start < end, after, corner)
    edge = numbered(np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1))
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
    start, end = directed_edges(mesh)
    directed = len(np.unique(numbered(np.stack([start, end], axis=1))))
    edges = len(np.unique(numbered(np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1))))
    p = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    volume = np.einsum("fi,fi->", p[:, 0], np.cross(p[:, 1], p[:, 2]))
    agree, closed = directed > 0.98 * len(start), 2 * edges < 1.02 * len(start)
    return bool(volume > 0.0 and agree and closed)


def directed_edges(mesh: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """First and last vertex of every side of every face, (3 F,) each."""
    return mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)


def numbered(rows: np.ndarray) -> np.ndarray:
    """One number for each row of small whole numbers (N, 2 or 3): quicker to compare than the rows."""
    sizes = rows.max(axis=0, initial=0) + 1
    number = rows[:, 0]
    for column, size in zip(rows.T[1:], sizes[1:], strict=True):
        number = number * size + column
    return np.asarray(number)


def across(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals of faces as long as twice their areas, (F, 3)."""
    p = vertices[faces]
    return np.asarray(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))


def proper(faces: np.ndarray, label: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces with three different corners, each once."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces, label = faces[proper], label[proper]
    first = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    _, kept = np.unique(numbered(turned), return_index=True)
    return faces[np.sort(kept)], label[np.sort(kept)]


def compact(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray) -> Triangles:
    """The mesh without the vertices that no face has."""
    used, index = np.unique(faces, return_inverse=True)
    return Triangles(vertices[used], index.reshape(-1, 3).astype(np.int64), label)
