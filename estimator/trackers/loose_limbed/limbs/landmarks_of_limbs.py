"""Which landmarks of a body locate a limb: those that are fixed in its frame, whatever the pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.trackers.loose_limbed.limbs.potential_learning import random_configurations
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements

_POSES = 400
_SEED = 0  # the poses only sample the body, and are not part of any trial
_FIXED = 0.01  # of the longest limb: what moves less than this is fixed
_LOOSE = 0.11  # of the limb's length: what moves less than this still locates the limb
_OFF_AXIS = 0.1  # of the limb's length: how far off the axis a landmark must be to show the limb's rotation about it
_TURNED = 0.7  # rad: how little a landmark's direction from the axis may be known
_MOST_TURNING = 6


@dataclass(frozen=True, eq=False)
class LimbLandmarks:
    """The landmarks (M,) of one limb, by their index among the body's.

    place (M, 3) [m]: where they are in the limb's frame on average. spread (M,) [m]: root mean square distance from
    there over poses. fixed (M,) bool: whether that is as good as nothing, as of what is on the limb's link or its
    joints.
    turning (P,): landmarks, mostly of neighbours, that show the limb's rotation about its z axis, the most certain
    first. angle (P,) [rad]: their mean direction from the axis, from x to y. uncertain (P,) [rad]: its circular
    standard deviation over poses.
    """

    landmark: np.ndarray
    place: np.ndarray
    spread: np.ndarray
    fixed: np.ndarray
    turning: np.ndarray
    angle: np.ndarray
    uncertain: np.ndarray


def landmarks_of_limbs(body: Body, graph: LimbGraph) -> tuple[LimbLandmarks, ...]:
    """Landmarks of every limb of a graph, in poses drawn from the body's stabilisers within its limits. Found by their
    places alone; what moves by less than 11 % of the limb's length counts. Depends on the body's lengths: once a body
    is enough. Raises InputError for a body that lacks a link of the graph."""
    q = random_configurations(body, _POSES, np.random.default_rng(_SEED))
    points = body.landmarks_of(body.placed(np.ascontiguousarray(q)))
    t, R = limb_placements(graph, body, q)
    size = longest_of(graph)
    return tuple(_of_limb((points - t[:, None, k]) @ R[:, k], limb.length, size) for k, limb in enumerate(graph.limbs))


def longest_of(graph: LimbGraph) -> float:
    """Length of the longest limb [m], with which errors of detectors are scaled: they grow with the person."""
    return max(limb.length for limb in graph.limbs)


def _of_limb(local: np.ndarray, length: float, size: float) -> LimbLandmarks:
    """local (N, L, 3): the landmarks of all poses in the limb's frame [m]."""
    place = local.mean(axis=0)
    spread = np.sqrt(np.square(local - place).sum(axis=2).mean(axis=0))
    own = np.flatnonzero(spread < max(_LOOSE * length, _FIXED * size))
    across = np.linalg.norm(local[:, :, :2], axis=2)
    direction = (local[:, :, 0] + 1j * local[:, :, 1]) / np.maximum(across, 1e-12)
    mean = direction.mean(axis=0)
    uncertain = np.sqrt(-2.0 * np.log(np.clip(np.abs(mean), 1e-12, 1.0)))
    telling = (np.median(across, axis=0) > _OFF_AXIS * length) & (uncertain < _TURNED)
    turning = np.flatnonzero(telling)
    turning = turning[np.argsort(uncertain[turning], kind="stable")][:_MOST_TURNING]
    return LimbLandmarks(
        own, place[own], spread[own], spread[own] < _FIXED * size, turning, np.angle(mean)[turning], uncertain[turning]
    )
