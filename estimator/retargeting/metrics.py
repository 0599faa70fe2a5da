"""Figures of a robot's motion: whether it is possible, how it stands, and how far it is from the motion it follows."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.inference.contacts import FootPoints, stances_of
from estimator.inference.ground import Ground
from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.correspondence import MatchedLimb
from estimator.retargeting.likeness import LIMBS, likeness_of
from estimator.retargeting.problem import parts_of
from estimator.retargeting.source import SourceMotion
from estimator.runs.contact import Contact
from estimator.runs.run_reader import Run
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body, batches

OVERLAP = 0.001
"""[m] of two parts: what is deeper is a self-collision."""
BELOW = 0.005
"""[m] under the floor: what is deeper is below the ground."""
_OVER = 1e-6  # rad, and share of a velocity: rounding
_UP = np.array([0.0, 0.0, 1.0])
_PARTS = 3  # kinds of points of a sole: heel, big toe, small toe
_DIRECTIONS = 180  # in which the extent of a stance's places is measured
SKATES = 0.01
"""[m] along the floor within `PER`: what stands and moves more, skates."""
PER = 1.0 / 30.0
"""[s] A frame of most films; of a faster one several."""
NEAR = 0.02
"""[m] above or below where it would stand: what ought to stand and is farther off, does not keep contact."""
_TOUCHES = 1e-4  # m: points that are not deeper rest on the floor
_TINY = 1e-6  # s


class RetargetMetrics(NamedTuple):
    """Figures of T frames; NaN where there is nothing to judge. Shares are of 1.

    frames: T. over_limits: share of the frames in which a joint is beyond a limit of its position, furthest_over [rad
    or m]: the most. too_fast: share of the steps between frames in which a joint is faster than its limit, speed_ratio:
    largest speed over the limit. colliding: share of the frames in which parts overlap by over `OVERLAP`, overlap [m]:
    the deepest. below_floor: share in which the lowest part is over `BELOW` under the floor, deepest [m]: the most.
    slip [m]: the largest of how far a point of a sole moves along the floor while it is to stand, in one stance;
    median_slip [m]: of the stances.

    penetrating, skating, near: as `Footing` has them (OmniRetarget, Yang et al. 2025, arXiv 2509.26633): share of the
    frames with anything below the floor, of the standing points and frames that moved over 1 cm within 1/30 s, of those
    that ought to stand that are within 2 cm of the floor.

    limb_angle, worst_limb_angle [deg]: mean and largest angle between a limb and that which it follows, see
    `Likeness`. root_rms, root_worst [m]: distance of the middle of the hips from the scaled path. acceleration
    [rad/s^2], jerk [rad/s^3]: RMS over joints and frames, by differences.
    """

    frames: int
    over_limits: float
    furthest_over: float
    too_fast: float
    speed_ratio: float
    colliding: float
    overlap: float
    below_floor: float
    deepest: float
    slip: float
    median_slip: float
    penetrating: float
    skating: float
    near: float
    limb_angle: float
    worst_limb_angle: float
    root_rms: float
    root_worst: float
    acceleration: float
    jerk: float


class RetargetMeter:
    """Measures motions of one body: the distance model of its parts is made once. One object serves one thread.

    limbs: whose directions are compared.
    """

    def __init__(self, body: Body, limbs: tuple[MatchedLimb, ...] = LIMBS) -> None:
        self.body, self._limbs = body, limbs
        self._collision = parts_of(body, 0.0)
        self._ground = FloorDistances(body, _UP, 0.0)

    def metrics(
        self,
        q: np.ndarray,
        times: np.ndarray,
        *,
        source: SourceMotion | None = None,
        contacts: SourceContacts | None = None,
        floor: float | None = 0.0,
        scale: float | None = None,
    ) -> RetargetMetrics:
        """The figures of configurations q (T, nq) at ascending times (T,) [s].

        source: the motion that is followed, at the same frames; without it there is no likeness. contacts: which points
        of the soles are to stand, those that `source_contacts` has of the source; without it nothing is. floor [m]:
        height of the level floor that the body is to stand on, None without one. scale: of the root's path, the ratio
        of the legs' lengths unless given.
        """
        body = self.body
        placed = body.placed(q)
        landmarks = body.landmarks_of(placed)
        over, ratio, overlap = _over_limits(body, q), _speed_ratios(body, q, times), self._overlaps(q)
        depth = np.full(len(q), np.nan)
        if floor is not None:
            depth = np.maximum(0.0, floor - self._ground.lowest(placed))
        contact = _contact(body, landmarks, times, contacts, floor)
        slips = slips_of(contact.points, contact.standing)
        footing = footing_by_depth(depth, contact)
        near = likeness_of(body, landmarks, source, self._limbs, scale)
        acceleration, jerk = _shaking(body, q, times)
        return RetargetMetrics(
            frames=len(q), over_limits=_share(over > _OVER), furthest_over=_most(over),
            too_fast=_share(ratio > 1.0 + _OVER), speed_ratio=_most(ratio), colliding=_share(overlap > OVERLAP),
            overlap=_most(overlap), below_floor=_share(depth[np.isfinite(depth)] > BELOW), deepest=_most(depth),
            slip=_most(slips), median_slip=_middle(slips),
            penetrating=footing.penetrating, skating=footing.skating, near=footing.near,
            limb_angle=near.mean, worst_limb_angle=near.worst, root_rms=near.root_rms, root_worst=near.root_worst,
            acceleration=acceleration, jerk=jerk,
        )  # fmt: skip

    def _overlaps(self, q: np.ndarray) -> np.ndarray:
        """Deepest overlap of two parts in each frame (T,) [m]."""
        deepest = []
        for part in batches(q):
            starts, distances = self._collision.distances(self.body.placed(part))
            for first, after in pairwise(starts.tolist()):
                deepest.append(max(0.0, -float(distances[first:after].min(initial=0.0))))
        return np.array(deepest)


def slips_of(points: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """How far points (T, P, 3) [m] move along a level floor in each stance (S,): the largest distance of two of its
    places. standing (T, P): probabilities, or bool. Stances of one frame do not count."""
    turn = np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across = np.stack([np.cos(turn), np.sin(turn)])
    stances = [stance for stance in stances_of(np.asarray(standing, float)) if stance[2] - stance[1] > 1]
    return np.array([np.ptp(points[first:after, k, :2] @ across, axis=0).max() for k, first, after in stances])


def _contact(
    body: Body, landmarks: np.ndarray, times: np.ndarray, contacts: SourceContacts | None, floor: float | None
) -> Contact:
    """The body's points of the soles among landmarks (T, L, 3) with the standing of those that they follow."""
    names = () if contacts is None else tuple(name for name in contacts.names if name in body.landmark_names)
    points = landmarks[:, [body.landmark_names.index(name) for name in names]]
    standing = np.zeros((len(times), 0))
    if contacts is not None:
        standing = contacts.standing[:, [contacts.names.index(name) for name in names]].astype(float)
    ground = None if floor is None else Ground(_UP, floor, 0.0, _above_soles(body))
    return Contact(times, names, points, standing, ground, np.ones(len(names)))


