"""Which way is up where a person stands and walks: along balance, and across the floor that the feet touch.

A standing person keeps the centre of mass over the feet, and over a clip of walking it is over their middle on average,
however the trunk leans. The ankles' lowest places lie in a plane, the floor. Both are estimates of one direction with
covariances, in the plane across it, and are fused as Gaussians. Masses of the segments and where their centres lie:
Winter, Biomechanics and Motor Control of Human Movement, 4th edition, table 4.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.numerics.vectors import angle_between, axes_across, unit

_NEEDED = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle", "shoulder"))
_HEAD_AND_TRUNK = (
    (0.497, 0.5),
    (0.081, 1.35),
)  # mass; place from mid-hip to the shoulders
_LIMBS = (("hip", "knee", 0.1, 0.433), ("knee", "ankle", 0.0465, 0.433), ("ankle", "ankle", 0.0145, 0.0),
          ("shoulder", "elbow", 0.028, 0.436), ("elbow", "wrist", 0.022, 0.682))  # fmt: skip
_FOOT = 0.07  # from the ankle to the middle of the foot, of the leg's length
_STRAIGHT_KNEE, _STRAIGHT_HIP = np.radians(40.0), np.radians(45.0)
_FEWEST = 8  # instants with a standing person that are believed
_LEAN, _SWAY = np.radians(4.0), np.radians(2.0)  # deviation of balance from the vertical, forwards and sideways
_LOW = 0.15  # quantile of the ankles' heights that is the floor's
_FLOOR = 0.02  # m, deviation of the ankles' lowest places from a plane
_STEP = 0.6  # s, in which a foot finds a new place
_AGREE = 2.5  # squared Mahalanobis distance up to which floor and balance agree on a direction
_SURE = np.radians(2.2)
_PARALLEL = 0.5  # length of the mean direction of a person who stands most of the time


class UpDirection(NamedTuple):
    """direction (3,): a unit vector in the points' world. std [rad]: the larger of its two deviations. agree: whether
    balance and floor agree; otherwise it is balance's."""

    direction: np.ndarray
    std: float
    agree: bool

    @property
    def sure(self) -> bool:
        """Whether it is known to about two degrees."""
        return self.agree and self.std < _SURE


def up_direction(names: Sequence[str], points: np.ndarray, times: np.ndarray) -> UpDirection | None:
    """Upward direction from a person's motion; None where the person never stands, or landmarks are missing.

    names (L): needed are hips, knees, ankles and shoulders, arms are used where they are. points (T, L, 3) [m], NaN
    where unknown. times (T,) [s].
    """
    if not set(_NEEDED) <= set(names):
        return None
    place = {name: points[:, i] for i, name in enumerate(names)}
    known = np.isfinite([place[name] for name in _NEEDED]).all(axis=(0, 2))
    place = {name: at[known] for name, at in place.items()}
    stands = _stands(place)
    if np.count_nonzero(stands) < _FEWEST:
        return None
    balance, forward = _balance(place, stands)
    if balance is None:
        return None
    axes = axes_across(balance)
    covariance = _of_balance(forward[stands] @ axes)
    slope, information = _floor(place, balance, axes, float(np.ptp(times[known])))
    spread = covariance + np.linalg.inv(information + 1e-9 * np.eye(2))
    if slope @ np.linalg.solve(spread, slope) > _AGREE:  # stairs, one leg, a dancer's arms
        return UpDirection(balance, 2.0 * _LEAN, agree=False)
    together = np.linalg.inv(np.linalg.inv(covariance) + information)
    direction = unit(balance - axes @ (together @ information @ slope))
    return UpDirection(direction, float(np.sqrt(np.linalg.eigvalsh(together)[-1])), agree=True)


def _middle(place: Mapping[str, np.ndarray], joint: str) -> np.ndarray:
    return 0.5 * (place[f"left_{joint}"] + place[f"right_{joint}"])


