"""Who stands does not fall: the centre of mass stays over the feet that stand, unless something else holds the body.

The distance of the centre of mass from the feet is far smaller than the body is tall: one camera that faces a person
cannot tell whether the trunk leans towards it or away, balance can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.gravity_prior import up_is_assumed, world_up
from estimator.energy.points import add_by_column, to_world
from estimator.energy.term import BatchTerm
from estimator.numerics.axes import axes_across
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody, points_in_world
from humanoid.shape.segment_masses import mass_points
from humanoid.subject.landmarks import foot_landmarks
from humanoid.support.compiled import jit
from humanoid.support.per_object import per_object
from humanoid.support.settings import CheckedSettings, setting

_STANDS = 0.5  # probability from which a point of a foot is part of the support
_TALL = 0.3  # m: a body whose centre of mass is lower over its soles than that does not stand on feet


@dataclass(frozen=True)
class BalanceSettings(CheckedSettings):
    """How far the centre of mass may be from over the feet that stand.

    weight: of the term, 0 for none. robots: also for bodies whose masses come from their URDF.
    spread, spread_one_foot: its standard deviation about the middle of the heels and toes that stand, in standard
        deviations of these, seen from above, of two feet and of one. width, width_one_foot [m]: standard deviation
        beside that.
    held, held_one_foot: probability that something else holds the body, or that it falls, steps or jumps. held_seated:
        the same where the hips are low and have not moved for half a second.
    tail, tail_one_foot: how much larger the variance is of bodies that are held, whose density has a long tail.
    tilt, assumed_tilt [rad]: standard deviation of the world's up from the vertical, where a calibration says it, and
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
        """Of who stands on both feet."""
        return MassSpread(self.spread, self.width, self.tail, self.held)

    @property
    def on_one_foot(self) -> MassSpread:
        """Of who stands on one."""
        return MassSpread(self.spread_one_foot, self.width_one_foot, self.tail_one_foot, self.held_one_foot, feet=1)


class MassSpread(NamedTuple):
    """How the centre of mass is spread about its support, see `BalanceSettings`; held: of this instant. feet: how many
    stand."""

    spread: float
    width: float
    tail: float
    held: float
    feet: int = 2


