"""Tapered cones with elliptic section: how far points are from one, and the one that is nearest to a limb's surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

_THINNEST = 1e-3  # m
_MOST = 100  # evaluations of a fit
_FEWEST = 6  # nodes, below which nothing is fitted


@dataclass(frozen=True, eq=False)
class Cone:
    """Along z from start to end [m], semi-axes along x and y proximal (2,) and distal (2,) there [m]."""

    start: float
    end: float
    proximal: np.ndarray
    distal: np.ndarray


def cone_distance(cone: Cone, points: np.ndarray) -> np.ndarray:
    """Signed distance (N,) [m] of points (N, 3) in the cone's frame from its surface, negative inside.

    Sideways it is taken along the ray from the cone's axis, which is exact for a circular section and no taper.
    """
    return _distance(np.concatenate([[cone.start, cone.end], cone.proximal, cone.distal]), points)


def _distance(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    share = np.clip((points[:, 2] - p[0]) / (p[1] - p[0]), 0.0, 1.0)[:, None]
    axes = p[2:4] + share * (p[4:6] - p[2:4])
    off = np.hypot(points[:, 0], points[:, 1])
    level = np.hypot(points[:, 0] / axes[:, 0], points[:, 1] / axes[:, 1])
    inner = level < 1e-9  # on the axis
    reach = np.where(inner, axes.min(axis=1), off / np.where(inner, 1.0, level))
    side, cap = off - reach, np.maximum(p[0] - points[:, 2], points[:, 2] - p[1])
    outside = np.hypot(np.maximum(side, 0.0), np.maximum(cap, 0.0))
    return np.asarray(np.where(outside > 0.0, outside, np.maximum(side, cap)))


def fitted_cone(points: np.ndarray, near: float) -> Cone:
    """The cone nearest to points (N, 3) in its frame [m].

    Distances beyond `near` [m] count linearly. Starts from the points' own extent and spread; no semi-axis becomes
    longer than the points reach along it.
    """
    z = points[:, 2]
    low, high = float(z.min()), float(z.max())
    if high - low < 2.0 * _THINNEST:
        middle = (low + high) / 2.0
        low, high = middle - _THINNEST, middle + _THINNEST
    spread = np.maximum(np.sqrt(2.0 * np.mean(points[:, :2] ** 2, axis=0)), 2.0 * _THINNEST)
    if len(points) < _FEWEST:
        return Cone(low, high, spread, spread.copy())
    size = high - low
    widest = np.abs(points[:, :2]).max(axis=0) + 4.0 * _THINNEST
    # the ends stay apart: each has its own half of the extent, and a little beyond
    middle, over = (low + high) / 2.0, 0.1 * size
    lower = np.array([low - over, middle + 0.05 * size, *(4 * [_THINNEST])])
    upper = np.array([middle - 0.05 * size, high + over, *widest, *widest])
    first = np.clip([low, high, *spread, *spread], lower, upper)
    x = least_squares(
        _distance, first, bounds=(lower, upper), loss="soft_l1", f_scale=near, args=(points,), max_nfev=_MOST
    ).x
    return Cone(float(x[0]), float(x[1]), x[2:4].copy(), x[4:6].copy())


def cone_surface(cone: Cone, around: int = 48, along: int = 24) -> np.ndarray:
    """Points on the cone's surface, ends included, (around * (2 along + 1), 3) [m]."""
    angle = 2.0 * np.pi * np.arange(around) / around
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    share = np.linspace(0.0, 1.0, along + 1)
    axes = cone.proximal + share[:, None] * (cone.distal - cone.proximal)
    height = np.repeat(cone.start + share * (cone.end - cone.start), around)
    rings = [np.concatenate([(axes[:, None] * circle).reshape(-1, 2), height[:, None]], axis=1)]
    for axes_there, z in ((cone.proximal, cone.start), (cone.distal, cone.end)):
        disc = (np.linspace(0.0, 1.0, along // 2, endpoint=False)[:, None, None] * axes_there * circle).reshape(-1, 2)
        rings.append(np.concatenate([disc, np.full((len(disc), 1), z)], axis=1))
    return np.concatenate(rings)
