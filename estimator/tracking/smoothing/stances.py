"""Feet that stand stay where they are, on the floor: while a point of a foot stands, one place draws it. So do hands,
where requested.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.floor import KnownFloor
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.point_targets import PointTargets
from estimator.energy.priors import world_up
from estimator.inference.contacts import FootPoints, HandPoints, feet_on_floor, stances_of
from estimator.inference.ground import STEP, Ground
from humanoid.kinematics.body import Body, batches
from humanoid.support.spilled import MadeList

SUNK = 0.005
"""[m] Standard deviation of a part below the floor."""


_LEAST = 0.1  # s: what stands for less is not held
_FAINT = 0.1  # probability of standing
_NU = 4.0


class Stances(NamedTuple):
    """Terms that hold the feet of a clip, and its hands.

    landmark (P,): which points, by their numbers among the body's landmarks. places (T, P, 3) [m]: where they are held.
    weight (T, P): their weights, 0 for points that do not stand. floor: None where there is none.
    """

    landmark: np.ndarray
    places: np.ndarray
    weight: np.ndarray
    floor: Ground | None

    @staticmethod
    def of(
        body: Body,
        q: np.ndarray,
        observations: Sequence[Observation],
        known: KnownFloor = None,
        *,
        hands: bool = False,
    ) -> Stances | None:
        """The stances in a trajectory q (T, nq); None for a body without heels and toes.

        observations (T): a point counts by the share of its stance in which its keypoint is seen: a foot that is not
        seen lies as the prior has it. What stands on a floor is held at its height, and moves with a belt. A floor that
        was found is rejected where something stands on a lower one, as on stairs. hands: include hands, which stand
        only on a floor.
        """
        feet = FootPoints.of(body)
        if feet is None or len(q) < 2:
            return None
        landmarks = np.concatenate([body.landmarks_of(body.placed(some)) for some in batches(q)])
        points = landmarks[:, feet.landmark]
        times, up = np.array([o.time for o in observations]), world_up(observations[0].cameras)
        every = np.array([_seen(body, o) for o in observations])
        seen = every[:, feet.landmark]
        standing, floor, _, belt = feet_on_floor(body, feet, q, points, times, up, known, seen)
        places, weight = held_places(points, standing, seen, times, None if belt is None else belt.way)
        palms = HandPoints.of(body) if hands else None
        palm_floor = floor
        if floor is not None:
            heights = floor.heights(places, feet.kind)
            if known is None and np.any(heights[weight > _FAINT] < -STEP):
                floor = None
            else:
                places = np.where((np.abs(heights) < STEP)[..., None], places - heights[..., None] * up, places)
        if palms is None:
            return Stances(feet.landmark, places, weight, floor)
        points = landmarks[:, palms.landmark]
        more = held_places(points, palms.standing(points, times, palm_floor), every[:, palms.landmark], times)
        places, weight = (np.concatenate(pair, axis=1) for pair in zip((places, weight), more, strict=True))
        return Stances(np.concatenate([feet.landmark, palms.landmark]), places, weight, floor)

    @property
    def hold(self) -> bool:
        """Whether anything stands."""
        return bool(np.any(self.weight > _FAINT))

    def held(self, body: Body, costs: Sequence[Cost], std: float) -> MadeList[Cost]:
        """Costs (T) with the pulls of each point that stands, std [m], with long tails, as feet roll. A cost without a
        pull is the given one itself. A foot on a stair stands on no floor, and is held alike."""
        return MadeList(len(costs), lambda t: self._pulled(body, costs[t], t, std))

    def _pulled(self, body: Body, cost: Cost, t: int, std: float) -> Cost:
        some = np.flatnonzero(self.weight[t] > _FAINT)
        if not len(some):
            return cost
        landmark = self.landmark[some]
        pull = PointTargets(
            body, body.landmark_joint[landmark], body.landmark_local[landmark], self.places[t, some],
            np.tile(np.eye(3) / std**2, (len(some), 1, 1)),
            weight=self.weight[t, some], potential="lorentzian", nu=_NU, name="stances",
        )  # fmt: skip
        return cost.plus([pull])


def _seen(body: Body, observation: Observation) -> np.ndarray:
    """Which landmarks (L,) a camera sees, or have a marker on the same joint."""
    by_cameras = np.isfinite(observation.known_pixels).all(axis=2).any(axis=0)
    if observation.markers is None:
        return np.asarray(by_cameras)
    return np.asarray(by_cameras | body.landmarks_beside(np.isfinite(observation.markers).all(axis=1)))


def held_places(
    points: np.ndarray, standing: np.ndarray, seen: np.ndarray, times: np.ndarray, way: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Places at which points (T, P, 3) are held that stand with probabilities (T, P) at times (T,) [s], and their
    weights (T, P): 0 outside stances, and in those that are too short to be any or not seen (T, P). way (T, 3) [m]: of
    the belt they stand on, None of a floor at rest."""
    places, weight = points.copy(), np.zeros(standing.shape)
    for k, first, after in stances_of(standing):
        if times[after - 1] - times[first] >= _LEAST:
            moved = 0.0 if way is None else way[first:after]
            places[first:after, k] = np.median(points[first:after, k] - moved, axis=0) + moved
            weight[first:after, k] = seen[first:after, k].mean() * standing[first:after, k]
    return places, weight