def _stands(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """Frames (T,) bool in which a leg is straight below a straight trunk, so that the person does not sit, lie or
    bend."""
    trunk, straight = _middle(place, "shoulder") - _middle(place, "hip"), []
    for side in ("left", "right"):
        hip, knee, ankle = (place[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle"))
        straight_knee = angle_between(knee - hip, ankle - knee) < _STRAIGHT_KNEE
        straight.append(straight_knee & (angle_between(hip - knee, trunk) < _STRAIGHT_HIP))
    return np.logical_or(*straight)


def _centre_of_mass(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """(T, 3) [m]; arms that are not known hang from the shoulders' height as points there."""
    hips, trunk = _middle(place, "hip"), _middle(place, "shoulder") - _middle(place, "hip")
    total = sum(mass * (hips + along * trunk) for mass, along in _HEAD_AND_TRUNK)
    for upper, lower, mass, along in _LIMBS:
        for side in ("left", "right"):
            first = place.get(f"{side}_{upper}", place[f"{side}_shoulder"])
            last = place.get(f"{side}_{lower}", first)
            first = np.where(np.isfinite(first), first, place[f"{side}_shoulder"])
            total = total + mass * np.where(np.isfinite(last), (1.0 - along) * first + along * last, first)
    return np.asarray(total)


def _balance(place: Mapping[str, np.ndarray], stands: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """The mean direction from the feet to the centre of mass (3,), None where there is none, and where the person faces
    in each frame (T, 3)."""
    mass, feet = _centre_of_mass(place), _middle(place, "ankle")
    legs = [
        np.linalg.norm(place[f"{side}_{a}"] - place[f"{side}_{b}"], axis=1)
        for side in ("left", "right")
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    across, leg = place["left_hip"] - place["right_hip"], 0.5 * float(np.median(np.sum(legs, axis=0)))
    forward = unit(np.cross(across, unit(mass - feet)))
    rise = unit(mass - feet - _FOOT * leg * forward)[stands]
    near = angle_between(rise, np.median(rise, axis=0)) < np.radians(45.0)  # a frame whose points were mistaken
    mean = rise[near].mean(axis=0) if near.any() else np.zeros(3)
    return (unit(mean) if np.linalg.norm(mean) > _PARALLEL and near.mean() > _PARALLEL else None), forward


def _of_balance(forward: np.ndarray) -> np.ndarray:
    """Covariance (2, 2) [rad^2] of balance, of a person who faces forward (N, 2)."""
    facing = unit(forward)
    share = np.einsum("ni,nj->ij", facing, facing) / len(facing)
    return np.asarray(_LEAN**2 * share + _SWAY**2 * (np.eye(2) - share))


def _floor(
    place: Mapping[str, np.ndarray], up: np.ndarray, axes: np.ndarray, seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the plane below the ankles along the axes (2,), and their information (2, 2).

    A plane of the ankles' low quantile (Koenker and Bassett, Regression Quantiles, 1978), by reweighted least squares.
    """
    ankles = np.concatenate([place["left_ankle"], place["right_ankle"]])
    ankles = ankles - ankles.mean(axis=0)
    along, height = ankles @ axes, ankles @ up
    design = np.column_stack([along, np.ones(len(along))])
    plane = np.linalg.lstsq(design, height, rcond=None)[0]
    for _ in range(60):
        left = height - design @ plane
        weight = np.where(left > 0.0, _LOW, 1.0 - _LOW) / np.maximum(np.abs(left), 2e-3)
        plane = np.linalg.solve((design * weight[:, None]).T @ design + 1e-6 * np.eye(3), design.T @ (weight * height))
    touching = along[np.abs(height - design @ plane) < 1.5 * _FLOOR]
    if len(touching) < _FEWEST:
        return plane[:2], np.zeros((2, 2))
    places = max(2.0, 2.0 * seconds / _STEP)
    return plane[:2], np.cov(touching.T, bias=True) * places / _FLOOR**2
