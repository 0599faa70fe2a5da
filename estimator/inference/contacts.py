"""Contact of a body: when points of its feet stand, by how fast they are and how high, a chain of two states for each
point, standing and moving, forwards and backwards (Rabiner, A tutorial on hidden Markov models, Proceedings of the IEEE
77(2), 1989); the floor that it stands on, found or known; and hands on it, as in a cartwheel, a push-up or a crawl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.floor import OFF, KnownFloor
from estimator.energy.priors import world_up
from estimator.inference.belt import Belt, belt_under, ways
from estimator.inference.ground import Ground, fitted_ground
from estimator.numerics.stretches import stretches
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body, batches
from humanoid.shape.solids import heights_above_soles
from humanoid.subject.landmarks import foot_landmarks, foot_parts
from humanoid.support.per_object import per_object

_SLIP, _SWING = 0.2, 1.2  # m/s: standard deviations of the speed of standing points, with rolling, and of moving ones
_LOW, _RAISED = 0.03, 0.15  # m: of the height above the floor, for standing and for moving points
_ELSEWHERE, _REACH = 0.05, 0.5  # share of standing on something else, within this many metres
_MOVING, _STANDING = 0.4, 0.6  # s: mean duration of either
_CORRELATION = 0.05  # s: frames nearer than that are correlated
_HALF = 0.034  # s, to either side, over which a speed is measured
_ROUNDS = 2


class FootContact(NamedTuple):
    """standing (T, P): probability that each point stands, NaN on a belt of unknown speed. floor: None where nothing
    stands. belt: of a treadmill, None without one."""

    standing: np.ndarray
    floor: Ground | None
    belt: Belt | None = None


def foot_contact(
    points: np.ndarray,
    time: np.ndarray,
    kind: np.ndarray,
    up: np.ndarray,
    *,
    above: np.ndarray | None = None,
    floor: KnownFloor | Ground = None,
    seen: np.ndarray | None = None,
) -> FootContact:
    """Which points of the feet stand, and the floor that they stand on.

    points (T, P, 3) [m], NaN where missing, at times (T,) [s], rising. kind (P,), above (K,): see `fitted_ground`. up
    (3,): unit vector in their world. At first only speeds are used, then also heights above the floor that follows from
    them, or that is known ("off": only speeds). What rests elsewhere, such as on a box or a stair, may stand. seen (T,
    P): which points were observed, by default all; a floor is found by those alone, and lies under nine tenths of what
    stands on it. What moves with the belt of a treadmill, which is found by both feet, stands.
    """
    shown = points if seen is None else np.where(seen[..., None], points, np.nan)
    belt = belt_under(shown, time, kind, up)
    if belt is None:
        return _contact_of_places(points, points, time, kind, up, above, floor, seen)
    places = belt.places(points) if belt.known else points
    contact = _contact_of_places(points, places, time, kind, up, above, floor, seen)
    standing = contact.standing if belt.known else np.full_like(contact.standing, np.nan)
    return contact._replace(standing=standing, belt=belt)


def _contact_of_places(
    points: np.ndarray,
    places: np.ndarray,
    time: np.ndarray,
    kind: np.ndarray,
    up: np.ndarray,
    above: np.ndarray | None,
    floor: KnownFloor | Ground,
    seen: np.ndarray | None,
) -> FootContact:
    """The same for points whose places (T, P, 3) [m] on what they stand on are known, which moves or not."""
    standing = standing_probability(places, time)
    if isinstance(floor, str):
        return FootContact(standing, None)
    if floor is not None:
        soles = np.zeros(int(kind.max()) + 1) if above is None else above
        known = floor if isinstance(floor, Ground) else Ground(up, float(floor), 0.0, soles)
        return FootContact(standing_probability(places, time, known.heights(points, kind)), known)
    shown = True if seen is None else seen
    ground = None
    for _ in range(_ROUNDS):
        ground = fitted_ground(points, standing * shown, kind, up, above=above)
        if ground is None:
            return FootContact(standing, None)
        standing = standing_probability(places, time, ground.heights(points, kind))
    return FootContact(standing, None if ground is None else ground.under(points, standing * shown, kind))


def standing_probability(points: np.ndarray, time: np.ndarray, height: np.ndarray | None = None) -> np.ndarray:
    """Probability (T, P) that points (T, P, 3) [m] stand, at times (T,) [s]; height (T, P) [m]: above the floor, if one
    is known. A missing point is interpolated from before and after."""
    if len(time) < 2:
        return np.full(points.shape[:2], 0.5)
    log = _log_likelihood(_speeds(points, time), height)
    log *= np.minimum(1.0, np.gradient(time) / _CORRELATION)[:, None, None]
    return _smoothed(np.where(np.isfinite(log), log, 0.0), np.diff(time))


def stances_of(standing: np.ndarray) -> list[tuple[int, int, int]]:
    """Stretches in which points stand rather than move, by probabilities (T, P): the point, the first frame and the one
    after the last, point by point."""
    return [(k, *stretch) for k, stands in enumerate(standing.T > 0.5) for stretch in stretches(stands)]


def _speeds(points: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(T, P) [m/s], by central differences over at least a frame to either side."""
    way, seconds = ways(points, time, _HALF)
    return np.asarray(np.linalg.norm(way, axis=2) / seconds[:, None])


