"""Features of a limb in a picture: responses along its outline and axis, and the foreground."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from estimator.data.cameras.projection import project_point
from estimator.trackers.loose_limbed.limbs.ridges import Ridges
from humanoid.limbs.limb import Limb
from humanoid.support.compiled import jit

FEATURES = (
    "left edge", "right edge", "ridge", "inside proximal", "inside distal", "left beside", "right beside",
    "beyond proximal", "beyond distal",
)  # fmt: skip
"""Means along the limb. Edges: first derivative across it, on its outline, either sign [grey values]. Ridge: second
derivative across less that along it, on its axis [grey values]. The rest are shares of the person: within the nearer
half and the farther half, beside the outline, and beyond both ends, without which limbs slide along their axes."""

CUES = {"edges": (0, 1), "ridges": (2,), "foreground": (3, 4, 5, 6, 7, 8)}
"""Features by cue."""

SWAPPED = (1, 0, 2, 3, 4, 6, 5, 7, 8)
"""Each feature's place in the mirror image of the picture."""

SCENE, PERSON, UNKNOWN = 0, 1, 2
"""Values of a foreground map."""

_STATIONS = 6
_FOREGROUND = 3  # index of the first feature that needs the place of the person
_INSIDE = 0.55  # of the half-width, where the inside is sampled beside the axis
_BESIDE, _AWAY = 1.3, 1.5  # of the half-width, and px more, where the outside is sampled
_BEYOND = 1.0 / _STATIONS  # of the length, how far beyond the ends samples reach
_EDGE_SCALE = 0.15  # of half the limb's width: edges are taken at finer scales than ridges
_NOISE = 4.0  # grey values of slope that count half


def cone_of(limb: Limb) -> np.ndarray:
    """The cone as kernels take it, (6,): start, end, semi-axes along x and y at the start and at the end [m]."""
    return np.array([limb.start, limb.end, *limb.proximal, *limb.distal], dtype=float)


def maps_of(ridges: Ridges) -> tuple[Any, ...]:
    """The filter maps as kernels take them: borders between the scales for half the width [px], steps, maps."""
    borders = np.sqrt(ridges.scales[1:] * ridges.scales[:-1])
    return borders, ridges.steps, ridges.first, ridges.second


@jit
def _outlined(cone, t, R, camera, across, points, size):  # type: ignore[no-untyped-def]
    """Fills points (S, 3, 2), the axis and both sides of the outline at every station [px], and across (2,), the unit
    vector across the axis to the first side. Returns half the mean width [px], negative where the picture, of size (2,)
    height and width, shows less than half of the axis.

    cone (6,): see `cone_of`. t (3,), R (3, 3): the limb in the world. camera: see `estimator.data.cameras.projection`.
    The sides are those points of each elliptic section that lie farthest across the line of sight.
    """
    intrinsics, lens, R_camera, t_camera = camera
    stations = points.shape[0]
    eye = -(R_camera.T @ t_camera)
    shown, width = 0, 0.0
    across[:] = 0.0
    place = np.empty(3)
    for k in range(stations):
        share = (k + 0.5) / stations
        z = cone[0] + share * (cone[1] - cone[0])
        a, b = cone[2] + share * (cone[4] - cone[2]), cone[3] + share * (cone[5] - cone[3])
        for i in range(3):
            place[i] = t[i] + z * R[i, 2]
        vx, vy, vz = place[0] - eye[0], place[1] - eye[1], place[2] - eye[2]
        sx, sy, sz = R[1, 2] * vz - R[2, 2] * vy, R[2, 2] * vx - R[0, 2] * vz, R[0, 2] * vy - R[1, 2] * vx
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        hx, hy = 1.0, 0.0  # of a limb that points at the camera any side is as good
        if length > 1e-9:
            hx = (sx * R[0, 0] + sy * R[1, 0] + sz * R[2, 0]) / length
            hy = (sx * R[0, 1] + sy * R[1, 1] + sz * R[2, 1]) / length
        reach = math.sqrt(a * a * hx * hx + b * b * hy * hy)
        dx, dy = a * a * hx / reach, b * b * hy / reach
        u, v, ahead = project_point(place, intrinsics, lens, R_camera, t_camera)
        if not ahead:
            return -1.0
        points[k, 0, 0], points[k, 0, 1] = u, v
        if u > -0.5 and v > -0.5 and u < size[1] - 0.5 and v < size[0] - 0.5:
            shown += 1
        for side in range(1, 3):
            sign = 3.0 - 2.0 * side
            for i in range(3):
                place[i] += (sign if side == 1 else 2.0 * sign) * (dx * R[i, 0] + dy * R[i, 1])
            u, v, ahead = project_point(place, intrinsics, lens, R_camera, t_camera)
            if not ahead:
                return -1.0
            points[k, side, 0], points[k, side, 1] = u, v
        ex, ey = points[k, 1, 0] - points[k, 2, 0], points[k, 1, 1] - points[k, 2, 1]
        across[0] += ex
        across[1] += ey
        width += math.sqrt(ex * ex + ey * ey)
    ex, ey = points[0, 0, 1] - points[stations - 1, 0, 1], points[stations - 1, 0, 0] - points[0, 0, 0]
    if 2.0 * math.sqrt(ex * ex + ey * ey) * stations > width:  # else it points at the camera, and its axis is vague
        sign = 1.0 if ex * across[0] + ey * across[1] > 0.0 else -1.0
        across[0], across[1] = sign * ex, sign * ey
    length = math.sqrt(across[0] * across[0] + across[1] * across[1])
    if 2 * shown < stations or not (length > 1e-9 and length < 1e9):
        return -1.0
    across /= length
    return 0.5 * width / stations