def _above_soles(body: Body) -> np.ndarray:
    """How high each kind of a foot's points is above the sole, level (K,) [m]."""
    above, feet = np.zeros(_PARTS), FootPoints.of(body)
    if feet is not None:
        above[: len(feet.above)] = feet.above
    return above


def _over_limits(body: Body, q: np.ndarray) -> np.ndarray:
    """How far the furthest joint of each frame is beyond its limits (T,) [rad or m], 0 where none is."""
    i = body.bounded_q
    return np.asarray(np.maximum(q[:, i] - body.upper[i], body.lower[i] - q[:, i]).max(axis=1, initial=0.0))


def _speed_ratios(body: Body, q: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Largest ratio of a joint's speed to its limit in each step (T - 1,); the root has no limit."""
    limit = body.model.velocityLimit[body.first_joint_dof :]
    limited = np.isfinite(limit) & (limit > 0.0)
    speed = np.abs(_velocities(body, q, times))[:, limited]
    return np.asarray((speed / limit[limited]).max(axis=1, initial=0.0))


def _velocities(body: Body, q: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Velocities of the joints without the root (T - 1, n) [1/s]."""
    steps = [body.difference(a, b)[body.first_joint_dof :] for a, b in pairwise(q)]
    return np.array(steps).reshape(-1, body.nv - body.first_joint_dof) / np.diff(times)[:, None]


def _shaking(body: Body, q: np.ndarray, times: np.ndarray) -> tuple[float, float]:
    """RMS acceleration [rad/s^2] and jerk [rad/s^3] of the joints."""
    rates, at = [_velocities(body, q, times)], 0.5 * (times[1:] + times[:-1])
    for _ in range(2):
        rates.append(np.diff(rates[-1], axis=0) / np.diff(at)[:, None])
        at = 0.5 * (at[1:] + at[:-1])
    acceleration, jerk = (float(np.sqrt(np.square(r).mean())) if r.size else float("nan") for r in rates[1:])
    return acceleration, jerk


def _share(holds: np.ndarray) -> float:
    return float(holds.mean()) if len(holds) else float("nan")


def _middle(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _most(values: np.ndarray) -> float:
    return float(values.max()) if len(values) else float("nan")


class Footing(NamedTuple):
    """Figures as retargeting is judged by (OmniRetarget, Yang et al. 2025), NaN where there is nothing to judge.

    penetrating: share of the frames in which any part of the body is below the floor, deepest [m]: the most of all.
    skating: share of standing points, over frames, that have moved over `SKATES`. near: share of the points that ought
    to stand within `NEAR` of the floor.
    """

    penetrating: float
    deepest: float
    skating: float
    near: float


def footing_of(run: Run, contact: Contact, standing: np.ndarray | None = None) -> Footing:
    """Footing of a run's drawn trajectory and its contact, see `footing_by_depth`."""
    depth = np.full(1, np.nan)
    if contact.floor is not None and len(run.q):
        floor = FloorDistances(run.body, contact.floor.normal, contact.floor.height)
        depth = np.maximum(0.0, -floor.lowest(run.body.placed(run.q)))
    return footing_by_depth(depth, contact, standing)


def footing_by_depth(depth: np.ndarray, contact: Contact, standing: np.ndarray | None = None) -> Footing:
    """Footing from the depth of the lowest part below the floor (T,) [m] and from contact; standing (T, P) bool: which
    points ought to stand, by default those that do by contact."""
    stands = contact.standing > 0.5
    off = np.abs(contact.heights[stands if standing is None else standing])
    moved = _moved(contact)[stands]
    return Footing(
        _share_standing(depth > _TOUCHES, depth),
        float(depth.max()),
        _share_standing(moved > SKATES, moved),
        _share_standing(off <= NEAR, off),
    )


def _moved(contact: Contact) -> np.ndarray:
    """Distance (T, P) [m] along the floor of each standing point, which also stood `PER` before or in the last older
    frame, from its place then; NaN for others."""
    before = np.searchsorted(contact.time, contact.time - PER + _TINY, side="right") - 1
    places = contact.places
    way = places - places[before]
    up = np.array([0.0, 0.0, 1.0]) if contact.floor is None else contact.floor.normal
    moved = np.linalg.norm(way - (way @ up)[..., None] * up, axis=2)
    return np.where((contact.standing[before] > 0.5) & (before >= 0)[:, None], moved, np.nan)


def _share_standing(holds: np.ndarray, of: np.ndarray) -> float:
    """Share of the known values that are true."""
    known = np.isfinite(of)
    return float(holds[known].mean()) if known.any() else float("nan")
