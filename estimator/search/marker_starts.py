"""Poses to start from where markers are measured."""

from __future__ import annotations

import numpy as np

from estimator.numerics.alignment import similarity_onto
from estimator.search.views import random_configuration, with_root
from humanoid.kinematics.body import ROOT_JOINT, Body, points_in_world

RANDOM_STARTS = 8
_FEWEST = 3  # markers that place a root


def marker_starts(rng: np.random.Generator, body: Body, markers: np.ndarray) -> list[np.ndarray]:
    """Configurations (nq,) with the root where markers (M, 3) [m], NaN where missing, have it: the joints at rest, and
    drawn evenly within their limits.

    A free root is placed by all markers, and by those of the root's own link and of the next ones, which joints turn
    little against it.
    """
    some = np.isfinite(markers).all(axis=1)
    joints = [body.neutral, *(random_configuration(rng, body) for _ in range(RANDOM_STARTS))]
    if not body.has_free_root:
        return joints
    near = some & (_distance_to_root(body)[body.marker_joint] <= _trunk(body, some))
    return [_placed(body, q, markers, used) for q in joints for used in (some, near) if used.sum() >= _FEWEST]


def _trunk(body: Body, some: np.ndarray) -> int:
    """How many joints away from the root markers must be looked for until there are enough."""
    away = np.sort(_distance_to_root(body)[body.marker_joint[some]])
    return int(away[min(_FEWEST, len(away)) - 1]) if len(away) else 0


def _distance_to_root(body: Body) -> np.ndarray:
    """(njoints,): how many joints lie between each and the root."""
    away = np.zeros(body.njoints, dtype=np.int64)
    for j in range(ROOT_JOINT + 1, body.njoints):
        away[j] = away[body.tree.joint_parent[j]] + 1
    return away


def _placed(body: Body, q: np.ndarray, markers: np.ndarray, used: np.ndarray) -> np.ndarray:
    """q (nq,) with its root moved so that the markers used (M,) are nearest to where they were measured."""
    posed = body.at(q)
    places = points_in_world(posed, body.marker_joint, body.marker_local)[used]
    moved = similarity_onto(places, markers[used])
    return with_root(q, moved.R @ posed.rotations[ROOT_JOINT], moved.of(posed.translations[ROOT_JOINT]))
