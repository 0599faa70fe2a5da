"""Placements of one limb by its landmarks: by places, by rays that lead to them, or by one view's rays and a length."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from estimator.numerics.alignment import motions_onto
from estimator.trackers.loose_limbed.limbs.keypoint_evidence import LimbLandmarks
from humanoid.limbs.limb import Limb

_ROUND = 0.1  # of the spread of landmarks along their line: what is more across than this fixes all of the rotation
_SPAN = 0.25  # of the limb's length: landmarks nearer together hardly show where it points
_ALONG = 0.95  # cosine of the angle between the landmarks' line and the limb's axis
_STEPS = 20  # of the fit to rays
_LESS = 1e-12


class Fits(NamedTuple):
    """Placements of a limb: R (K, 3, 3), t (K, 3) [m]. log_weight (K,). row (K,): what each comes from. line (K, 3):
    unit vector in the limb's frame about which it may be turned, zero where it may not; pivot (K, 3) [m]: a point of
    that line."""

    R: np.ndarray
    t: np.ndarray
    log_weight: np.ndarray
    row: np.ndarray
    line: np.ndarray
    pivot: np.ndarray

    def of(self, rows: np.ndarray) -> Fits:
        """Some of them."""
        return Fits(*(values[rows] for values in self))


def usable(of: LimbLandmarks, seen: np.ndarray, noise: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights (K, M) of a limb's landmarks, by seen (K, M), 0 where missing, and the line (K, 3) that those lie on,
    zero where they are not collinear and fix the rotation, NaN where they are too few.

    Landmarks that are fixed in the limb are enough where they determine its axis. Otherwise those that move a little
    count too, with a lower weight. noise [m]: of each.
    """
    fixed = np.where(of.fixed, seen, 0.0)
    line = _line(of.place, fixed, length)
    tells = (np.abs(line[:, 2]) > _ALONG) | (line == 0.0).all(axis=1)
    weight = np.where(tells[:, None], fixed, seen / (1.0 + np.square(of.spread / noise)))
    return weight, np.where(tells[:, None], line, _line(of.place, weight, length))


def _line(place: np.ndarray, weight: np.ndarray, length: float) -> np.ndarray:
    total = np.maximum(weight.sum(axis=1), _LESS)
    from_mean = place - ((weight @ place) / total[:, None])[:, None]
    moments = np.einsum("km,kmi,kmj->kij", weight / total[:, None], from_mean, from_mean)
    values, vectors = np.linalg.eigh(moments)
    extent = np.sqrt(np.maximum(values, 0.0))
    line = np.where((extent[:, 1] > _ROUND * extent[:, 2])[:, None], 0.0, vectors[:, :, 2])
    line[2.0 * extent[:, 2] < _SPAN * length] = np.nan
    return np.asarray(line)