class _Feet(NamedTuple):
    """What a body stands on, and how heavy its parts are.

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
    """None of a body that is fixed, or has no feet or no masses. A body that nobody calls upright stands along z."""
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
    """Balance over the feet that rest in the pictures of a frame; nothing in flight, without feet, or for a robot
    unless the settings ask for it."""
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


class Balance(BatchTerm):
    """-log((1 - held) p(x) + held p'(x)), x = r' C^-1 r, of the horizontal offset r of the centre of mass from the
    middle of its support, the landmarks that stand.

    Where the feet alone hold the body the density of the centre of mass is Gaussian with covariance C = width^2 +
    spread^2 S, S that of the support's points: who stands with feet apart may be anywhere between them. Where something
    else does it is Student's t in the plane with two degrees of freedom: p = exp(-x / 2) / 2, p' = (1 + x / tail)^-2 /
    tail, both over pi |C|^1/2, which is left out, as it says nothing of the centre of mass. The value is 0 over the
    middle.

    Parameters
    ----------
    support (P,): landmarks. masses: joint (M,), local (M, 3) [m] and share (M,) of points that carry the body's mass;
        the shares sum to one. up (3,): unit vector in the world. stance: see there.

    The Hessian is Gauss-Newton's with the potential's slope, also where the exact one is asked for: it leaves out the
    curvature of the kinematics and how C bends with the feet.
    """

    name = "balance"

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

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value, tree = 0.0, self._body.tree

        def add(gradient: np.ndarray, hessian: np.ndarray) -> None:
            nonlocal value
            value = _add_balance(
                posed.placements, posed.spatial_jacobian, tree.joint_parent, tree.column_joint, *self._points,
                self._axes, self._shape, gradient, hessian,
            )  # fmt: skip

        add_by_column(self._body, gradient, hessian, add)
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        _balance_values(placed.placements, *self._points, self._axes, self._shape, values)
        return values

    def deviations(self, posed: PosedBody) -> float:
        """How far the centre of mass is from the middle of its support, in standard deviations of who is not held."""
        around, offset, pull = np.empty((len(self._points[0]), 2)), np.empty(2), np.empty(2)
        _offset(posed.placements, *self._points, self._axes, around, offset)
        return math.sqrt(_whitened(around, offset, self._shape, pull, np.empty((2, 2))))


@jit
def _offset(placements, joint, local, mass_joint, mass_local, share, axes, around, offset):  # type: ignore[no-untyped-def]
    """Fill offset (2,) [m] from the middle of the support to the centre of mass, along the axes (2, 3), and around
    (P, 2) [m] from there to the support's points (joint (P,), local (P, 3)).

    placements (njoints, 12); mass_joint (M,), mass_local (M, 3), share (M,): see `Balance`.
    """
    count = joint.shape[0]
    x, middle = np.empty(3), np.zeros(2)
    offset[:] = 0.0
    for m in range(share.shape[0]):
        to_world(placements[mass_joint[m]], mass_local[m], x)
        for a in range(2):
            offset[a] += share[m] * (axes[a, 0] * x[0] + axes[a, 1] * x[1] + axes[a, 2] * x[2])
    for n in range(count):
        to_world(placements[joint[n]], local[n], x)
        for a in range(2):
            around[n, a] = axes[a, 0] * x[0] + axes[a, 1] * x[1] + axes[a, 2] * x[2]
            middle[a] += around[n, a] / count
    for a in range(2):
        offset[a] -= middle[a]
        for n in range(count):
            around[n, a] -= middle[a]


@jit
def _whitened(around, offset, shape, pull, precision):  # type: ignore[no-untyped-def]
    """x of `Balance` for an offset (2,) and the support's points `around` (P, 2) their middle; fills pull (2,), C^-1 r,
    and precision (2, 2), C^-1. shape (5,): spread^2, width^2, tail, odds of being held, weight."""
    count = around.shape[0]
    a, b, c = shape[1], 0.0, shape[1]
    for n in range(count):
        a += shape[0] * around[n, 0] * around[n, 0] / count
        b += shape[0] * around[n, 0] * around[n, 1] / count
        c += shape[0] * around[n, 1] * around[n, 1] / count
    det = a * c - b * b
    precision[0, 0], precision[1, 1] = c / det, a / det
    precision[0, 1] = precision[1, 0] = -b / det
    for i in range(2):
        pull[i] = precision[i, 0] * offset[0] + precision[i, 1] * offset[1]
    return pull[0] * offset[0] + pull[1] * offset[1]


@jit
def _potential(x, shape):  # type: ignore[no-untyped-def]
    """Value and derivative by x; shape (5,): see `_whitened`."""
    _, _, tail, odds, weight = shape
    near, far = math.exp(-0.5 * x), 1.0 / (1.0 + x / tail)
    density = near + odds * far * far
    slope = (0.5 * near + 2.0 * odds * far * far * far / tail) / density
    return -weight * math.log(density / (1.0 + odds)), weight * slope


@jit
def _add_balance(  # type: ignore[no-untyped-def]
    placements, J, joint_parent, dof_joint, joint, local, mass_joint, mass_local, share, axes, shape, gradient, hessian
):
    """Value of `Balance`; adds its derivatives to gradient (nv,) and hessian (nv, nv).

    J (nv, 6), joint_parent (njoints,), dof_joint (nv,): see `estimator.energy.points`; shape (5,): see `_whitened`. The
    others: see `_offset`. As x is r' C^-1 r and C a sum over the support's points, dx is 2 (C^-1 r)' of a weighted sum
    of all points, whose weights and moments are summed over subtrees.
    """
    count, njoints = joint.shape[0], joint_parent.shape[0]
    around, offset, pull, precision = np.empty((count, 2)), np.empty(2), np.empty(2), np.empty((2, 2))
    _offset(placements, joint, local, mass_joint, mass_local, share, axes, around, offset)
    value, slope = _potential(_whitened(around, offset, shape, pull, precision), shape)
    weight, moment, x = np.zeros(njoints), np.zeros((njoints, 3)), np.empty(3)
    for m in range(share.shape[0]):
        to_world(placements[mass_joint[m]], mass_local[m], x)
        weight[mass_joint[m]] += share[m]
        for i in range(3):
            moment[mass_joint[m], i] += share[m] * x[i]
    for n in range(count):
        to_world(placements[joint[n]], local[n], x)
        w = (1.0 + shape[0] * (pull[0] * around[n, 0] + pull[1] * around[n, 1])) / count
        weight[joint[n]] -= w
        for i in range(3):
            moment[joint[n], i] -= w * x[i]
    for j in range(njoints - 1, 0, -1):
        weight[joint_parent[j]] += weight[j]
        for i in range(3):
            moment[joint_parent[j], i] += moment[j, i]
    rows = np.empty((dof_joint.shape[0], 2))
    for d in range(dof_joint.shape[0]):
        w, q = weight[dof_joint[d]], moment[dof_joint[d]]
        x[0] = w * J[d, 0] + J[d, 4] * q[2] - J[d, 5] * q[1]
        x[1] = w * J[d, 1] + J[d, 5] * q[0] - J[d, 3] * q[2]
        x[2] = w * J[d, 2] + J[d, 3] * q[1] - J[d, 4] * q[0]
        for a in range(2):
            rows[d, a] = axes[a, 0] * x[0] + axes[a, 1] * x[1] + axes[a, 2] * x[2]
        gradient[d] += 2.0 * slope * (pull[0] * rows[d, 0] + pull[1] * rows[d, 1])
    for d in range(dof_joint.shape[0]):
        first = 2.0 * slope * (precision[0, 0] * rows[d, 0] + precision[0, 1] * rows[d, 1])
        second = 2.0 * slope * (precision[1, 0] * rows[d, 0] + precision[1, 1] * rows[d, 1])
        for k in range(dof_joint.shape[0]):
            hessian[d, k] += first * rows[k, 0] + second * rows[k, 1]
    return value


@jit
def _balance_values(placements, joint, local, mass_joint, mass_local, share, axes, shape, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `_add_balance` for placements (N, njoints, 12)."""
    around, offset, pull, precision = np.empty((joint.shape[0], 2)), np.empty(2), np.empty(2), np.empty((2, 2))
    for s in range(placements.shape[0]):
        _offset(placements[s], joint, local, mass_joint, mass_local, share, axes, around, offset)
        values[s] = _potential(_whitened(around, offset, shape, pull, precision), shape)[0]
