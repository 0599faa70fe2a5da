"""Feet that stand stay where they are: while a point of a foot stands, one place draws it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.gravity_prior import world_up
from estimator.energy.point_targets import PointTargets
from estimator.energy.term import Cost
from estimator.inference.foot_contact import foot_contact, stances_of
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import foot_landmarks, foot_parts

_LEAST = 0.1  # s: what stands for less is not held
_FAINT = 0.1  # probability of standing
_NU = 4.0


def with_stances(
    body: Body, costs: Sequence[Cost], q: np.ndarray, observations: Sequence[Observation], std: float
) -> list[Cost]:
    """Costs (T) with a pull of each point of the feet, while it stands, to the middle of its places in that time.

    q (T, nq): the trajectory that tells what stands, and where. observations (T): a point counts by the share of its
    stance in which its keypoint is seen: a foot that nobody sees lies as the prior has it. std [m]: of what stands from
    one place, with long tails, as feet roll. A foot on a stair stands on no floor, and is held alike. A cost without a
    pull, as all are of a body without heels and toes, is the given one itself.
    """
    names = foot_landmarks(body.landmark_names)
    if not names or len(q) < 2:
        return list(costs)
    index = [body.landmark_names.index(name) for name in names]
    points = body.landmarks_of(body.placed(q))[:, index]
    times = np.array([o.time for o in observations])
    seen = np.array([np.isfinite(o.known_pixels[:, index]).all(axis=2).any(axis=0) for o in observations])
    standing = foot_contact(points, times, foot_parts(names), world_up(observations[0].cameras)).standing
    places, weight = held_places(points, standing, seen, times)
    joint, local = body.landmark_joint[index], body.landmark_local[index]
    precision = np.eye(3) / std**2
    result = []
    for cost, place, share in zip(costs, places, weight, strict=True):
        held = np.flatnonzero(share > _FAINT)
        if len(held):
            pull = PointTargets(
                body, joint[held], local[held], place[held], np.tile(precision, (len(held), 1, 1)),
                weight=share[held], potential="lorentzian", nu=_NU, name="stances",
            )  # fmt: skip
            cost = cost.plus([pull])
        result.append(cost)
    return result


def held_places(
    points: np.ndarray, standing: np.ndarray, seen: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where points (T, P, 3) are held that stand with probabilities (T, P) at times (T,) [s], and how much each counts,
    (T, P): 0 outside stances, and in those that are too short to be any or not seen (T, P)."""
    places, weight = points.copy(), np.zeros(standing.shape)
    for k, first, after in stances_of(standing):
        if times[after - 1] - times[first] >= _LEAST:
            places[first:after, k] = np.median(points[first:after, k], axis=0)
            weight[first:after, k] = seen[first:after, k].mean() * standing[first:after, k]
    return places, weight
