"""The belt of a treadmill, by how the feet move: what stands on it moves with its velocity, both feet alike, while the
body stays about where it is and the feet come forward faster than they go back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.numerics.stretches import stretches

_HALF = 0.06  # s to either side over which a velocity is measured: less than half a stance, long against noise
_TINY = 1e-9  # s
_EVEN = 0.05  # m/s: speeds that differ less are one
_SLOWEST = 0.3  # m/s of a belt; less is a foot that rolls, or a trajectory that drifts
_STEEPEST = 0.25  # rise over run of a belt
_WIDTH, _SPREAD = 0.15, 0.1  # m/s, and of the belt's speed: standard deviation of the velocity of standing points
_WITH = 1.5  # standard deviations within which a foot moves with the belt
_SHARE, _BOTH = 0.2, 0.5  # of the frames with motion in which a foot moves with the belt, and both feet's together
_REST = 0.2  # of these frames in which a foot rests: those that rest more are not on one whose speed is unknown
_FLAT = 0.02  # of these frames in which feet are flat, at least, where they give the speed
_FORWARD = 1.15  # of the belt's speed: feet on cranks, and swinging legs, come forward as fast as they go back
_CRANKS = 2.3  # m/s: feet on cranks are hardly faster; 0.17 m at two turns a second are 2.1
_QUICK = 0.95  # quantile of the speed forward
_DRIFT = 0.35  # of the belt's speed: how fast the body may move on
_STILL = 0.2  # m/s: where no point of the feet is faster, the person stands still, and the belt is at rest
_SECONDS, _FRAMES = 0.8, 12  # with motion, at least
_MOST = 400  # velocities that are candidates, and frames by which they are compared
_ROUNDS = 20
_BACK = 0.3  # of the quickest way back: frames in which a foot goes back
_LOWEST = 0.02  # quantile of the heights of a foot
_LOW, _LEVEL = 0.025, 0.6  # m above the lowest, and share of the frames in which a foot goes back so low
_TURNS = -0.5  # correlation of the velocities of feet that go forward by turns, at most
_MOST_SPEEDS, _COUNT = 2.0, 41  # of the steady speed, and how many speeds are compared
_SPEED_WIDTH = 0.15  # m/s: standard deviation of the velocity of standing points
_OTHERWISE = 0.05  # likelihood of a frame in which no foot moves with the belt
_CORRELATION = 0.05  # s: frames nearer than that are correlated
_ACCELERATION = 0.25  # of the steady speed: standard deviation of a change in a second, growing with the root of time
_CHANGE, _SPEED_SHARE = 0.2, 0.2  # m/s, and share of the steady speed: what differs by more is another speed
_LASTS = 0.5  # s, where it lasts
_SMOOTH = 0.15  # s to either side, over which steps of the grid are smoothed


@dataclass(frozen=True)
class Belt:
    """velocity (3,) [m/s]: of a belt, horizontal, while it runs steadily. speeds (T,) [m/s]: along it, which are less
    where it starts or stops. way (T, 3) [m]: how far it has moved since the first frame. known: whether feet move with
    it; where they go back along a level floor without a common speed, the velocity has the direction of a belt, and a
    speed in the middle of theirs."""

    velocity: np.ndarray
    speeds: np.ndarray
    way: np.ndarray
    known: bool = True

    @staticmethod
    def of(velocity: np.ndarray, speeds: np.ndarray, time: np.ndarray, *, known: bool = True) -> Belt:
        """The belt with the path that follows from speeds (T,) at times (T,) [s]."""
        metres = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(time))])
        return Belt(velocity, speeds, metres[:, None] * (velocity / np.linalg.norm(velocity)), known)

    @property
    def described(self) -> str:
        """Its speed in words, as "1.20 m/s" or "0.00 to 1.20 m/s"."""
        least, most = self.speeds.min(), self.speeds.max()
        return f"{least:.2f} to {most:.2f} m/s" if most - least > _EVEN else f"{self.speed:.2f} m/s"

    @property
    def speed(self) -> float:
        """[m/s]"""
        return float(np.linalg.norm(self.velocity))

    def places(self, points: np.ndarray) -> np.ndarray:
        """Points (T, P, 3) [m] as seen from the belt, on which what stands stays."""
        return np.asarray(points - self.way[:, None])


def belt_under(points: np.ndarray, time: np.ndarray, kind: np.ndarray, up: np.ndarray) -> Belt | None:
    """The belt that feet walk or run on, None where there is none.

    points (T, P, 3) [m] of both feet, NaN where missing, at times (T,) [s], rising; kind (P,): the same for the same
    part of both, the first foot's first. up (3,): unit vector in their world.
    """
    feet = _both_feet(kind)
    if feet is None or len(time) < _FRAMES:
        return None
    motion = _Motion.of(points[:, feet], time)
    if motion is None:
        return None
    velocity = motion.common_velocity()
    rise = float(velocity @ up)
    level = velocity - rise * up
    speed = float(np.linalg.norm(level))
    if speed >= _SLOWEST and abs(rise) <= _STEEPEST * speed and motion.walks_on(velocity, level, up):
        flat = motion.of_flat_feet(velocity)
        level = flat - (flat @ up) * up
        return Belt.of(level, speeds_over_time(velocities(points[:, feet], time), time, level), time)
    rests = motion.moved_with(np.zeros(3)).min() >= _REST
    back = None if rests else motion.level_way_back(up)
    if back is None:
        return None
    return Belt.of(back, np.full(len(time), float(np.linalg.norm(back))), time, known=False)


def ways(points: np.ndarray, time: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (T, P, 3) of points (T, P, 3) [m], and their durations (T,) [s], from `half` [s] before until
    `half` after each frame, at least a frame to either side."""
    frames, last = np.arange(len(time)), len(time) - 1
    first = np.minimum(np.searchsorted(time, time - half - _TINY), np.maximum(frames - 1, 0))
    end = np.maximum(np.searchsorted(time, time + half + _TINY, side="right") - 1, np.minimum(frames + 1, last))
    return points[end] - points[first], time[end] - time[first]


