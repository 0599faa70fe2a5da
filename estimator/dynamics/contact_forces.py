"""Inverse dynamics with contact: the forces under the feet that a motion needs, and the moments of the joints.

Newton and Euler determine the sum of all external forces and their moment about the centre of mass, by the recursive
Newton-Euler algorithm on the floating base (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5). Which foot
carries how much is determined by it in single support, and only in part in double support. There a convex program
chooses: forces at points of the soles that push and do not pull, within their friction cones, as evenly as they can be,
that lead through a point above the centre of mass (the virtual pivot point of walking: Maus et al., Upright human gait
did not provide a major mechanical challenge for our ancestors, Nature Communications 1, 2010), nearer to it along the
way the body faces than across.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.dynamics.motion import Motion, facing, near_mean
from estimator.dynamics.soles import SolePoints
from estimator.dynamics.trunk import Trunk
from estimator.numerics.quadratic_program import UNBOUNDED, QuadraticProgram, solve
from humanoid.kinematics.body import ROOT_JOINT, ROOT_PLACE_V, ROOT_TURN_V, Body, PosedBody, points_in_world
from humanoid.support.settings import CheckedSettings, setting

GRAVITY = 9.81
"""[m/s2]"""
_SIDES = 4  # of the friction pyramid
_ACCURACY, _ITERATIONS = 1e-6, 200
_LOW = 0.1  # m: least height of the centre of mass over a point that is used
_FAINT = 1e-3  # probability of standing up to which a point carries nothing
_HAND = 2  # in place of a foot's number
_PRESSED = 0.02  # share of the weight, under a foot or a seat, below which it has no centre of pressure


@dataclass(frozen=True)
class ForceSettings(CheckedSettings):
    """How contact forces are chosen; forces in units of the body's weight, W.

    friction: of the ground. evenness: standard deviation of the force at a point of a sole that stands for certain [W],
        which is multiplied by the probability that a point stands. pivot_along, pivot_across: height of the centre of
        mass over that of the point through which a foot's force leads, both above the centre of pressure, along the way
        the body faces and across; aim_along, aim_across: standard deviations of the level force about it [W]. force,
        moment: standard deviations of the root's balance [W], [W m]. seat: cost of what a seat carries, so much more
        than that of the feet that it carries only what these cannot.

    pivots and aims are those of `python -m benchmarks forces --learn`.
    """

    friction: float = setting(0.8, above=0)
    evenness: float = setting(0.5, above=0)
    pivot_along: float = setting(0.84, at_least=0)
    pivot_across: float = setting(0.46, at_least=0)
    aim_along: float = setting(0.055, above=0)
    aim_across: float = setting(0.032, above=0)
    force: float = setting(0.005, above=0)
    moment: float = setting(0.0025, above=0)
    seat: float = setting(2.0, at_least=0)

    @property
    def pivot(self) -> np.ndarray:
        """Along and across (2,)."""
        return np.array([self.pivot_along, self.pivot_across])

    @property
    def aim(self) -> np.ndarray:
        """Along and across (2,) [W]."""
        return np.array([self.aim_along, self.aim_across])


class ContactLoads(NamedTuple):
    """Forces of T frames, world z up, NaN in frames without accelerations.

    force (T, F, 3) [N]: of the ground on each foot. pressure (T, F, 3) [m]: its centre of pressure, NaN where a foot
    carries nothing. free_moment (T, F) [N m]: about the vertical through it. seat (T, 3) [N]: what something else than
    the feet carries, at the hips. hands (T, H, 3) [N]: of the ground on hands. torque (T, nv) [N m or N]: of the
    joints, in the tangent space; those of a root are the residual of its balance, in its own frame.
    """

    force: np.ndarray
    pressure: np.ndarray
    free_moment: np.ndarray
    seat: np.ndarray
    hands: np.ndarray
    torque: np.ndarray


class Support(NamedTuple):
    """What may carry a body. standing (T, P): probability that points of the feet stand (`FootPoints`). seated (T,):
    that the hips rest on something. hands (T, H): that hands stand on the ground (`HandPoints`)."""

    standing: np.ndarray
    seated: np.ndarray
    hands: np.ndarray

    def blurred(self, time: np.ndarray, std: float) -> Support:
        """The probabilities with times (T,) [s] that are known up to a standard deviation [s]."""
        return Support(*(near_mean(time, part, std) for part in self))


class Disturbance(NamedTuple):
    """What a sample of loads differs by, in units of the weight: force (T, 3), added to the sum of all forces; sway
    (T, 2, 2): force of each foot along and across beside that which leads through its pivot."""

    force: np.ndarray
    sway: np.ndarray


class _Pose(NamedTuple):
    """What carries a body in one pose: points (P, 3) [m]; foot (P,): 0, 1, -1 of a seat, or 2 and more of hands;
    carries (P,): with which probability; centre (3,) [m]: of mass; facing (2,): see `facing`."""

    points: np.ndarray
    foot: np.ndarray
    carries: np.ndarray
    centre: np.ndarray
    facing: np.ndarray


class InverseDynamics:
    """Loads of a body with masses.

    inertias: of the joints' segments, in the order of the model's joints. seat (3,) [m]: where a seat carries, in the
    root's frame, None without one. hands (H,): numbers of the landmarks where hands may carry.
    """

    def __init__(
        self,
        body: Body,
        inertias: list[pin.Inertia],
        settings: ForceSettings,
        seat: np.ndarray | None = None,
        hands: np.ndarray | None = None,
    ) -> None:
        self.body, self.settings, self._seat = body, settings, seat
        self._hands = np.zeros(0, dtype=np.int64) if hands is None else hands
        self._model = pin.Model(body.model)
        for joint, inertia in enumerate(inertias):
            self._model.inertias[joint] = inertia
        self._model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
        self._data = self._model.createData()
        carrying = [(j, i) for j, i in enumerate(inertias) if i.mass > 0.0]
        self._masses = np.array([i.mass for _, i in carrying])
        self._mass_joint = np.array([j for j, _ in carrying])
        self._mass_place = np.array([i.lever for _, i in carrying])
        self.weight = GRAVITY * float(self._masses.sum())
        self._soles = SolePoints.of(body) if body.has_free_root else None

    def loads(self, motion: Motion, support: Support | None, disturbance: Disturbance | None = None) -> ContactLoads:
        """The loads of a motion; support None: nothing carries the body, as that of a fixed base."""
        count, feet = len(motion.q), 0 if support is None else 2
        loads = ContactLoads(
            np.full((count, feet, 3), np.nan), np.full((count, feet, 3), np.nan), np.full((count, feet), np.nan),
            np.full((count, 3), np.nan), np.full((count, len(self._hands), 3), np.nan),
            np.full((count, self.body.nv), np.nan),
        )  # fmt: skip
        ahead = facing(self.body, motion)
        for t in np.flatnonzero(motion.known):
            loads.torque[t] = self.torque_without_contact(motion, int(t))
            if support is not None:
                apart = None if disturbance is None else Disturbance(*(part[t] for part in disturbance))
                self._carry(loads, int(t), self.body.at(motion.q[t]), support, ahead[t], apart)
        return loads

    def torque_without_contact(self, motion: Motion, t: int) -> np.ndarray:
        """Torque (nv,) that frame t needs where nothing but its own joints, a free root's too, drives the body."""
        torque = np.array(pin.rnea(self._model, self._data, motion.q[t], motion.v[t], motion.a[t]))
        return torque if motion.lift is None else torque + self._lifting(self.body.at(motion.q[t]), motion.lift[t])

    def _lifting(self, posed: PosedBody, lift: float) -> np.ndarray:
        """Torque (nv,) that it takes to accelerate the trunk and what it carries by so much [m/s2] along its axis."""
        trunk = Trunk.of(self.body)
        assert trunk is not None
        own = np.isin(self._mass_joint, trunk.above)
        places = points_in_world(posed, self._mass_joint[own], self._mass_place[own])
        J = self.body.point_jacobians(posed, self._mass_joint[own], places)
        axis = posed.rotations[trunk.joint] @ trunk.axis
        return np.asarray(lift * np.einsum("p,pij,i->j", self._masses[own], J, axis))

    def centres(self, motion: Motion) -> np.ndarray:
        """Centres of mass (T, 3) [m], NaN in frames without a pose."""
        out = np.full((len(motion.q), 3), np.nan)
        for t in np.flatnonzero(np.isfinite(motion.q).all(axis=1)):
            out[t] = self._centre(self.body.at(motion.q[t]))
        return out

    def force_of_acceleration(self, motion: Motion) -> np.ndarray:
        """Force (T, 3) [N], in the world, that accelerates the centre of mass of a body with a free root."""
        out = np.full((len(motion.q), 3), np.nan)
        for t in np.flatnonzero(motion.known):
            wrench = self.torque_without_contact(motion, int(t))[ROOT_PLACE_V]
            out[t] = self._data.liMi[ROOT_JOINT].rotation @ wrench - [0.0, 0.0, self.weight]
        return out

    def _carry(
        self,
        loads: ContactLoads,
        t: int,
        posed: PosedBody,
        support: Support,
        ahead: np.ndarray,
        apart: Disturbance | None,
    ) -> None:
        """Fill what carries the body in frame t, and take its part from the torque, which is that without contact.
        ahead (2,): the way it faces. apart: the disturbance of this frame, (3,) and (2, 2)."""
        pose, joints = self._pose(posed, Support(*(part[t] for part in support)), ahead)
        torque, root = loads.torque[t], posed.placements[ROOT_JOINT]
        R_world_root = root[:9].reshape(3, 3).T
        wanted = R_world_root @ torque[ROOT_PLACE_V]
        moment = R_world_root @ torque[ROOT_TURN_V] + np.cross(root[9:] - pose.centre, wanted)
        sway = np.zeros((2, 2)) if apart is None else apart.sway
        if apart is not None:
            wanted = wanted + self.weight * apart.force
        pushes = self._pushes(pose, wanted, moment, sway)
        torque -= np.einsum("pij,pi->j", self.body.point_jacobians(posed, joints, pose.points), pushes)
        for foot in range(loads.force.shape[1]):
            own = pose.foot == foot
            loads.force[t, foot] = pushes[own].sum(axis=0)
            pressed = pushes[own, 2].sum()
            if pressed > _PRESSED * self.weight:
                loads.pressure[t, foot] = pushes[own, 2] @ pose.points[own] / pressed
                turning = np.cross(pose.points[own] - loads.pressure[t, foot], pushes[own])
                loads.free_moment[t, foot] = turning[:, 2].sum()
            else:
                loads.free_moment[t, foot] = 0.0
        loads.seat[t] = pushes[pose.foot == -1].sum(axis=0)
        for hand in range(len(self._hands)):
            loads.hands[t, hand] = pushes[pose.foot == _HAND + hand].sum(axis=0)

    def _pose(self, posed: PosedBody, support: Support, ahead: np.ndarray) -> tuple[_Pose, np.ndarray]:
        """What carries the body in a pose, by the support in its frame, and the joints (P,) of its points."""
        assert self._soles is not None
        joints, local, foot = self._soles.joint, self._soles.local, self._soles.foot
        carries, hands = support.standing[self._soles.point], self._hands
        if self._seat is not None:
            joints, foot = np.append(joints, ROOT_JOINT), np.append(foot, -1)
            local, carries = np.vstack([local, self._seat]), np.append(carries, support.seated)
        if len(hands):
            joints = np.concatenate([joints, self.body.landmark_joint[hands]])
            local = np.vstack([local, self.body.landmark_local[hands]])
            foot = np.concatenate([foot, _HAND + np.arange(len(hands))])
            carries = np.concatenate([carries, support.hands])
        return _Pose(points_in_world(posed, joints, local), foot, carries, self._centre(posed), ahead), joints

    def _centre(self, posed: PosedBody) -> np.ndarray:
        """The centre of mass (3,) [m]."""
        places = points_in_world(posed, self._mass_joint, self._mass_place)
        return np.asarray(self._masses @ places / self._masses.sum())

    def _pushes(self, pose: _Pose, wanted: np.ndarray, moment: np.ndarray, sway: np.ndarray) -> np.ndarray:
        """Forces (P, 3) [N] at the points, whose sum is `wanted` (3,) [N] and whose moment about the centre of mass is
        `moment` (3,) [N m], as near as these can be; sway (2, 2): see `Disturbance`."""
        s, pushes = self.settings, np.zeros_like(pose.points)
        carrying = np.flatnonzero(pose.carries > _FAINT)
        if not len(carrying):
            return pushes
        arms, foot = pose.points[carrying] - pose.centre, np.repeat(pose.foot[carrying], _SIDES)
        edges = _cone(s.friction)
        along = np.tile(edges, len(arms))  # (3, n): pushes by each edge of each point's cone
        turning = (_hats(arms) @ edges).transpose(1, 0, 2).reshape(3, -1)
        rows, aims = [along / s.force, turning / s.moment], [wanted / s.force, moment / s.moment]
        ways = _ways(pose.facing)
        towards = -s.pivot * (arms[:, :2] @ ways.T) / np.maximum(-arms[:, 2:], _LOW)  # of a unit of upward force
        lean = ways @ along[:2] - np.repeat(towards, _SIDES, axis=0).T * along[2]
        for k in range(2):
            rows.append((foot == k) * lean / s.aim[:, None])
            aims.append(self.weight * sway[k] / s.aim)
        A, b = np.vstack(rows), np.concatenate(aims) / self.weight
        cost = np.square(1.0 / (s.evenness * np.repeat(pose.carries[carrying], _SIDES)))
        n, none = len(foot), np.zeros(0)
        program = QuadraticProgram(
            A.T @ A + np.diag(cost), np.where(foot == -1, s.seat, 0.0) - A.T @ b, np.zeros((0, n)), none,
            np.zeros((0, n)), none, none, np.zeros(n), np.full(n, UNBOUNDED),
        )  # fmt: skip
        share = np.maximum(solve(program, _ACCURACY, _ITERATIONS).x, 0.0)
        pushes[carrying] = self.weight * (along * share).reshape(3, -1, _SIDES).sum(axis=2).T
        return pushes


@cache
def _cone(friction: float) -> np.ndarray:
    """Edges (3, 4) of a pyramid inside the friction cone of level ground, with upward parts of 1."""
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    return np.stack([friction * np.cos(angles), friction * np.sin(angles), np.ones(_SIDES)])


def _ways(facing: np.ndarray) -> np.ndarray:
    """Unit vectors in rows (2, 2): along the way a body faces (2,), and to its left."""
    return np.array([facing, [-facing[1], facing[0]]])


def _hats(arms: np.ndarray) -> np.ndarray:
    """Matrices (P, 3, 3) of the cross products by vectors (P, 3)."""
    x, y, z = arms.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