@jit
def _cell(value, step, count):  # type: ignore[no-untyped-def]
    """The nearest of `count` places of a map to a pixel's coordinate."""
    return min(max(math.floor((value + 0.5) / step), 0), count - 1)


@jit
def _scale(borders, half_width):  # type: ignore[no-untyped-def]
    """Index of the nearest scale to half a width; borders (S - 1,)."""
    k = 0
    while k < borders.shape[0] and half_width > borders[k]:
        k += 1
    return k


@jit
def _filtered(points, across, half_width, maps, values):  # type: ignore[no-untyped-def]
    """Fills the first three of values (9,) from points (S, 3, 2) and across (2,): see `_outlined`; maps: `maps_of`."""
    borders, steps, first, second = maps
    nx, ny = across[0], across[1]
    fine, broad = _scale(borders, _EDGE_SCALE * half_width), _scale(borders, half_width)
    slope, bend = first[fine], second[broad]
    stations = points.shape[0]
    for side in range(1, 3):
        total = 0.0
        for k in range(stations):
            x = _cell(points[k, side, 0], steps[fine], slope.shape[1])
            y = _cell(points[k, side, 1], steps[fine], slope.shape[0])
            gx, gy = slope[y, x, 0], slope[y, x, 1]
            total += abs(nx * gx + ny * gy) / (math.sqrt(gx * gx + gy * gy) + _NOISE)
        values[side - 1] = total / stations
    total = 0.0
    for k in range(stations):
        x = _cell(points[k, 0, 0], steps[broad], bend.shape[1])
        y = _cell(points[k, 0, 1], steps[broad], bend.shape[0])
        xx, xy, yy = bend[y, x, 0], bend[y, x, 1], bend[y, x, 2]
        total += abs(nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy)
        total -= abs(ny * ny * xx - 2.0 * nx * ny * xy + nx * nx * yy)
    values[2] = total / stations


@jit
def _beyond(cone, t, R, camera, points):  # type: ignore[no-untyped-def]
    """Fills points (2, 2), the axis before the proximal end and after the distal one [px]; returns whether both are
    before the camera. cone (6,), t (3,), R (3, 3), camera: see `_outlined`."""
    intrinsics, lens, R_camera, t_camera = camera
    place = np.empty(3)
    for end in range(2):
        share = -_BEYOND if end == 0 else 1.0 + _BEYOND
        z = cone[0] + share * (cone[1] - cone[0])
        for i in range(3):
            place[i] = t[i] + z * R[i, 2]
        u, v, ahead = project_point(place, intrinsics, lens, R_camera, t_camera)
        if not ahead:
            return False
        points[end, 0], points[end, 1] = u, v
    return True


@jit
def _share(total, count):  # type: ignore[no-untyped-def]
    """NaN where nothing is known."""
    return total / count if count > 0 else math.nan