def velocities(points: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Velocities (T, 2, K, 3) [m/s] of points of both feet (T, 2, K, 3) [m] at times (T,) [s]."""
    way, seconds = ways(points.reshape(len(time), -1, 3), time, _HALF)
    return np.asarray((way / seconds[:, None, None]).reshape(points.shape))


def _both_feet(kind: np.ndarray) -> np.ndarray | None:
    """Numbers (2, K) of the points of both feet, None of one foot."""
    pairs = [np.flatnonzero(kind == k) for k in np.unique(kind)]
    return np.array(pairs).T if all(len(pair) == 2 for pair in pairs) else None


class _Motion(NamedTuple):
    """Motion of both feet: places (T, 2, K, 3) [m] and velocities (T, 2, K, 3) [m/s] of their points, NaN where
    missing, in the frames (T,) [s] in which any is faster than a person who stands."""

    time: np.ndarray
    places: np.ndarray
    velocity: np.ndarray

    @staticmethod
    def of(points: np.ndarray, time: np.ndarray) -> _Motion | None:
        """None where feet hardly move, or are hardly known."""
        velocity = velocities(points, time)
        speed = np.linalg.norm(velocity, axis=3)
        known = np.isfinite(speed) & np.isfinite(points).all(axis=3)
        velocity = np.where(known[..., None], velocity, np.nan)
        moves = (np.where(known, speed, 0.0).max(axis=(1, 2)) >= _STILL) & known.any(axis=2).all(axis=1)
        lasts = float(np.gradient(time)[moves].sum())
        if moves.sum() < _FRAMES or lasts < _SECONDS:
            return None
        return _Motion(time[moves], points[moves], velocity[moves])

    def moved_with(self, velocity: np.ndarray) -> np.ndarray:
        """Share (2,) of the frames in which each foot has a velocity (3,), each as much as it has."""
        return np.asarray(np.exp(-0.5 * np.square(self._apart(velocity)[0] / _WIDTH)).mean(axis=0))

    def common_velocity(self) -> np.ndarray:
        """The velocity (3,) that both feet have for longest."""
        known = self.velocity[np.isfinite(self.velocity).all(axis=3)]
        some = self._replace(velocity=self.velocity[:: -(-len(self.velocity) // _MOST)])
        candidates = known[:: -(-len(known) // _MOST)]
        best = candidates[np.argmax([some.moved_with(each).min() for each in candidates])]
        for _ in range(_ROUNDS):
            off, nearest = self._apart(best)
            weight = np.exp(-0.5 * np.square(off / _WIDTH))
            best = (weight[..., None] * nearest).sum(axis=(0, 1)) / weight.sum()
        return np.asarray(best)

    def of_flat_feet(self, near: np.ndarray) -> np.ndarray:
        """The velocity (3,) near another that all points of a foot have, for feet that roll move a little forward; the
        other where feet are hardly ever flat."""
        middle, best = self._of_feet(), near
        for _ in range(_ROUNDS):
            off = np.nanmax(np.linalg.norm(self.velocity - best, axis=3), axis=2)
            weight = np.exp(-0.5 * np.square(off / _WIDTH))
            if weight.mean() < _FLAT:
                return near
            best = (weight[..., None] * middle).sum(axis=(0, 1)) / weight.sum()
        return np.asarray(best) if np.linalg.norm(best - near) <= _WIDTH else near

    def walks_on(self, velocity: np.ndarray, level: np.ndarray, up: np.ndarray) -> bool:
        """Whether feet stand on something with a velocity (3,), swing forward over it, and get nowhere; level (3,): its
        horizontal part."""
        speed = float(np.linalg.norm(level))
        shares = (self._apart(velocity)[0] <= _WITH * (_WIDTH + _SPREAD * speed)).mean(axis=0)
        forward = np.quantile(-self._of_feet() @ level / speed, _QUICK, axis=0)
        return bool(
            shares.min() >= _SHARE
            and shares.sum() >= _BOTH
            and (speed > _CRANKS or forward.min() >= _FORWARD * speed)
            and self._drift(up) <= _DRIFT * speed
        )

    def level_way_back(self, up: np.ndarray) -> np.ndarray | None:
        """The median velocity (3,) of feet that go back near the floor, where they go back and come forward by turns
        while the body gets nowhere, the lower one back; None where they do not."""
        height = np.nanmin(self.places @ up, axis=2)
        level = self._of_feet()
        level = level - (level @ up)[..., None] * up
        lower = (height[:, 1] - height[:, 0]) @ (level[:, 0] - level[:, 1])
        along = level @ (lower / max(float(np.linalg.norm(lower)), _TINY))
        back = along >= _BACK * along.max(axis=0)
        low = back & (height - np.quantile(height, _LOWEST, axis=0) <= _LOW)
        if not back.any(axis=0).all() or np.any(low.sum(axis=0) < _LEVEL * back.sum(axis=0)):
            return None
        velocity = np.asarray(np.median(level[low], axis=0))
        speed = float(np.linalg.norm(velocity))
        both = np.cov(along.T)
        by_turns = both[0, 1] <= _TURNS * np.sqrt(both[0, 0] * both[1, 1])
        return velocity if by_turns and speed >= _SLOWEST and self._drift(up) <= _DRIFT * speed else None

    def _apart(self, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (T, 2) [m/s] from a velocity (3,) of the nearest point of each foot, and its velocity (T, 2, 3)."""
        off = np.linalg.norm(self.velocity - velocity, axis=3)
        off = np.where(np.isfinite(off), off, np.inf)
        nearest = off.argmin(axis=2)[..., None]
        own = np.take_along_axis(self.velocity, nearest[..., None], axis=2)[:, :, 0]
        return np.take_along_axis(off, nearest, axis=2)[..., 0], own

    def _of_feet(self) -> np.ndarray:
        """Velocities (T, 2, 3) of the middles of the known points of each foot."""
        return np.asarray(np.nanmean(self.velocity, axis=2))

    def _drift(self, up: np.ndarray) -> float:
        """[m/s] of the middle between both feet along the floor, the straight line through its places."""
        middle = np.nanmean(self.places, axis=2).mean(axis=1)
        middle -= (middle @ up)[:, None] * up
        since = self.time - self.time.mean()
        return float(np.linalg.norm(since @ middle / (since @ since)))


def speeds_over_time(velocity: np.ndarray, time: np.ndarray, steady: np.ndarray) -> np.ndarray:
    """Speeds (T,) [m/s] of a belt along its steady velocity (3,), the steady speed in all frames unless another lasts.

    velocity (T, 2, K, 3) [m/s]: of points of both feet, NaN where missing, at times (T,) [s].
    """
    speed = float(np.linalg.norm(steady))
    levels = np.linspace(0.0, _MOST_SPEEDS, _COUNT) * speed
    gaps = np.diff(time)
    weight = np.minimum(1.0, np.gradient(time) / _CORRELATION)
    log = weight[:, None] * np.log(_OTHERWISE + _support(velocity, levels[:, None] * (steady / speed)))
    path = levels[_likeliest_path(log, levels / (_ACCELERATION * speed), gaps)]
    changed = np.abs(path - speed) > max(_CHANGE, _SPEED_SHARE * speed)
    if all(time[end - 1] - time[first] < _LASTS for first, end in stretches(changed)):
        return np.full(len(time), speed)
    return _smoothed(path, time)


def _support(velocity: np.ndarray, belts: np.ndarray) -> np.ndarray:
    """Support (T, S) of each belt (S, 3) by the feet, the mean of both feet's best points."""
    apart = np.stack([np.linalg.norm(velocity - belt, axis=3) for belt in belts], axis=1)
    nearest = np.where(np.isfinite(apart), apart, np.inf).min(axis=3)
    return np.asarray(np.exp(-0.5 * np.square(nearest / _SPEED_WIDTH)).mean(axis=2))


def _likeliest_path(log: np.ndarray, levels: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Numbers (T,) of levels (S,) that change by one in a second, by log likelihoods (T, S) of frames `gaps` (T - 1,)
    [s] apart."""
    steps = 0.5 * np.square(levels[:, None] - levels)
    best, before = log[0], np.zeros(log.shape, dtype=int)
    for t, gap in enumerate(gaps, start=1):
        reached = best[:, None] - steps / gap
        before[t] = reached.argmax(axis=0)
        best = reached.max(axis=0) + log[t]
    path = np.zeros(len(log), dtype=int)
    path[-1] = best.argmax()
    for t in range(len(log) - 1, 0, -1):
        path[t - 1] = before[t, path[t]]
    return path


def _smoothed(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Means (T,) over the frames about each."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    first = np.searchsorted(time, time - _SMOOTH)
    end = np.searchsorted(time, time + _SMOOTH, side="right")
    return np.asarray((total[end] - total[first]) / (end - first))
