"""Which points of the feet stand, and whether hips rest on something: keypoints that rest in the pictures, as cameras
stand still themselves."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from estimator.data.observation import Observation, image_extent

SPAN = 0.15  # s, over which the speed of a foot's keypoint is measured
HIP_SPAN = 0.5  # s, for which hips have not moved that rest on something: at the bottom of a squat they turn sooner
FEWEST = 3  # frames in `SPAN`
_FOOT, _ANKLE = ("heel", "toe"), "ankle"
_BODY = 0.45  # m: root mean square distance of an adult's keypoints from their centre
_SLIP, _SPEED = (
    0.05,
    1.0,
)  # m/s: standard deviations of the speeds of standing points, due to detectors, and of moving ones
_LOW, _RAISED = 0.1, 0.5  # m: standard deviations of how high feet are in a picture above the lowest, alike
_STILL, _WANDERS = 0.01, 0.1  # m: standard deviations of where hips are within `HIP_SPAN`, at rest and not
_LOW_HIPS = 0.5  # of the shank in the picture: hips that are less above the knees are low
_NOISE = 0.5  # px, of a keypoint at least
_TINY = 1e-9  # s


class StandingPoints:
    """Infers from recent keypoints which points of the feet stand, and whether the hips may rest.

    names (L): of the body's landmarks. Heels and toes are used, or the ankle of a foot of which neither is seen. A
    point's speed in a picture is the slope of its last `SPAN` seconds, in sizes of the person; that it stands is
    inferred from two normal densities of the speed, for standing and for moving points, and two of its height in the
    picture above the lowest of them, with even odds beforehand. Cameras count as independent, and are held upright.
    What moves towards a camera seems to stand to that one. Hips may rest on a seat where they are about as low as the
    knees in the pictures and have stayed where they are for `HIP_SPAN`, inferred in the same way from how far they
    wander.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._feet = np.array([name.endswith(_FOOT) for name in names], bool)
        ankles = [i for i, name in enumerate(names) if name.endswith(_ANKLE)]
        # the points of the foot that an ankle stands in for
        self._of_ankle = [(i, self._feet & _side(names, names[i][: -len(_ANKLE)])) for i in ankles]
        self._legs = [[i for i, name in enumerate(names) if name.endswith(part)] for part in ("hip", "knee", _ANKLE)]
        self._before: deque[tuple[float, np.ndarray]] = deque()

    def with_rest(self, observation: Observation) -> Observation:
        """The same with what rests; `observation` follows those that were added."""
        return replace(observation, standing=self.standing(observation), seated=self.seated(observation))

    def standing(self, observation: Observation) -> np.ndarray:
        """Probability (L,) that each landmark has not moved in the last moments, 0 for those that are not of feet or
        not seen; `observation` follows those that were added."""
        first = observation.time - SPAN - _TINY
        some = [*((t, x) for t, x in self._before if t >= first), (observation.time, observation.known_pixels)]
        result = np.zeros(len(self._feet))
        if len(some) < FEWEST or not len(result):
            return result
        times, pixels = np.array([t for t, _ in some]), np.stack([x for _, x in some])
        index = np.flatnonzero(self._observed(pixels[-1]))
        log_odds, seen = np.zeros(len(index)), np.zeros(len(index), bool)
        for c in range(pixels.shape[1]):
            metres = _BODY / image_extent(pixels[-1, c], np.isfinite(pixels[-1, c]).all(axis=1))
            noise = max(_NOISE, observation.jitter[c] if observation.jitter else 0.0)
            own = _of_speed(times, pixels[:, c, index], metres, noise) + _of_height(pixels[-1, c, index], metres)
            known = np.isfinite(own)
            log_odds[known] += own[known]
            seen |= known
        result[index[seen]] = expit(log_odds[seen])
        return result

    def seated(self, observation: Observation) -> float:
        """Probability that the hips rest on something, 0 where hips, knees or ankles are not seen, or not for long
        enough."""
        first = observation.time - HIP_SPAN - _TINY
        some = [*((t, x) for t, x in self._before if t >= first), (observation.time, observation.known_pixels)]
        if some[-1][0] - some[0][0] < 0.8 * HIP_SPAN or not all(self._legs):
            return 0.0
        pixels, log_odds = np.stack([x for _, x in some]), []
        for c in range(pixels.shape[1]):
            hip, knee, ankle = (pixels[-1, c, part].mean(axis=0) for part in self._legs)
            if not np.isfinite([hip, knee, ankle]).all():
                continue
            if knee[1] - hip[1] > _LOW_HIPS * np.linalg.norm(ankle - knee):
                return 0.0
            metres = _BODY / image_extent(pixels[-1, c], np.isfinite(pixels[-1, c]).all(axis=1))
            hips = pixels[:, c, self._legs[0]].mean(axis=1)
            wander = metres * float(np.sqrt(np.nanvar(hips, axis=0).sum()))
            noise = metres * max(_NOISE, observation.jitter[c] if observation.jitter else 0.0)
            log_odds.append(_log_odds(np.array(wander), np.hypot(noise, _STILL), _WANDERS, 2))
        return float(expit(np.sum(log_odds))) if log_odds else 0.0

    def add(self, observation: Observation) -> None:
        """Go on to the next frame."""
        self._before.append((observation.time, observation.known_pixels))
        while self._before[0][0] < observation.time - HIP_SPAN - _TINY:
            self._before.popleft()

    def _observed(self, pixels: np.ndarray) -> np.ndarray:
        """Which landmarks (L,); pixels (C, L, 2)."""
        seen = np.isfinite(pixels).all(axis=2).any(axis=0)
        chosen = self._feet & seen
        for ankle, foot in self._of_ankle:
            chosen[ankle] = seen[ankle] and not (seen & foot).any()
        return chosen


def with_standing(observations: Iterable[Observation], names: Sequence[str]) -> list[Observation]:
    """Observations in order, each with what rests in it; names (L): of the body's landmarks."""
    points, resting = StandingPoints(names), []
    for observation in observations:
        resting.append(points.with_rest(observation))
        points.add(observation)
    return resting


def _side(names: Sequence[str], prefix: str) -> np.ndarray:
    return np.array([name.startswith(prefix) for name in names], bool)


def _of_speed(times: np.ndarray, pixels: np.ndarray, metres: float, noise: float) -> np.ndarray:
    """Log of the odds (F,) that points stand by their speed, in one camera, NaN of those that were missing.

    times (N,) [s], pixels (N, F, 2), metres: of a pixel, noise [px]: of a keypoint.
    """
    away = times - times.mean()
    squares = float(np.square(away).sum())
    speed = metres * np.einsum("n,nfk->fk", away, pixels) / squares
    return _log_odds(np.linalg.norm(speed, axis=1), np.hypot(metres * noise / np.sqrt(squares), _SLIP), _SPEED, 2)


def _of_height(pixels: np.ndarray, metres: float) -> np.ndarray:
    """The same by the heights of points in the picture, pixels (F, 2), above the lowest of them."""
    y = pixels[:, 1]
    lowest = np.nanmax(y) if np.isfinite(y).any() else np.nan
    return _log_odds(metres * (lowest - y), _LOW, _RAISED, 1)


def _log_odds(value: np.ndarray, narrow: float, more: float, axes: int) -> np.ndarray:
    """Log of the ratio of two normal densities over a number of axes, of deviation `narrow` and with `more` in
    addition."""
    stands, moves = narrow**2, narrow**2 + more**2
    return np.asarray(0.5 * np.square(value) * (1.0 / moves - 1.0 / stands) + 0.5 * axes * np.log(moves / stands))