@jit
def _shares(points, beyond, across, half_width, foreground, values):  # type: ignore[no-untyped-def]
    """Fills the last six of values (9,) from foreground (H, W) uint8 and beyond (2, 2), see `_beyond`; the rest: see
    `_filtered`, points (S, 3, 2), across (2,)."""
    stations = points.shape[0]
    person, known = np.zeros(6), np.zeros(6)
    height, width = foreground.shape
    for k in range(stations):
        for place in range(5):  # axis, within on both sides, beside on both sides
            side = 1 + (place - 1) % 2
            share = 0.0 if place == 0 else _INSIDE if place < 3 else _BESIDE
            away = 0.0 if place < 3 else _AWAY * (3.0 - 2.0 * side)
            u = points[k, 0, 0] + share * (points[k, side, 0] - points[k, 0, 0]) + away * across[0]
            v = points[k, 0, 1] + share * (points[k, side, 1] - points[k, 0, 1]) + away * across[1]
            value = foreground[_cell(v, 1, height), _cell(u, 1, width)]
            if value != UNKNOWN:
                into = (0 if 2 * k < stations else 1) if place < 3 else 1 + side
                known[into] += 1.0
                person[into] += value
    for end in range(2):
        for side in range(-1, 2):  # on the axis and half-way to the outline
            u = beyond[end, 0] + 0.5 * side * half_width * across[0]
            v = beyond[end, 1] + 0.5 * side * half_width * across[1]
            value = foreground[_cell(v, 1, height), _cell(u, 1, width)]
            if value != UNKNOWN:
                known[4 + end] += 1.0
                person[4 + end] += value
    for i in range(6):
        values[_FOREGROUND + i] = _share(person[i], known[i])


@jit
def measured(cone, t, R, camera, maps, foreground, values):  # type: ignore[no-untyped-def]
    """Fills values (N, 9), the `FEATURES` of N poses of a limb in one view; all NaN where the view does not show it,
    the last six where it is not known where the person is.

    cone (6,), t (N, 3), R (N, 3, 3), foreground (H, W) uint8, or (0, 0) without; maps (4,): see `maps_of`; camera: see
    `_outlined`.
    """
    points, across, beyond = np.empty((_STATIONS, 3, 2)), np.empty(2), np.empty((2, 2))
    size = np.array([maps[2][0].shape[0] * maps[1][0], maps[2][0].shape[1] * maps[1][0]])
    for n in range(t.shape[0]):
        half_width = _outlined(cone, t[n], R[n], camera, across, points, size)
        values[n] = math.nan
        if half_width > 0.0 and _beyond(cone, t[n], R[n], camera, beyond):
            _filtered(points, across, half_width, maps, values[n])
            if foreground.size:
                _shares(points, beyond, across, half_width, foreground, values[n])


@jit
def add_ratios(cone, t, R, camera, maps, foreground, bins, table, coarse, unseen, total):  # type: ignore[no-untyped-def]
    """Adds to total (N,) the log-likelihood ratio of N poses of a limb in a view [nats]: the entry of the state of its
    features, `unseen` where the view does not show it.

    bins (9, B): borders between the levels of each feature, infinite where there are no more. table (K,):
    by levels of all features, flat; coarse (L,): by those of edges and ridge alone, where it is not known where the
    person is.
    cone (6,), t (N, 3), R (N, 3, 3), maps (4,), foreground (H, W): see `measured`.
    """
    points, across, beyond, values = np.empty((_STATIONS, 3, 2)), np.empty(2), np.empty((2, 2)), np.empty(9)
    size = np.array([maps[2][0].shape[0] * maps[1][0], maps[2][0].shape[1] * maps[1][0]])
    levels = np.ones(9, np.int64)
    for i in range(9):
        for k in range(bins.shape[1]):
            levels[i] += bins[i, k] < math.inf
    for n in range(t.shape[0]):
        half_width = _outlined(cone, t[n], R[n], camera, across, points, size)
        if half_width <= 0.0 or not _beyond(cone, t[n], R[n], camera, beyond):
            total[n] += unseen
            continue
        _filtered(points, across, half_width, maps, values)
        known = foreground.size > 0
        if known:
            _shares(points, beyond, across, half_width, foreground, values)
            for i in range(_FOREGROUND, 9):
                known = known and not math.isnan(values[i])
        state = 0
        for i in range(9 if known else _FOREGROUND):
            level = 0
            while level < levels[i] - 1 and values[i] > bins[i, level]:
                level += 1
            state = state * levels[i] + level
        total[n] += table[state] if known else coarse[state]
