"""Meshes with fewer triangles: edges are shortened to points, those first that move the surface least.

M. Garland and P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997, in passes over all
faces instead of with a queue: a pass shortens the cheaper edges, each vertex once.

Triangle meshes: vertices joined and parted, what is outside, edges kept sharp.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from humanoid.support.compiled import jit

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


_RIM = 3.0  # weight of the rims of holes and of colours beside that of the surface
_SHORT = 1e-4  # prefers short edges where all is flat
_TURNED = 0.2  # cosine; a face may not turn by more
_DETERMINED = 1e-6  # planes whose matrix has a smaller determinant have no single best place
_SHARES = (0.3, 0.6, 1.0)  # of the faces, the cheaper ones, that a pass tries; more where fewer bring nothing
_FEWEST = 0.01  # of the faces that a pass has to remove


def simplified(mesh: Triangles, most: int) -> Triangles:
    """The mesh with about `most` triangles, or more where it cannot be simplified further; labels keep their
    borders."""
    vertices, faces, label = mesh.vertices.copy(), mesh.faces, mesh.label
    quadrics, share = _quadrics(mesh), 0
    while len(faces) > most and share < len(_SHARES):
        cost, side = np.empty(len(faces)), np.empty(len(faces), dtype=np.int64)
        _cheapest(vertices, quadrics, faces, cost, side)
        limit = float(np.quantile(cost, _SHARES[share]))
        order = np.argsort(faces.reshape(-1), kind="stable")
        start = np.searchsorted(faces.reshape(-1)[order], np.arange(len(vertices) + 1))
        before, faces = len(faces), faces.copy()
        _pass(vertices, quadrics, faces, start, order // 3, cost, side, limit, len(faces) - most)
        faces, label = proper(faces, label)
        share = share + 1 if before - len(faces) < _FEWEST * before else 0
    return compact(vertices, faces, label)


def _quadrics(mesh: Triangles) -> np.ndarray:
    """Sums of squared distances to the planes of the faces around every vertex, weighted by area, (V, 10).

    The ten are the upper triangle of the symmetric 4 x 4 matrix, row by row.
    """
    normal = across(mesh.vertices, mesh.faces)
    twice = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(twice, 1e-300)[:, None]
    quadrics = np.zeros((len(mesh.vertices), 10))
    for corner in mesh.faces.T:
        _add_planes(quadrics, corner, normal, mesh.vertices[mesh.faces[:, 0]], twice / 2.0)
    face, start, end = _rims(mesh)
    along = mesh.vertices[end] - mesh.vertices[start]
    wall = np.cross(along, normal[face])
    wall /= np.maximum(np.linalg.norm(wall, axis=1), 1e-300)[:, None]
    for corner in (start, end):
        _add_planes(quadrics, corner, wall, mesh.vertices[start], _RIM * np.einsum("ni,ni->n", along, along))
    return quadrics


def _rims(mesh: Triangles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Face, start and end of the sides of faces that no other face of the same label has, (S,) each."""
    start, end = directed_edges(mesh)
    face = np.repeat(np.arange(len(mesh.faces)), 3)
    edge = numbered(np.stack([mesh.label[face], np.minimum(start, end), np.maximum(start, end)], axis=1))
    _, inverse, count = np.unique(edge, return_inverse=True, return_counts=True)
    rim = count[inverse] == 1
    return face[rim], start[rim], end[rim]


@jit
def _add_planes(quadrics, corner, normal, point, weight):  # type: ignore[no-untyped-def]
    """Add the quadrics of planes to those of vertices, quadrics (V, 10), in place.

    Of plane n: corner (N,) int the vertex, normal (N, 3), point (N, 3) on it, weight (N,).
    """
    for n in range(len(corner)):
        x, y, z = normal[n]
        d = -(x * point[n, 0] + y * point[n, 1] + z * point[n, 2])
        plane = (x, y, z, d)
        k = 0
        for i in range(4):
            for j in range(i, 4):
                quadrics[corner[n], k] += weight[n] * plane[i] * plane[j]
                k += 1


@jit
def _error(q, x, y, z):  # type: ignore[no-untyped-def]
    """Weighted squared distance of a place from the planes of quadric q (10,), the upper triangle of a 4 x 4 matrix."""
    return (
        x * (q[0] * x + 2.0 * (q[1] * y + q[2] * z + q[3]))
        + y * (q[4] * y + 2.0 * (q[5] * z + q[6]))
        + z * (q[7] * z + 2.0 * q[8])
        + q[9]
    )


