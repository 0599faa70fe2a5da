"""Captured people whose skeletons stand with bent knees, made to stand as a laboratory's people do.

Skeletons of captured motion are made once for a person, from a suit; their joint positions are not measured.
Those of the CMU database walk with knees that never come nearer to straight than 15 degrees, while people whose joints
a laboratory has measured bend them by 0 to 5 degrees there and stand with straight ones: legs that are a little too
long between hip and ankle do that (2 per cent of a leg are 20 degrees at a knee that is straight, and 3 at one bent by
70). So thigh and shank are shortened by one factor for a person, with hip and ankle where they are, and the ankle has
one constant besides, as feet of skeletons end somewhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

LEVELS = np.linspace(0.05, 0.95, 19)  # quantiles of walking that are compared
_FACTORS = (0.95, 1.01)


class Legs(NamedTuple):
    """Places of the angles of both legs among joint angles (D,): (2,) each."""

    hip: np.ndarray
    knee: np.ndarray
    ankle: np.ndarray

    @staticmethod
    def among(joints: Sequence[str]) -> Legs:
        """By human34's names."""
        names = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
        return Legs(*(np.array([joints.index(f"{side}_{name}") for side in ("left", "right")]) for name in names))


class Correction(NamedTuple):
    """The correction of a skeleton: the factor on its thighs and shanks, and the constant that its ankles lose
    [rad]."""

    factor: float
    ankle: float

    def of(self, angles: np.ndarray, legs: Legs) -> np.ndarray:
        """Angles (N, D) [rad] of the corrected legs: hip and ankle stay in place, thigh and shank have equal
        lengths."""
        corrected = angles.copy()
        less = angles[:, legs.knee] - shortened(angles[:, legs.knee], self.factor)
        corrected[:, legs.knee] -= less
        corrected[:, legs.hip] -= 0.5 * less
        corrected[:, legs.ankle] -= 0.5 * less + self.ankle
        return corrected


ANYBODY = Correction(0.9764, 0.215)
"""The mean of `FITTED`, for people who do not walk."""
FITTED = {
    "06": Correction(0.9849, 0.171),
    "07": Correction(0.9779, 0.300),
    "08": Correction(0.9656, 0.242),
    "10": Correction(0.9782, 0.123),
    "12": Correction(0.9770, 0.213),
    "26": Correction(0.9776, 0.324),
    "35": Correction(0.9733, 0.131),
}
"""By person of the CMU database of whom all clips are walks and runs, as `python -m benchmarks rest_positions` prints
them. What else is learned from captured poses uses these."""


def shortened(knee: np.ndarray, factor: float) -> np.ndarray:
    """Flexions [rad] of a knee whose thigh and shank, of equal lengths, are so many times as long, with hip and ankle
    where they are; 0 where these are farther apart than the leg is then long. Flexions below 0 stay."""
    cosine = (1.0 + np.cos(knee)) / factor**2 - 1.0
    return np.where(knee > 0.0, np.arccos(np.clip(cosine, -1.0, 1.0)), knee)


def correction(walking: np.ndarray, others: Sequence[np.ndarray], legs: Legs) -> Correction:
    """That brings the quantiles of a captured person's knees in walking nearest to those of people whose joints were
    measured, and the medians of the ankles together. walking (N, D), others (each (M, D)): joint angles [rad]."""
    wanted = np.mean([np.quantile(other[:, legs.knee], LEVELS) for other in others], axis=0)

    def apart(factor: float) -> float:
        return float(np.square(np.quantile(shortened(walking[:, legs.knee], factor), LEVELS) - wanted).mean())

    factor = float(minimize_scalar(apart, bounds=_FACTORS, method="bounded").x)
    ankles = Correction(factor, 0.0).of(walking, legs)[:, legs.ankle]
    return Correction(factor, float(np.median(ankles) - np.mean([np.median(o[:, legs.ankle]) for o in others])))


def corrected(person: str, angles: np.ndarray, legs: Legs) -> np.ndarray:
    """Angles (N, D) [rad] of a captured person with corrected legs."""
    return FITTED.get(person, ANYBODY).of(angles, legs)
