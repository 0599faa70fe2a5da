"""The energy of a body in one frame of a motion, its constraints, the parts kept apart among them, and the constrained
step.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.numerics.quadratic_program import UNBOUNDED, QuadraticProgram, solve
from estimator.retargeting.stances import HEEL, TOE, FootStances
from estimator.retargeting.targets import Targets
from humanoid.collision.floor import FloorDistances
from humanoid.collision.self_collision import LinkPair, SelfCollision
from humanoid.kinematics.body import ROOT_PLACE_V, SHORTEST_STEP, Body, PosedBody, points_in_world
from humanoid.support.settings import CheckedSettings, setting

TRUST = 0.4
"""[rad or m] A frame's step: what stands may be far from where the body is, and rows are linear."""
STANDING = 1e7  # energy by m^2 of a foot that cannot be where it stands
SHORT = 1e8  # energy by m^2 of parts that cannot be as far from each other, or the floor, as they have to
_ACCURACY, _ITERATIONS = 1e-6, 60


class StepRows(NamedTuple):
    """The constraints of a step dx: equal dx = to, equal (m, nv) and to (m,), and above dx >= least, (k, nv) and
    (k,)."""

    equal: np.ndarray
    to: np.ndarray
    above: np.ndarray
    least: np.ndarray


def constrained_step(
    hessian: np.ndarray, gradient: np.ndarray, box: np.ndarray, rows: StepRows
) -> tuple[np.ndarray, bool]:
    """The step (n,) that minimises 1/2 dx'H dx + g'dx, within its box (2, n) to the last bit, and whether it meets the
    rows.

    Where nothing does, what stands counts as an energy; where that does not help either, all of `above` may fall short
    by as little as there can be.
    """
    program = QuadraticProgram(hessian, gradient, *rows, np.full(len(rows.least), UNBOUNDED), *box)
    answer = solve(program, _ACCURACY, _ITERATIONS)
    met = answer.solved
    if not met:
        program = program.softened(STANDING)
        answer = solve(program, _ACCURACY, _ITERATIONS)
    if not answer.solved:
        answer = solve(_falling_short(program), _ACCURACY, _ITERATIONS)
    x = answer.x[: len(gradient)] if answer.solved else np.zeros(len(gradient))
    return np.clip(x, box[0], box[1]), met


def _falling_short(program: QuadraticProgram) -> QuadraticProgram:
    """The program with rows x + s >= least and the smallest possible s, an additional variable. It has no equations."""
    n = len(program.gradient)
    hessian = np.zeros((n + 1, n + 1))
    hessian[:n, :n], hessian[n, n] = program.hessian, SHORT
    return program._replace(
        hessian=hessian, gradient=np.append(program.gradient, 0.0), equal=np.zeros((0, n + 1)),
        rows=np.column_stack([program.rows, np.ones(len(program.least))]),
        low=np.append(program.low, 0.0), high=np.append(program.high, np.inf),
    )  # fmt: skip


def parts_of(body: Body, margin: float) -> SelfCollision:
    """The pairs of parts that are checked; margin [m]: below which a pair counts as near.

    Left out are pairs that overlap by anything at `body.neutral`, and pairs that one joint parts: a part is all links
    that are fixed to each other, and hulls of what turns in a socket overlap where its limits let it turn.
    """
    parts = SelfCollision(body, margin=margin)
    overlapping = parts.near(body.at(body.neutral), 0.0)
    left_out = {parts.pairs[k] for k in overlapping.pair} | set(_neighbours(body.model, parts))
    return SelfCollision(body, margin=margin, exclude=sorted(left_out)) if left_out else parts


def kept_distances(body: Body, parts: SelfCollision, clearance: float) -> np.ndarray:
    """Distance [m] (pairs,) that each pair is to keep: the clearance, or what it has at rest where that is less."""
    apart = np.full(len(parts.pairs), clearance)
    near = parts.near(body.at(body.neutral), clearance)
    apart[near.pair] = near.distance
    return apart


def _neighbours(model: pin.Model, parts: SelfCollision) -> Iterator[LinkPair]:
    """Pairs of links whose joints are next to each other once joints without solids are contracted away."""
    joint = {solid.link: solid.joint for solid in parts.solids}
    above = {j: _joint_above(model, j, set(joint.values())) for j in joint.values()}
    for a, b in parts.pairs:
        if joint[a] == above[joint[b]] or joint[b] == above[joint[a]]:
            yield a, b


def _joint_above(model: pin.Model, joint: int, with_solids: set[int]) -> int | None:
    """The nearest joint that carries solids on the way to the root."""
    while joint > 0:
        joint = int(model.parents[joint])
        if joint in with_solids:
            return joint
    return None


KEPT = 0.001
"""[m] within which a stance, a clearance or the floor counts as kept to."""
_UP = np.array([0.0, 0.0, 1.0])
_PUSH = 0.02  # m: overlap that one step has to undo
_ROUNDED = 1.0 - 1e-6  # of a velocity limit