def onto_points(place: np.ndarray, points: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R (K, 3, 3), t (K, 3) of the limb and root mean square misfit (K,) [m], from points (K, M, 3) of its landmarks
    that are at place (M, 3) in its frame."""
    R, t = motions_onto(place, points, weight)
    off = np.where(weight > 0.0, np.square(place @ np.swapaxes(R, 1, 2) + t[:, None] - points).sum(axis=2), 0.0)
    return R, t, np.sqrt((weight * off).sum(axis=1) / weight.sum(axis=1))


def onto_rays(
    place: np.ndarray, eye: np.ndarray, rays: np.ndarray, weight: np.ndarray, depths: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R (D, S, 3, 3), t (D, S, 3) and misfit (D, S) [m], for every depth (D,) [m] and start; the landmarks at place
    (M, 3) are on rays (M, 3), unit vectors, from eye (3,).

    The points move to the rays and the limb to the points, in turn (Lu, Hager and Mjolsness, IEEE TPAMI 22(6), 2000),
    from all turns by right angles; which of two mirrored answers comes of it depends on the start. It stays about as
    deep as it began.
    """
    share = weight / weight.sum()
    ahead = share @ rays
    ahead /= np.linalg.norm(ahead)
    turns = _right_angles()
    centred = (place - share @ place) @ np.swapaxes(turns, 1, 2)
    points = eye + depths[:, None, None, None] * ahead + centred
    points = points.reshape(-1, *place.shape)
    weights = np.broadcast_to(weight, points.shape[:2])
    for _ in range(_STEPS):
        on_rays = eye + ((points - eye) * rays).sum(axis=2, keepdims=True) * rays
        R, t = motions_onto(place, on_rays, weights)
        points = place @ np.swapaxes(R, 1, 2) + t[:, None]
    off = points - eye
    off = off - (off * rays).sum(axis=2, keepdims=True) * rays
    misfit = np.sqrt((share * np.square(off).sum(axis=2)).sum(axis=1))
    shape = len(depths), len(turns)
    return R.reshape(*shape, 3, 3), t.reshape(*shape, 3), misfit.reshape(shape)


def along_rays(
    gap: float, eye: np.ndarray, rays: np.ndarray, depths: np.ndarray, over: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both ends of a stick of length `gap` [m] on two rays (2, 3) from eye (3,): points (K, 2, 3) and the missing
    length of the stick (K,) [m], at depths (D,) [m] of its first end, and their indices (K,). Two answers each; where
    it does not reach, by at most `over` of its length, the nearest."""
    cosine = float(rays[0] @ rays[1])
    square = gap**2 - np.square(depths) * (1.0 - cosine**2)
    reach = depths * np.sqrt(max(1.0 - cosine**2, 0.0))
    root = np.sqrt(np.maximum(square, 0.0))
    second = np.stack([depths * cosine - root, depths * cosine + root], axis=1)
    fits = (reach <= (1.0 + over) * gap)[:, None] & (second > 0.0)
    fits[:, 1] &= root > 0.0
    k, side = np.nonzero(fits)
    points = np.stack([depths[k, None] * rays[0], second[k, side][:, None] * rays[1]], axis=1)
    return eye + points, np.maximum(reach[k] - gap, 0.0), k


def turned_about(fits: Fits, angle: np.ndarray) -> Fits:
    """Every fit turned about its line by angle (K,) [rad]; its landmarks' line stays where it is."""
    x, y, z = fits.line.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    turn = np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)
    R = fits.R @ turn
    return fits._replace(R=R, t=fits.t + np.einsum("kij,kj->ki", fits.R - R, fits.pivot))


def _right_angles() -> np.ndarray:
    """The 24 rotations (24, 3, 3) by right angles."""
    axes, turns = np.eye(3), []
    for i, j in product(range(3), repeat=2):
        if i != j:
            for a, b in product((1.0, -1.0), repeat=2):
                x, y = a * axes[i], b * axes[j]
                turns.append(np.stack([x, y, np.cross(x, y)], axis=1))
    return np.array(turns)


_LONG = 0.4  # of the longest limb: landmarks nearer together hardly show how far away they are
_NEAREST = 0.05  # quantile of their distances
_OVER = 0.15  # of its length: tolerance of a limb's apparent length
_SAME_TURN = 0.9  # cosine of half the angle below which two fits are one


class ViewRays(NamedTuple):
    """One camera's keypoints: eye (3,) [m], rays (L, 3) in the world, unit vectors, NaN where missing, confidence (L,),
    and depths (D,) [m] along rays where limbs are tried, with their log_prior (D,)."""

    eye: np.ndarray
    rays: np.ndarray
    confidence: np.ndarray
    depths: np.ndarray
    log_prior: np.ndarray


def person_depth(landmarks: Sequence[LimbLandmarks], rays: np.ndarray, size: float) -> float | None:
    """Distance of a person [m] whose landmarks are on rays (L, 3), NaN where missing; None where it cannot be computed.

    Two landmarks of a limb are at most as far away as where their rays are as far apart as they are, which holds
    exactly if they lie across the line of sight. Many limbs do not, so a low quantile is used. size [m]: length of the
    longest limb.
    """
    farthest = []
    for of in landmarks:
        for i, j in combinations(range(len(of.landmark)), 2):
            gap = float(np.linalg.norm(of.place[i] - of.place[j]))
            a, b = rays[of.landmark[i]], rays[of.landmark[j]]
            apart = np.linalg.norm(a - b)  # twice the sine of half the angle
            if gap > _LONG * size and apart > 1e-6:
                farthest.append(gap / apart)
    return float(np.quantile(farthest, _NEAREST)) if farthest else None


def of_view(limb: Limb, of: LimbLandmarks, view: ViewRays, noise: float, misfit: float) -> Fits | None:
    """Placements of a limb by one view, None where it does not show it; noise, misfit [m]."""
    confidence = view.confidence[of.landmark]
    weight, line = usable(of, confidence[None], noise, limb.length)
    if not np.isfinite(line[0, 0]) or not len(view.depths):
        return None
    seen = np.flatnonzero(weight[0] > 0.0)
    place, rays, weight = of.place[seen], view.rays[of.landmark[seen]], weight[0, seen]
    if (line[0] != 0.0).any():
        R, t, off, depth = _as_stick(place, line[0], view, rays, weight)
    else:
        R, t, off, depth = _as_body(place, view, rays, weight)
    share = weight / weight.sum()
    allowed = np.sqrt(noise**2 + share @ np.square(of.spread[seen]))
    count = len(t)
    log_weight = np.log(share @ confidence[seen]) + view.log_prior[depth] - 0.5 * np.square(off / allowed)
    pivot = np.broadcast_to(share @ place, (count, 3))
    fits = Fits(R, t, log_weight, np.zeros(count, dtype=np.int64), np.broadcast_to(line, (count, 3)), pivot)
    return fits.of(np.flatnonzero(off <= misfit * allowed / noise))


_Placed = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""R (K, 3, 3), t (K, 3), misfit (K,) [m], index of the depth (K,)."""


def _as_stick(place: np.ndarray, line: np.ndarray, view: ViewRays, rays: np.ndarray, weight: np.ndarray) -> _Placed:
    """By the two landmarks that are farthest apart on a line."""
    along = place @ line * (1.0 if line[2] >= 0.0 else -1.0)
    ends = np.array([along.argmin(), along.argmax()])
    gap = float(np.linalg.norm(place[ends[1]] - place[ends[0]]))
    points, short, depth = along_rays(gap, view.eye, rays[ends], view.depths, _OVER)
    R, t, _ = onto_points(place[ends], points, np.broadcast_to(weight[ends], (len(points), 2)))
    return R, t, short, depth


def _as_body(place: np.ndarray, view: ViewRays, rays: np.ndarray, weight: np.ndarray) -> _Placed:
    """By all of its landmarks: at every depth the best fits that differ, at most two."""
    R, t, off = onto_rays(place, view.eye, rays, weight, view.depths)
    chosen = []
    for d, order in enumerate(np.argsort(off, axis=1, kind="stable")):
        kept = [int(order[0])]
        for k in order[1:]:
            cosine = 0.5 * (np.einsum("ij,ij->", R[d, k], R[d, kept[0]]) + 1.0)  # of half the angle, squared, less
            if 0.5 * (1.0 + cosine) < _SAME_TURN**2 and len(kept) < 2:
                kept.append(int(k))
        chosen += [(d, k) for k in kept]
    d, k = np.array(chosen).T
    return R[d, k], t[d, k], off[d, k], d