def _log_likelihood(speed: np.ndarray, height: np.ndarray | None) -> np.ndarray:
    """Log-likelihood of moving and standing (T, P, 2), by speeds (T, P) and heights (T, P)."""
    moving, standing = (-0.5 * np.square(speed / std) - 3.0 * np.log(std) for std in (_SWING, _SLIP))
    if height is not None:
        above = np.maximum(height, 0.0)
        on_floor = np.exp(-0.5 * np.square(above / _LOW)) / _LOW
        standing = standing + np.log((1.0 - _ELSEWHERE) * on_floor + _ELSEWHERE / _REACH)
        moving = moving - 0.5 * np.square(above / _RAISED) - np.log(_RAISED)
    return np.stack([moving, standing], axis=2)


def _smoothed(log: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Probability (T, P) of the second state by the log likelihoods (T, P, 2) of all frames, `gaps` (T - 1,) [s]
    apart."""
    leave = 1.0 - np.exp(-gaps[:, None] / (_MOVING, _STANDING))
    change = np.log([[1.0 - leave[:, 0], leave[:, 0]], [leave[:, 1], 1.0 - leave[:, 1]]])  # from, to, gap
    forward, backward = log.copy(), np.zeros_like(log)
    for t in range(1, len(log)):
        forward[t] += np.logaddexp.reduce(forward[t - 1][:, :, None] + change[:, :, t - 1], axis=1)
    for t in range(len(log) - 2, -1, -1):
        ahead = log[t + 1] + backward[t + 1]
        backward[t] = np.logaddexp.reduce(ahead[:, None, :] + change[:, :, t], axis=2)
    both = forward + backward
    return np.asarray(np.exp(both[..., 1] - np.logaddexp(both[..., 0], both[..., 1])))


class FootPoints(NamedTuple):
    """Heels and toes.

    names (P): of the landmarks, the left foot's first. landmark (P,): their numbers among the body's. kind (P,): alike
    for the same part of both feet. above (K,) [m]: of each kind above the sole, where a foot is level.
    """

    names: tuple[str, ...]
    landmark: np.ndarray
    kind: np.ndarray
    above: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> FootPoints | None:
        """None of a body without heels and toes as landmarks."""
        names = foot_landmarks(body.landmark_names)
        if not names:
            return None
        landmark, kind = np.array([body.landmark_names.index(name) for name in names]), foot_parts(names)
        heights, above = heights_above_soles(body, landmark.tolist()), np.zeros(int(kind.max()) + 1)
        for k in np.unique(kind):
            above[k] = heights[kind == k].mean()
        return FootPoints(names, landmark, kind, above)

    def contact(
        self,
        points: np.ndarray,
        time: np.ndarray,
        up: np.ndarray,
        floor: KnownFloor | Ground,
        seen: np.ndarray | None = None,
    ) -> FootContact:
        """`foot_contact` of these points (T, P, 3)."""
        return foot_contact(points, time, self.kind, up, above=self.above, floor=floor, seen=seen)


_WRISTS = ("left_wrist", "right_wrist")
_ABOVE = 0.05  # m: of a wrist above the floor that its palm is on
_NEAR = 0.12  # m: points higher above their standing place are not on the floor, however still they are


class HandPoints(NamedTuple):
    """Wrists. names (H): of the landmarks, the left one's first. landmark (H,): their numbers among the body's."""

    names: tuple[str, ...]
    landmark: np.ndarray

    @staticmethod
    def of(body: Body) -> HandPoints | None:
        """None of a body without wrists as landmarks."""
        names = tuple(name for name in _WRISTS if name in body.landmark_names)
        return HandPoints(names, np.array([body.landmark_names.index(n) for n in names])) if names else None

    def standing(self, points: np.ndarray, time: np.ndarray, floor: Ground | None) -> np.ndarray:
        """Probability (T, H) that wrists at points (T, H, 3) [m] stand at times (T,) [s]; 0 without a floor."""
        if floor is None:
            return np.zeros(points.shape[:2])
        height = points @ floor.normal - floor.height - _ABOVE
        return np.where(height < _NEAR, standing_probability(points, time, height), 0.0)


_FARTHEST = 0.5  # m: of the lowest part from the floor, in the middle of the frames
_BURIED, _RARELY = 0.04, 0.1
"""[m] How deep a body may be below a floor that was found from its feet, and in what share of the frames deeper. Of 20
captured and made motions on level floors, by markers, three cameras and one, a tenth of the frames is at most 2.4 cm
deep; of people whose feet rest on a stool, a wall or in the air, 4.8 cm to 1.7 m (`python -m benchmarks floors`)."""


def floor_of(body: Body, cameras: Sequence[Camera], known: KnownFloor) -> FloorDistances | None:
    """Distances to a floor of known height; None where there is none."""
    return None if known is None or known == OFF else FloorDistances(body, world_up(cameras), known)


def height_above(floor: FloorDistances, body: Body, q: np.ndarray) -> float:
    """Height of the lowest part of a body above a floor [m], the median of poses q (T, nq) without those that are NaN;
    NaN where none is left, or the body has no flesh."""
    posed = q[np.isfinite(q).all(axis=1)]
    lowest = np.concatenate([floor.lowest(body.placed(some)) for some in batches(posed)])
    return float(np.median(lowest)) if len(lowest) and np.isfinite(lowest).all() else np.nan


def is_believed(height: float) -> bool:
    """Whether the floor may be where it was given, by `height_above`: a body that is far from it has another."""
    return not abs(height) > _FARTHEST


def believed_floor(body: Body, cameras: Sequence[Camera], known: KnownFloor, q: np.ndarray) -> KnownFloor:
    """The known floor, None where poses q (T, nq) are far from it."""
    floor = floor_of(body, cameras, known)
    return known if floor is None or is_believed(height_above(floor, body, q)) else None


class FeetOnFloor(NamedTuple):
    """standing (T, P): probability that each point of the feet stands. floor: what they stand on, None without one.
    raised: what they rest on while the body lies deep below it, which is not a floor; None where they do not. belt: of
    a treadmill, None without one."""

    standing: np.ndarray
    floor: Ground | None
    raised: Ground | None = None
    belt: Belt | None = None


def feet_on_floor(
    body: Body,
    feet: FootPoints,
    q: np.ndarray,
    points: np.ndarray,
    times: np.ndarray,
    up: np.ndarray,
    known: KnownFloor | Ground,
    seen: np.ndarray | None,
) -> FeetOnFloor:
    """Contact of a body's feet, as `FootPoints.contact` finds it; a floor that is found has to be below the body.

    q (T, nq): poses that were found without it; points (T, P, 3) [m]: of the feet there.
    """
    standing, floor, belt = feet.contact(points, times, up, known, seen)
    if known is not None or floor is None:
        return FeetOnFloor(standing, floor, belt=belt)
    lower = _supporting(body, floor, q)
    if lower is not None:
        return FeetOnFloor(standing, lower, belt=belt)
    return FeetOnFloor(feet.contact(points, times, up, OFF, seen).standing, None, floor, belt)


def _supporting(body: Body, ground: Ground, q: np.ndarray) -> Ground | None:
    """The floor, or None where the body lies deep below it in poses q (T, nq); lowered to where the body lies in the
    middle of the frames, where that is a little below: soles are less well known than the places of heels and toes."""
    floor = FloorDistances(body, ground.normal, ground.height)
    lowest = np.concatenate([floor.lowest(body.placed(some)) for some in batches(q)])
    lowest = lowest[np.isfinite(lowest)]
    if not len(lowest):
        return ground
    if np.quantile(lowest, _RARELY) < -_BURIED:
        return None
    sunk = max(0.0, -float(np.median(lowest)))
    return replace(ground, height=ground.height - sunk, above=ground.above + sunk)