@dataclass(frozen=True)
class RetargetSettings(CheckedSettings):
    """Settings of retargeting a motion to a body.

    rest [rad]: standard deviation of joints about their rest positions, which decides what the source leaves open.
    acceleration [rad/s^2], root_acceleration [m/s^2]: standard deviations of what the body does by itself. clearance
    [m]: that parts keep from each other at least; margin [m]: below which a pair is checked. velocity: share of the
    URDF's velocity limits that may be used. collisions: whether parts are kept apart. starts: from how many the first
    frame is searched. iterations: steps of a frame when it is followed from the one before. window: frames that are
    improved together, rounds: how often at most; 0 leaves the motion as it was followed frame by frame.
    """

    rest: float = setting(1.0, above=0)
    acceleration: float = setting(70.0, above=0)
    root_acceleration: float = setting(20.0, above=0)
    clearance: float = setting(0.002, at_least=0)
    margin: float = setting(0.02, above=0)
    velocity: float = setting(1.0, above=0, at_most=1.0)
    collisions: bool = True
    starts: int = setting(4, at_least=1)
    iterations: int = setting(2, at_least=1)
    window: int = setting(10, at_least=4)
    rounds: int = setting(2, at_least=0)

    @property
    def frame_by_frame(self) -> RetargetSettings:
        """The same without windows, a step a frame."""
        return replace(self, iterations=1, rounds=0)


class FrameModel(NamedTuple):
    """Quadratic model of a frame's energy at a posed body: value, gradient (nv,), hessian (nv, nv). points (P, 3) [m]:
    those of the targets, in the world; jacobian (P, 3, nv): their derivatives."""

    posed: PosedBody
    value: float
    gradient: np.ndarray
    hessian: np.ndarray
    points: np.ndarray
    jacobian: np.ndarray


class Obstacles:
    """The obstacles of a body: its own parts and the floor at z = 0. One object serves one thread.

    parts: None where they may go through each other. apart (pairs,) [m]: distance that each pair keeps. floor: None
    without one.
    """

    def __init__(self, body: Body, settings: RetargetSettings, *, floor: bool) -> None:
        self.parts = parts_of(body, settings.margin) if settings.collisions else None
        self.apart = np.zeros(0)
        if self.parts is not None:
            self.apart = kept_distances(body, self.parts, settings.clearance)
        self.floor = FloorDistances(body, _UP, 0.0, settings.margin) if floor else None


