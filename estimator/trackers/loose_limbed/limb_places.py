"""Summary of each limb's belief: its clusters, each a place with a spread and a share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.inference.beliefs.graph import OK, Belief
from estimator.inference.beliefs.space import PLACEMENTS, placements_of
from estimator.inference.clusters import clusters, mean_and_covariance
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.support.errors import InputError


class PlacementCluster(NamedTuple):
    """One cluster of a limb's belief. point (7,): its mean, of `PLACEMENTS`. covariance (6, 6): in the tangent space
    there. share: of the belief's weight."""

    point: np.ndarray
    covariance: np.ndarray
    share: float


class Places(NamedTuple):
    """Places (L) of every limb, the heaviest first and none without a belief, and whether the measurements support its
    belief (L)."""

    of: tuple[tuple[PlacementCluster, ...], ...]
    explained: tuple[bool, ...]


def limb_places(graph: LimbGraph, beliefs: Sequence[Belief], apart: float, count: int) -> Places:
    """The clusters of each limb's belief, at most `count`, whose points are `apart` [m] or more in their ends or turned
    about their axis so far that the flesh is.

    Raises
    ------
    InputError: not one belief for each limb, or beliefs of another space.
    """
    if len(beliefs) != len(graph.limbs):
        remedy = f"one for each of the {len(graph.limbs)} limbs, in the graph's order"
        raise InputError("beliefs", f"there are {len(beliefs)}", place="assembly", remedy=remedy)
    for limb, belief in zip(graph.limbs, beliefs, strict=True):
        if belief.space != PLACEMENTS:
            raise InputError("beliefs", f"is of {belief.space}", place=limb.name, remedy="beliefs of placements")
    of = tuple(_places(limb, belief, apart, count) for limb, belief in zip(graph.limbs, beliefs, strict=True))
    return Places(of, tuple(belief.status == OK for belief in beliefs))


def ends(limb: Limb, points: np.ndarray) -> np.ndarray:
    """Both ends of a limb at points (N, 7), (N, 2, 3) [m]."""
    t, R = placements_of(points)
    return np.stack([t, t + limb.length * R[:, :, 2]], axis=1)


def _places(limb: Limb, belief: Belief, apart: float, count: int) -> tuple[PlacementCluster, ...]:
    usable = np.isfinite(belief.points).all(axis=1) & np.isfinite(belief.weights) & (belief.weights > 0.0)
    points, weights = np.ascontiguousarray(belief.points[usable]), belief.weights[usable]
    if len(points) == 0:
        return ()
    weights = weights / weights.sum()
    R = placements_of(points)[1]
    # limbs that are turned about their own axis differ by how far their flesh is moved: a trunk's front is wider than
    # an arm's
    side = 0.5 * float(max(limb.proximal.max(), limb.distal.max())) * R[:, :, 0]
    of = clusters(np.concatenate([*ends(limb, points).transpose(1, 0, 2), side], axis=1), weights, apart, count)
    places = []
    for k in range(int(of.max()) + 1):
        own = of == k
        if own.any():
            mean, covariance = mean_and_covariance(PLACEMENTS, points[own], weights[own])
            places.append(PlacementCluster(mean, covariance, float(weights[own].sum())))
    return tuple(sorted(places, key=lambda p: -p.share))
