"""The likeness of a body's motion to its source: directions of limbs, path of the root."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.retargeting.correspondence import PERSON_LIMBS, MatchedLimb
from estimator.retargeting.source import SourceMotion
from humanoid.kinematics.body import Body

_HIPS = "left_hip", "right_hip"
_ALONG = ("trunk", "thigh", "shank", "upper_arm", "forearm")  # lines across the trunk do not count
_SHORTEST = 1e-6  # m: a shorter limb has no direction


LIMBS = tuple(limb for limb in PERSON_LIMBS if limb.name.endswith(_ALONG))
"""Those that are compared unless others are given."""


class Likeness(NamedTuple):
    """mean, worst [deg]: angle between matched limbs, over limbs and frames in which the source is known. root_rms,
    root_worst [m]: distance of the middle of the hips from the source's path, scaled and moved so that both begin at
    one place. scale: of that path. NaN where nothing can be compared."""

    mean: float
    worst: float
    root_rms: float
    root_worst: float
    scale: float


def likeness_of(
    body: Body,
    landmarks: np.ndarray,
    source: SourceMotion | None,
    limbs: tuple[MatchedLimb, ...] = LIMBS,
    scale: float | None = None,
) -> Likeness:
    """The likeness of a body's landmarks (T, L, 3) [m] in the world and the motion that they follow, at the same
    frames, both with z up and facing alike. scale: of the root's path, the ratio of the legs' lengths unless given."""
    unknown = float("nan")
    if source is None:
        return Likeness(unknown, unknown, unknown, unknown, unknown)
    angles = limb_angles(body, landmarks, source, limbs)
    known = angles[np.isfinite(angles)]
    chosen = leg_ratio(body, source) if scale is None else scale
    away = root_distances(body, landmarks, source, chosen)
    away = away[np.isfinite(away)]
    return Likeness(
        float(known.mean()) if len(known) else unknown,
        float(known.max()) if len(known) else unknown,
        float(np.sqrt(np.square(away).mean())) if len(away) else unknown,
        float(away.max()) if len(away) else unknown,
        chosen,
    )


def limb_angles(
    body: Body, landmarks: np.ndarray, source: SourceMotion, limbs: tuple[MatchedLimb, ...] = LIMBS
) -> np.ndarray:
    """Angles (T, B) [deg] between those limbs that both have; NaN where the source is missing."""
    both = [limb for limb in limbs if set(limb.landmarks) <= set(source.names) & set(body.landmark_names)]
    angles = np.empty((len(landmarks), len(both)))
    for column, limb in enumerate(both):
        own, other = _way(body.landmark_names, landmarks, limb), _way(source.names, source.points, limb)
        across = np.linalg.norm(np.cross(own, other), axis=1)  # exact for small angles, where the cosine is not
        angles[:, column] = np.degrees(np.arctan2(across, (own * other).sum(axis=1)))
        angles[np.linalg.norm(other, axis=1) < _SHORTEST, column] = np.nan
    return angles


def leg_ratio(body: Body, source: SourceMotion) -> float:
    """Length of the body's thighs and shanks over the source's, NaN where either has no legs."""
    legs = [limb for name in ("thigh", "shank") for limb in LIMBS if limb.name.endswith(name)]
    if any(
        name not in names for limb in legs for name in limb.landmarks for names in (source.names, body.landmark_names)
    ):
        return float("nan")
    at_rest = body.landmarks(body.at(body.neutral))[None]
    own = sum(np.linalg.norm(_way(body.landmark_names, at_rest, limb)[0]) for limb in legs)
    lengths = [np.linalg.norm(_way(source.names, source.points, limb), axis=1) for limb in legs]
    if not all(np.isfinite(length).any() for length in lengths):
        return float("nan")
    return float(own / sum(np.nanmedian(length) for length in lengths))


def root_distances(body: Body, landmarks: np.ndarray, source: SourceMotion, scale: float) -> np.ndarray:
    """Distances (T,) [m] of the middle of the hips from the source's path times `scale`, both from where they are in
    the first frame that is known."""
    if not set(_HIPS) <= set(source.names) & set(body.landmark_names):
        return np.full(len(landmarks), np.nan)
    own, path = _middle(body.landmark_names, landmarks, _HIPS), scale * _middle(source.names, source.points, _HIPS)
    known = np.flatnonzero(np.isfinite(path).all(axis=1))
    if not len(known):
        return np.full(len(landmarks), np.nan)
    return np.asarray(np.linalg.norm((own - own[known[0]]) - (path - path[known[0]]), axis=1))


def _way(names: tuple[str, ...], points: np.ndarray, limb: MatchedLimb) -> np.ndarray:
    """Vectors from a limb's start to its end (T, 3) in points (T, L, 3)."""
    return _middle(names, points, limb.subject_to) - _middle(names, points, limb.subject_from)


def _middle(names: tuple[str, ...], points: np.ndarray, of: tuple[str, ...]) -> np.ndarray:
    return np.asarray(points[:, [names.index(name) for name in of]].mean(axis=1))