class MotionProblem:
    """A body, its targets and its stances.

    dt (T - 1,) [s]. speed (nv,): velocity limits, infinite where there are none. obstacles: made unless given.
    """

    def __init__(
        self, body: Body, targets: Targets, stances: FootStances, times: np.ndarray, settings: RetargetSettings,
        obstacles: Obstacles | None = None,
    ) -> None:  # fmt: skip
        self.body, self.targets, self.stances, self.settings = body, targets, stances, settings
        self.dt = np.maximum(np.diff(times), SHORTEST_STEP)
        self.speed = _speed_limits(body) * settings.velocity * _ROUNDED
        obstacles = obstacles or Obstacles(body, settings, floor=bool(targets.feet))
        self.collision, self.floor, self._apart = obstacles.parts, obstacles.floor, obstacles.apart
        self.stiff = self._stiffness()
        self._rest = np.zeros(body.nv)
        self._rest[body.first_joint_dof :] = 1.0 / settings.rest**2
        self._joints = np.flatnonzero(self._rest)
        self._set_targets()

    def _set_targets(self) -> None:
        """Set what pulls at the body."""
        targets = self.targets
        target, count = np.nan_to_num(targets.target), 3 * len(targets.feet)
        if count:
            target[:, -count:] = np.nan_to_num(self.stances.place.reshape(len(target), count, 3))
        self._pull, self._weight = target, targets.weight

    def _stiffness(self) -> np.ndarray:
        """Standard deviations (nv,) of accelerations."""
        std = np.full(self.body.nv, self.settings.acceleration)
        if self.body.has_free_root:
            std[ROOT_PLACE_V] = self.settings.root_acceleration
        return std

    def without_parts(self) -> MotionProblem:
        """The same, of a body whose parts go through each other."""
        other = copy(self)
        other.collision = None
        return other

    def with_targets(self, targets: Targets, place: np.ndarray) -> MotionProblem:
        """The same body led to other targets, its feet to `place` (T, F, 3, 3) [m]; who stands does so as before."""
        other = copy(self)
        other.targets, other.stances = targets, self.stances._replace(place=place)
        other._set_targets()
        return other

    @property
    def frames(self) -> int:
        """The number of frames of the motion."""
        return len(self.targets.target)

    def model(self, t: int, q: np.ndarray) -> FrameModel:
        """The energy's model of frame t at q (nq,): directions and places, and the rest positions."""
        body, targets = self.body, self.targets
        posed = body.at(q)
        points = points_in_world(posed, targets.joint, targets.local)
        weight, combination = self._weight[t], targets.combination
        off = combination @ points - self._pull[t]
        pulled = weight[:, None] * off
        J = body.point_jacobians(posed, targets.joint, points)
        flat = J.reshape(-1, body.nv)
        A = combination.T @ (weight[:, None] * combination)
        AJ = (A @ J.reshape(len(points), -1)).reshape(-1, body.nv)
        hessian = flat.T @ AJ
        gradient = (combination.T @ pulled).ravel() @ flat
        lean = body.difference(body.neutral, q) * self._rest
        lean[: body.first_joint_dof] = 0.0
        value = 0.5 * float((pulled * off).sum()) + 0.5 * float(lean @ body.difference(body.neutral, q))
        gradient += lean
        hessian[self._joints, self._joints] += self._rest[self._joints]
        return FrameModel(posed, value, gradient, hessian, points, J)

    def rows(self, t: int, model: FrameModel) -> StepRows:
        """The rows of frame t: feet that stand, parts that keep clear of each other and of the floor."""
        posed, (equal, to) = model.posed, self._standing(t, model)
        above, least = [np.zeros((0, self.body.nv))], [np.zeros(0)]
        if self.collision is not None:
            near = self.collision.near(posed)
            above.append(near.gradient)
            least.append(np.minimum(self._apart[near.pair] - near.distance, _PUSH))
        if self.floor is not None:
            low = self.floor.near(posed)
            above.append(low.gradient)
            least.append(np.minimum(-low.distance, _PUSH))
        return StepRows(equal, to, np.concatenate(above), np.concatenate(least))

    def keeps(self, t: int, q: np.ndarray) -> bool:
        """Whether frame t keeps at q (nq,) to all it has to, within `KEPT`."""
        model = self.model(t, q)
        _, to = self._standing(t, model)
        if np.abs(to).max(initial=0.0) >= KEPT:
            return False
        if self.collision is not None:
            near = self.collision.near(model.posed, self.settings.clearance)
            if (self._apart[near.pair] - near.distance).max(initial=0.0) >= KEPT:
                return False
        return self.floor is None or self.floor.penetration(model.posed) < KEPT

    def _standing(self, t: int, model: FrameModel) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the feet: one point fixed, or the whole foot."""
        rows, to = [np.zeros((0, self.body.nv))], [np.zeros(0)]
        feet = len(self.targets.feet)
        for f, foot in enumerate(self.targets.feet):
            heel, toe = self.stances.stands[t, f]
            if not (heel or toe):
                continue
            place, own = self.stances.place[t, f], slice(-3 * (feet - f), -3 * (feet - f) + 3 or None)
            J, off = model.jacobian[own], place - model.points[own]
            first, second = (HEEL, TOE) if heel else (TOE, HEEL)
            rows.append(J[first])
            to.append(off[first])
            if heel and toe:
                ahead = place[TOE] - place[HEEL]
                aside = np.array([-ahead[1], ahead[0], 0.0]) / np.linalg.norm(ahead[:2])
                count = 3 if foot.rolls else 2
                rows.append(np.stack([aside @ J[second], J[second, 2], J[2, 2]][:count]))
                to.append(np.array([aside @ off[second], off[second, 2], off[2, 2]][:count]))
        return np.concatenate(rows), np.concatenate(to)

    def box(self, q: np.ndarray, t: int, before: np.ndarray | None, after: np.ndarray | None) -> np.ndarray:
        """Bounds (2, nv) of a step from q (nq,) in frame t by the joints' limits and velocities, with the frames before
        and after as they are."""
        bounds = np.stack(self.body.tangent_bounds(q))
        for other, k in ((before, t - 1), (after, t)):
            if other is not None:
                bounds = _common(bounds, self.reach(q, other, float(self.dt[k])))
        return bounds

    def reach(self, q: np.ndarray, other: np.ndarray, dt: float) -> np.ndarray:
        """Bounds (2, nv) of a step from q (nq,) by the joints' limits, and the velocities from another configuration,
        dt [s] away."""
        away, far = self.body.difference(q, other), self.speed * dt
        return _common(np.stack(self.body.tangent_bounds(q)), np.stack([away - far, away + far]))


def _common(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The intersection of two bounds (2, nv); where it is empty, the upper one."""
    low, high = np.maximum(a[0], b[0]), np.minimum(a[1], b[1])
    return np.stack([np.minimum(low, high), high])


def _speed_limits(body: Body) -> np.ndarray:
    """(nv,) [1/s], infinite at a free root and where the URDF has 0."""
    speed = np.array(body.model.velocityLimit, dtype=float)
    speed[: body.first_joint_dof] = np.inf
    return np.where(speed > 0.0, speed, np.inf)