@jit
def _place(q, a, b):  # type: ignore[no-untyped-def]
    """Cost and point to which an edge from a to b (3,) of quadric q (10,) is contracted: cost, x, y, z."""
    length = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
    extra = _SHORT * length * length
    c00, c01, c02 = q[4] * q[7] - q[5] * q[5], q[2] * q[5] - q[1] * q[7], q[1] * q[5] - q[2] * q[4]
    determinant = q[0] * c00 + q[1] * c01 + q[2] * c02
    if determinant > _DETERMINED * (q[0] + q[4] + q[7]) ** 3:
        c11, c12, c22 = q[0] * q[7] - q[2] * q[2], q[1] * q[2] - q[0] * q[5], q[0] * q[4] - q[1] * q[1]
        x = -(c00 * q[3] + c01 * q[6] + c02 * q[8]) / determinant
        y = -(c01 * q[3] + c11 * q[6] + c12 * q[8]) / determinant
        z = -(c02 * q[3] + c12 * q[6] + c22 * q[8]) / determinant
        far = (x - a[0]) ** 2 + (y - a[1]) ** 2 + (z - a[2]) ** 2
        if far < 4.0 * length:
            return _error(q, x, y, z) + extra, x, y, z
    best, x, y, z = _error(q, a[0], a[1], a[2]), a[0], a[1], a[2]
    cost = _error(q, b[0], b[1], b[2])
    if cost < best:
        best, x, y, z = cost, b[0], b[1], b[2]
    u, v, w = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    cost = _error(q, u, v, w)
    if cost < best:
        best, x, y, z = cost, u, v, w
    return best + extra, x, y, z


@jit
def _cheapest(vertices, quadrics, faces, cost, side):  # type: ignore[no-untyped-def]
    """For every face the edge that is contracted at the least cost, into side (F,), and that cost (F,).

    vertices (V, 3), quadrics (V, 10), faces (F, 3) int.
    """
    for f in range(len(faces)):
        cost[f] = np.inf
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            least = _place(quadrics[a] + quadrics[b], vertices[a], vertices[b])[0]
            if least < cost[f]:
                cost[f], side[f] = least, k


@jit
def _folds(vertices, faces, around, low, high, moved, other, place):  # type: ignore[no-untyped-def]
    """Whether a face around `moved` that stays turns over when that vertex goes to `place` (3,).

    vertices (V, 3), faces (F, 3) int; around (A,) int, from low to high: the faces around it. other: the vertex that
    becomes one with it.
    """
    for at in range(low, high):
        face = faces[around[at]]
        if face[0] == other or face[1] == other or face[2] == other:
            continue  # vanishes
        k = 0 if face[0] == moved else (1 if face[1] == moved else 2)
        u, v = vertices[face[(k + 1) % 3]], vertices[face[(k + 2) % 3]]
        a, b, c = _normal(vertices[moved], u, v)
        x, y, z = _normal(place, u, v)
        if a * x + b * y + c * z < _TURNED * np.sqrt((a * a + b * b + c * c) * (x * x + y * y + z * z)):
            return True
    return False


@jit
def _normal(p, u, v):  # type: ignore[no-untyped-def]
    """(u - p) x (v - p) of points p, u, v (3,)."""
    a, b, c = u[0] - p[0], u[1] - p[1], u[2] - p[2]
    x, y, z = v[0] - p[0], v[1] - p[1], v[2] - p[2]
    return b * z - c * y, c * x - a * z, a * y - b * x


@jit
def _pass(vertices, quadrics, faces, start, around, cost, side, limit, most):  # type: ignore[no-untyped-def]
    """Shorten edges whose cost is at most `limit` until `most` faces have vanished; all in place.

    vertices (V, 3), quadrics (V, 10), faces (F, 3) int. start (V + 1,), around (A,): the faces around every vertex, one
    after the other. cost (F,), side (F,): see `_cheapest`. A face that vanishes has two corners in one.
    """
    touched = np.zeros(len(vertices), dtype=np.bool_)
    gone = 0
    for f in range(len(faces)):
        if gone >= most:
            break
        a, b = faces[f, side[f]], faces[f, (side[f] + 1) % 3]
        if cost[f] > limit or a == b or touched[a] or touched[b]:
            continue
        quadric = quadrics[a] + quadrics[b]
        _, x, y, z = _place(quadric, vertices[a], vertices[b])
        place = np.array([x, y, z])
        if _folds(vertices, faces, around, start[a], start[a + 1], a, b, place):
            continue
        if _folds(vertices, faces, around, start[b], start[b + 1], b, a, place):
            continue
        vertices[a], quadrics[a] = place, quadric
        touched[a] = touched[b] = True
        for at in range(start[b], start[b + 1]):
            g = around[at]
            for k in range(3):
                if faces[g, k] == a:
                    gone += 1
                if faces[g, k] == b:
                    faces[g, k] = a
