"""Balance: the centre of mass stays over the feet that stand, unless something else holds the body.

The distance of the centre of mass from the feet is far smaller than the body is tall: one camera that faces a person
does not show whether the trunk leans towards it or away, but balance does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.kernels.balance import balance_record, balance_values, offset_of, whitened
from estimator.energy.kernels.records import BALANCE, Record
from estimator.energy.priors import up_is_assumed, world_up
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.vectors import axes_across
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody, points_in_world
from humanoid.shape.segment_masses import mass_points
from humanoid.subject.landmarks import foot_landmarks
from humanoid.support.per_object import per_object
from humanoid.support.settings import CheckedSettings, setting

_STANDS = 0.5  # probability from which a point of a foot is part of the support
_TALL = 0.3  # m: a body whose centre of mass is lower over its soles than that does not stand on feet


@dataclass(frozen=True)
class BalanceSettings(CheckedSettings):
    """Settings of balance: the distance of the centre of mass from above the standing feet.

    weight: of the term, 0 for none. robots: also for bodies whose masses come from their URDF.
    spread, spread_one_foot: its standard deviation about the middle of the heels and toes that stand, in standard
        deviations of these, seen from above, of two feet and of one. width, width_one_foot [m]: standard deviation
        beside that.
    held, held_one_foot: probability that something else holds the body, or that it falls, steps or jumps. held_seated:
        the same where the hips are low and have not moved for half a second.
    tail, tail_one_foot: factor on the variance for bodies that are held, whose density has a long tail.
    tilt, assumed_tilt [rad]: standard deviation of the world's up from the vertical, where a calibration gives it, and
        where it is only the camera's own.

    The numbers are learned by `python -m benchmarks balance`.
    """

    weight: float = setting(1.0, at_least=0)
    robots: bool = False
    spread: float = setting(0.5, at_least=0)
    spread_one_foot: float = setting(1.0, at_least=0)
    width: float = setting(0.014, above=0)
    width_one_foot: float = setting(0.05, above=0)
    held: float = setting(0.035, above=0, below=1)
    held_one_foot: float = setting(0.43, above=0, below=1)
    held_seated: float = setting(0.9, above=0, below=1)
    tail: float = setting(13.0, above=0)
    tail_one_foot: float = setting(5.0, above=0)
    tilt: float = setting(0.02, at_least=0)
    assumed_tilt: float = setting(0.035, at_least=0)

    @property
    def on_both_feet(self) -> MassSpread:
        """Settings for a person standing on both feet."""
        return MassSpread(self.spread, self.width, self.tail, self.held)

    @property
    def on_one_foot(self) -> MassSpread:
        """Settings for a person standing on one foot."""
        return MassSpread(self.spread_one_foot, self.width_one_foot, self.tail_one_foot, self.held_one_foot, feet=1)


class MassSpread(NamedTuple):
    """Spread of the centre of mass about its support, see `BalanceSettings`; held: of this instant. feet: how many
    stand."""

    spread: float
    width: float
    tail: float
    held: float
    feet: int = 2


class _Feet(NamedTuple):
    """The points a body stands on, and the masses of its parts.

    landmark (P,): heels and toes, by their numbers among the body's; foot (P,): 0 left, 1 right. ankle (2,): landmark
    of each foot's ankle, -1 for none. joint (M,), local (M, 3) [m], share (M,): points that carry the body's mass.
    from_urdf: whether the masses are the URDF's. height [m]: of the centre of mass above the soles, standing.
    """

    landmark: np.ndarray
    foot: np.ndarray
    ankle: np.ndarray
    joint: np.ndarray
    local: np.ndarray
    share: np.ndarray
    from_urdf: bool
    height: float


@per_object
def _feet_of(body: Body) -> _Feet | None:
    """None for a body that is fixed, or has no feet or no masses. A body without an upright axis stands along z."""
    names = foot_landmarks(body.landmark_names)
    masses = mass_points(body)
    if not names or not body.has_free_root or masses is None:
        return None
    landmark = np.array([body.landmark_names.index(name) for name in names])
    foot = np.array([int(name.startswith("right_")) for name in names])
    ankle = [
        body.landmark_names.index(n) if (n := f"{s}_ankle") in body.landmark_names else -1 for s in ("left", "right")
    ]
    upright = body.subject.upright
    posed, up = body.at(body.neutral), np.array([0.0, 0.0, 1.0] if upright is None else upright.axis)
    points = points_in_world(posed, masses.joint, masses.local)
    height = float(masses.share @ points @ up - (body.landmarks(posed)[landmark] @ up).min())
    if height < _TALL:
        return None
    return _Feet(landmark, foot, np.array(ankle), *masses[:3], masses.from_urdf, height)


def balance_terms(body: Body, observation: Observation, settings: BalanceSettings) -> list[Balance]:
    """Balance over the feet that rest in the pictures of a frame; none in flight, without feet, or for a robot unless
    the settings enable it."""
    feet, standing = _feet_of(body), observation.standing
    if feet is None or standing is None or settings.weight <= 0.0 or (feet.from_urdf and not settings.robots):
        return []
    stands = standing[feet.landmark]
    for k, ankle in enumerate(feet.ankle):  # of a foot without heel and toes in sight the ankle counts
        if ankle >= 0 and standing[ankle] > 0.0:
            stands = np.where(feet.foot == k, np.maximum(stands, standing[ankle]), stands)
    some = np.flatnonzero(stands >= _STANDS)
    if not len(some):
        return []
    both = len(set(feet.foot[some].tolist())) > 1
    how = settings.on_both_feet if both else settings.on_one_foot
    held = how.held + max(0.0, settings.held_seated - how.held) * observation.seated
    held = 1.0 - (1.0 - held) * float(stands[some].mean())
    off = feet.height * (settings.assumed_tilt if up_is_assumed(observation.cameras) else settings.tilt)
    stance = how._replace(width=math.hypot(how.width, off), held=held)
    masses = feet.joint, feet.local, feet.share
    return [Balance(body, feet.landmark[some], masses, world_up(observation.cameras), stance, settings.weight)]


class Balance(RecordedTerm):
    """-log((1 - held) p(x) + held p'(x)), x = r' C^-1 r, of the horizontal offset r of the centre of mass from the
    middle of its support, the landmarks that stand.

    Where the feet alone hold the body the density of the centre of mass is Gaussian with covariance C = width^2 +
    spread^2 S, S that of the support's points: a person with feet apart may be anywhere between them. Where something
    else does, it is Student's t in the plane with two degrees of freedom: p = exp(-x / 2) / 2, p' = (1 + x / tail)^-2 /
    tail, both over pi |C|^1/2, which is left out, as it does not depend on the centre of mass. The value is 0 over the
    middle.

    Parameters
    ----------
    support (P,): landmarks. masses: joint (M,), local (M, 3) [m] and share (M,) of points that carry the body's mass;
        the shares sum to one. up (3,): unit vector in the world. stance: see there.

    The Hessian is Gauss-Newton's with the potential's slope, also where the exact one is requested: it leaves out the
    curvature of the kinematics and how C bends with the feet.
    """

    name, kind = "balance", BALANCE

    def __init__(
        self,
        body: Body,
        support: np.ndarray,
        masses: tuple[np.ndarray, np.ndarray, np.ndarray],
        up: np.ndarray,
        stance: MassSpread,
        weight: float = 1.0,
    ) -> None:
        self.stance = stance
        self._body = body
        self._axes = np.ascontiguousarray(axes_across(np.asarray(up, float)).T)
        self._points = (body.landmark_joint[support], np.ascontiguousarray(body.landmark_local[support]), *masses)
        odds = 2.0 * stance.held / ((1.0 - stance.held) * stance.tail)
        self._shape = np.array([stance.spread**2, stance.width**2, stance.tail, odds, weight])

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return balance_record(*self._points, self._axes, self._shape)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        balance_values(placed.placements, *self._points, self._axes, self._shape, values)
        return values

    def deviations(self, posed: PosedBody) -> float:
        """Distance of the centre of mass from the middle of its support, in standard deviations for a person who is not
        held."""
        around, offset, pull = np.empty((len(self._points[0]), 2)), np.empty(2), np.empty(2)
        offset_of(posed.placements, *self._points, self._axes, around, offset)
        return math.sqrt(whitened(around, offset, self._shape, pull, np.empty((2, 2))))
