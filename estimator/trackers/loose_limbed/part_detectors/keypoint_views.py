"""Placements of a limb by one view: its landmarks on their rays, its length, and about how far away the person is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from estimator.trackers.loose_limbed.limbs.landmarks_of_limbs import LimbLandmarks
from estimator.trackers.loose_limbed.part_detectors.keypoint_fits import (
    Fits,
    along_rays,
    onto_points,
    onto_rays,
    usable,
)
from humanoid.limbs.limb import Limb

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
