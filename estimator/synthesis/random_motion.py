"""Smooth random motions of any body, within its limits and without overlaps: truth for clips of one's own robot."""

from __future__ import annotations

import numpy as np

from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_V, Body

_KEY = 0.8  # [s] from one key pose to the next
_STEP = 1.0 / 120.0  # [s] between the poses that are checked for overlaps
_FASTEST = 3.0  # rad/s, or a third of it in m/s
_PEAK = 1.875  # highest speed of a way of least jerk over its mean
_WANDER = 1.2  # [rad] to either side, of a joint without limits
_TURN, _PLACE = 0.5, 0.15  # [rad], [m] to either side, of a free root
_TRIES, _WHOLE = 24, 12  # of a key: how many at all, and with the whole way


def random_motion(body: Body, times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Configurations (T, nq) at rising times (T,) [s] from 0 on.

    From the rest pose every 0.8 s towards another pose drawn within the limits, by ways of least jerk (T. Flash and N.
    Hogan, The coordination of arm movements, Journal of Neuroscience 5, 1985), no faster than 3 rad/s and the limits of
    the URDF. A way on which parts would overlap, or deeper than any do at rest (a robot's hulls may touch there), is
    drawn again, then shortened. A free root stays near where it began.
    """
    collision = SelfCollision(body)
    deepest = collision.penetration(body.at(body.neutral))
    q = np.empty((len(times), body.nq))
    pose, start = body.neutral, 0.0
    while start <= times[-1]:
        frames = np.flatnonzero((times >= start) & (times < start + _KEY))
        checked_times = np.concatenate([np.arange(0.0, _KEY + 0.5 * _STEP, _STEP), times[frames] - start])
        way = _way(body, (collision, deepest), pose, checked_times, rng)
        for i in frames:
            q[i] = body.integrate(pose, _share(times[i] - start) * way)
        pose, start = body.integrate(pose, way), start + _KEY
    return q


def _way(
    body: Body,
    allowed: tuple[SelfCollision, float],
    pose: np.ndarray,
    checked_times: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """A tangent (nv,) from a pose to the next key along which nothing overlaps, or no deeper than is allowed [m]; zero
    where none was found."""
    collision, deepest = allowed
    for attempt in range(_TRIES):
        way = _random_tangent(body, pose, rng) * 0.5 ** max(0, attempt - _WHOLE)
        posed = (body.at(body.integrate(pose, _share(t) * way)) for t in checked_times)
        if not any(collision.penetration(p) > deepest for p in posed):
            return way
    return np.zeros(body.nv)


def _random_tangent(body: Body, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A tangent (nv,) to a pose drawn within the limits, no longer than there is time for."""
    wanted = rng.uniform(-_WANDER, _WANDER, body.nv) + body.difference(pose, body.neutral)
    share = rng.uniform(0.05, 0.95, len(body.bounded_q))
    low, high = body.lower[body.bounded_q], body.upper[body.bounded_q]
    wanted[body.bounded_v] = low + share * (high - low) - pose[body.bounded_q]
    if body.has_free_root:
        home = body.difference(pose, body.neutral)[ROOT_V]
        wanted[ROOT_V] = home + rng.uniform(-1.0, 1.0, 6) * np.repeat([_PLACE, _TURN], 3)
    urdf = np.asarray(body.model.velocityLimit)
    fastest = np.where((urdf > 0.0) & np.isfinite(urdf), np.minimum(urdf, _FASTEST), _FASTEST)
    longest = fastest * _KEY / _PEAK
    return np.asarray(np.clip(wanted, -longest, longest))


def _share(time: float) -> float:
    """Of a way of least jerk that is behind at a time [s] after its beginning."""
    s = min(max(time / _KEY, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
