"""Feet that stand with heel and toes are level, as floors are."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.energy.kernels.records import SOLES, Record
from estimator.energy.kernels.soles import sole_record, sole_values
from estimator.energy.recorded import RecordedTerm
from estimator.energy.standing import LEAST
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.per_object import per_object


class Soles(NamedTuple):
    """Soles of the feet, from heel to toes.

    heel, toe (S,): landmarks. joint (S,): that moves both. along (S, 3): from one to the other in its frame [m]. rise
    (S,): how much higher the toes are where all joints are at zero [m].
    """

    heel: np.ndarray
    toe: np.ndarray
    joint: np.ndarray
    along: np.ndarray
    rise: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> Soles:
        """The soles of feet whose first toe is on the heel's joint; none where the body's upright axis is unknown."""
        upright, names, joint = body.subject.upright, body.landmark_names, body.landmark_joint
        toes = [(i, [j for j, n in enumerate(names) if n.endswith("toe") and joint[j] == joint[i]])
                for i, name in enumerate(names) if name.endswith("heel") and upright is not None]  # fmt: skip
        heel, toe = np.array([(i, some[0]) for i, some in toes if some], np.int64).reshape(-1, 2).T
        at_zero = body.landmarks(body.at(pin.neutral(body.model)))
        up = np.zeros(3) if upright is None else np.array(upright.axis)
        along = body.landmark_local[toe] - body.landmark_local[heel]
        return Soles(heel, toe, joint[heel], along, (at_zero[toe] - at_zero[heel]) @ up)


class LevelFeet(RecordedTerm):
    """1/2 sum weight rho((up . d - rise)^2 / (std |d|)^2) over soles d, from heel to toes in the world.

    weight (S,): of each, none of those that weigh less than `LEAST`. up (3,): unit vector in the world. std [rad]: of a
    foot's tilt, and of the assumed up.
    """

    name, kind = "level feet", SOLES

    def __init__(self, body: Body, soles: Soles, weight: np.ndarray, up: np.ndarray, std: float) -> None:
        some = np.flatnonzero(weight >= LEAST)
        along = np.ascontiguousarray(soles.along[some])
        precision = 1.0 / np.square(std * np.linalg.norm(along, axis=1))
        self._body = body
        self._soles = (soles.joint[some], along, soles.rise[some], np.asarray(up, float), precision, weight[some])

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return sole_record(*self._soles)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        sole_values(placed.placements, *self._soles, values)
        return values
