"""When points of the feet stand, by how fast they are and how high: a chain of two states for each point, standing and
moving, forwards and backwards (Rabiner, A tutorial on hidden Markov models, Proceedings of the IEEE 77(2), 1989)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.data.floor import KnownFloor
from estimator.inference.belt import Belt, belt_under, ways
from estimator.inference.ground import Ground, fitted_ground
from estimator.numerics.stretches import stretches

_SLIP, _SWING = (
    0.2,
    1.2,
)  # m/s: standard deviations of the speed of standing points, including rolling, and of moving ones
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
    """The same of points whose places (T, P, 3) [m] on what they stand on are known, which moves or not."""
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
