"""Start times of several cameras, from their keypoints' rays and speeds.

At the right clocks rays of one point meet, and what is fast in one camera is fast in the others. The first is Sampson's
distance (Hartley and Zisserman, Multiple View Geometry, 2nd edition, 11.4.3), weighted by how fast both points are,
because what does not move contains no information on a clock. The second is the correlation of the logarithms of the
speeds, which hardly depends on where a camera stands. They are the negative log-likelihoods of an observation whose
error has heavy tails, and of one that is normal, each with its variance at its best; they add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.clock_rates import ClockRates, Lags, clock_rates
from estimator.data.moving_rays import PairCourse, pair_courses

LONGEST = 10.0  # largest offset searched for [s]
_FINEST = 1.0 / 120.0  # instants are not closer than this [s]
_MOST = 300  # instants of a pair that are compared at every lag, and
_MOST_AT_THE_END = 1200  # near the best one
_PARTS = 4  # a step between instants is divided so finely at the end
_NEAR = 3  # steps around the best lag in which the end is searched for
_SHORTEST = 0.15  # time that two cameras must have in common at a lag [s]
_TRUSTED = 0.5  # time in common at which a lag's evidence counts half [s]
PEAK = 0.15  # other clocks are those that are further off [s]
_BLOCKS = 8  # parts of the clip, and of the body, that are left out in turn
_INDEPENDENT = 30.0  # observations in a second whose errors have nothing to do with each other

# What is relied on, as benchmarks/accuracy/synchronisation.py measures it:
SURE_MARGIN = 0.5  # a pair's clocks are better than all others by this
SURE_DISTANCE = 0.02  # of the picture's longer side: its rays are not further from each other
SURE_ERROR = 0.5  # frames of the slowest camera: standard error


@dataclass(frozen=True)
class Synchrony:
    """Clocks of C cameras.

    offsets (C,): seconds to add to the times that each was given; NaN where undetermined. sure (C,): whether they are
    reliable. errors (C,): standard errors [s], from leaving out parts of the clip in turn. margin (C,): how much better
    they are than any other clock: the logarithm of the ratio of squared distances, of the weakest link between a camera
    and those that are held. distance: how far the moving rays of a pair pass each other at these clocks [px], the
    geometric mean. rates: of each clock; offsets are of times scaled by them about each camera's first. None where no
    person was seen.
    """

    offsets: np.ndarray
    sure: np.ndarray
    errors: np.ndarray
    margin: np.ndarray
    distance: float
    rates: ClockRates | None = None


def synchronised(
    cameras: Sequence[Camera], pixels: Sequence[np.ndarray], times: Sequence[np.ndarray], held: Sequence[int] = (0,)
) -> Synchrony:
    """When each camera's clock began, up to 10 s from the times given, and its rate where that differs.

    pixels (C): of each camera (N, L, 2) [px], NaN where missing, the same landmarks in all. times (C): of its frames
    (N,) [s], rising. held: cameras whose times are right as they are, at least one.

    Nothing is sure without movement, where two moments are similar, where cameras have too little in common, or where
    parts of the clip give different offsets that no single rate explains.
    """
    rates = clock_rates(cameras, pixels, times, held, LONGEST)
    scaled = times
    if rates.differ:
        scaled = [of[:1] + scale * (of - of[:1]) for of, scale in zip(times, rates.scales, strict=True)]
    result = _at_rates(cameras, pixels, scaled, held)
    first = np.array([of[0] if len(of) else np.nan for of in times]) + result.offsets
    elsewhere = (rates.scales != 1.0) & (np.abs(first - rates.first) > PEAK)
    return replace(result, sure=result.sure & ~rates.doubtful & ~elsewhere, rates=rates)


def _at_rates(
    cameras: Sequence[Camera], pixels: Sequence[np.ndarray], times: Sequence[np.ndarray], held: Sequence[int]
) -> Synchrony:  # fmt: skip
    """When clocks of these rates began."""
    steps = [float(np.median(np.diff(of))) if len(of) > 1 else np.inf for of in times]
    step = max(_FINEST, min(steps))
    if not np.isfinite(step):
        return _nothing(len(cameras), held)
    courses = pair_courses(cameras, pixels, times, step)
    coarse = _coarse(courses)
    if coarse is None:
        return _nothing(len(cameras), held)
    lags = coarse.lags.best(len(cameras), held)
    nearer = [of - step * lag for of, lag in zip(times, lags.tolist(), strict=True)]
    more, errors = _refined(pair_courses(cameras, pixels, nearer, step / _PARTS), len(cameras), held)
    margins, distances = coarse.assess(lags)
    far = distances > SURE_DISTANCE * max(max(camera.image_size) for camera in cameras)
    margin = _weakest_links(coarse.lags, np.where(far, 0.0, margins), len(cameras), held)
    limit = SURE_ERROR * max(of for of in steps if np.isfinite(of))
    sure = (margin >= SURE_MARGIN) & (errors * step <= limit)
    sure[list(held)] = True
    offsets = -step * (lags + more)
    return Synchrony(offsets + 0.0, sure, errors * step, margin, float(np.exp(np.mean(np.log(distances)))))


def _nothing(count: int, held: Sequence[int]) -> Synchrony:
    """Result where no two cameras see a person move at any clocks."""
    known = np.isin(np.arange(count), list(held))
    nan = np.where(known, 0.0, np.nan)
    return Synchrony(nan, known, np.where(known, 0.0, np.inf), np.where(known, np.inf, 0.0), float("nan"))


@dataclass(frozen=True)
class _Coarse:
    """All lags of all pairs by whole steps [s]. lags: with the share of each that is believed. rays (P, 2 most + 1):
    logarithms of the squared distances [px], NaN where there is too little in common."""

    lags: Lags
    rays: np.ndarray
    step: float

    def assess(self, lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margin of each pair (P,) at these lags (C,) over all lags further off, 0 where they are not better, and the
        distance [px]."""
        margins, distances = np.zeros(len(self.rays)), np.full(len(self.rays), np.inf)
        apart = np.clip(lags[self.lags.b] - lags[self.lags.a], -self.lags.most, self.lags.most) + self.lags.most
        places = np.arange(self.rays.shape[1])
        for p, at in enumerate(apart.tolist()):
            near, other = np.abs(places - at) <= 2, np.abs(places - at) * self.step > PEAK
            if np.isfinite(self.rays[p, at]) and np.isfinite(self.rays[p, other]).any():
                table = self.lags.table[p]
                margins[p] = max(0.0, float(table[other].min() - table[near].min()))
                distances[p] = float(np.exp(0.5 * self.rays[p, at]))
        return margins, distances


def _coarse(courses: Sequence[PairCourse]) -> _Coarse | None:
    """All lags of the pairs that overlap at some; None without any."""
    if not courses:
        return None
    step = courses[0].step
    most = min(round(LONGEST / step), courses[0].count - 1)
    stride = max(1, courses[0].count // _MOST)
    a, b, tables, rays = [], [], [], []
    for course in courses:
        values = np.array([_at_lag(course, lag, stride) for lag in range(-most, most + 1)])
        total = values[:, 0] + values[:, 1]
        if np.isfinite(total).any():
            usual = float(np.nanmedian(total))
            believed = values[:, 2] / (values[:, 2] + _TRUSTED)
            tables.append(np.where(np.isfinite(total), usual + believed * (total - usual), usual))
            rays.append(values[:, 0])
            a.append(course.pair.a)
            b.append(course.pair.b)
    return _Coarse(Lags(np.array(a), np.array(b), np.array(tables), most), np.array(rays), step) if a else None


def _at_lag(course: PairCourse, lag: int, stride: int) -> tuple[float, float, float]:
    """Misfit of rays and speeds at a lag, and the time in common [s]."""
    i = course.instants(lag, stride)
    sums, weights = course.rays(lag, i)
    seen = weights > 0.0
    common = float(seen.any(axis=1).sum()) * stride * course.step
    if common < _SHORTEST:
        return np.nan, np.nan, common
    return float(sums.sum() / weights.sum()), course.speeds(lag, i, seen), common


def _refined(courses: Sequence[PairCourse], count: int, held: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Lags (C,) near 0 at which rays meet best, in steps before these were divided, and their standard errors.

    The errors are the largest of three: from the lags without each part of the clip, and without each part of the body
    (the jackknife, Efron 1982), and from how sharp the least distance is. A detector's error of a joint lasts for long,
    so that in short clips the first is too small.
    """
    by_time, by_joint = _parts_of_sums(courses)
    pairs = np.array([(course.pair.a, course.pair.b) for course in courses])
    lags = _best(by_time.sum(axis=0), pairs, count, held)
    errors = [_blunt(by_time.sum(axis=0), courses, lags)]
    for parts in (by_time, by_joint):
        without = np.array([_best(parts.sum(axis=0) - part, pairs, count, held) for part in parts])
        spread = np.square(without - without.mean(axis=0)).sum(axis=0)
        errors.append(np.sqrt((len(parts) - 1) / len(parts) * spread) / _PARTS)
    return lags / _PARTS, np.max(errors, axis=0)


def _best(sums: np.ndarray, pairs: np.ndarray, count: int, held: Sequence[int]) -> np.ndarray:
    """Lags (C,) in divided steps, from sums (P, 2, lags)."""
    usable = (sums[:, 1] > 0.0).all(axis=1)
    if not usable.any():
        return np.zeros(count, dtype=np.int64)
    table = sums[usable, 0] / sums[usable, 1]
    return Lags(pairs[usable, 0], pairs[usable, 1], table, _NEAR * _PARTS).best(count, held)


def _blunt(sums: np.ndarray, courses: Sequence[PairCourse], lags: np.ndarray) -> np.ndarray:
    """Standard errors (C,), in steps, of an estimate with this curvature of the log-likelihood of one observation."""
    information = np.zeros(len(lags))
    for course, (above, below) in zip(courses, sums, strict=True):
        begin, end = _in_common(course)
        if (below > 0.0).all():
            table, away = above / below, 2 * _PARTS
            at = int(np.clip(lags[course.pair.b] - lags[course.pair.a] + _NEAR * _PARTS, away, len(table) - 1 - away))
            rise = max(0.0, float(min(table[at - away], table[at + away]) - table[at]))
            observations = _INDEPENDENT * (end - begin) * course.step
            information[[course.pair.a, course.pair.b]] += observations * 0.5 * rise
    return np.asarray(1.0 / np.sqrt(np.maximum(information, 1e-12)))


def _parts_of_sums(courses: Sequence[PairCourse]) -> tuple[np.ndarray, np.ndarray]:
    """Sums that distances are weighted means of, (parts, P, 2, lags): of the parts of the time that a pair has in
    common, and of the parts of the body."""
    most = _NEAR * _PARTS
    stride = max(1, courses[0].count // _MOST_AT_THE_END)
    by_time = np.zeros((_BLOCKS, len(courses), 2, 2 * most + 1))
    by_joint = np.zeros_like(by_time)
    for p, course in enumerate(courses):
        begin, end = _in_common(course)
        for lag in range(-most, most + 1):
            i = course.instants(lag, stride)
            block = np.clip((i - begin) * _BLOCKS // (end - begin), 0, _BLOCKS - 1)
            for k, values in enumerate(course.rays(lag, i)):
                joint = np.arange(values.shape[1]) * _BLOCKS // values.shape[1]
                by_time[:, p, k, lag + most] = np.bincount(block, values.sum(axis=1), _BLOCKS)
                by_joint[:, p, k, lag + most] = np.bincount(joint, values.sum(axis=0), _BLOCKS)
    return by_time, by_joint


def _in_common(course: PairCourse) -> tuple[int, int]:
    """The first instant at which both cameras of a pair see something move, and the one after the last."""
    i = course.instants(0, 1)
    both = np.flatnonzero(course.rays(0, i)[1].any(axis=1))
    return (int(both[0]), int(both[-1]) + 1) if len(both) else (0, 1)


def _weakest_links(lags: Lags, margins: np.ndarray, count: int, held: Sequence[int]) -> np.ndarray:
    """For each camera (C,) the smallest margin on the best chain of pairs to a camera that is held."""
    strength = np.zeros(count)
    strength[list(held)] = np.inf
    for _ in range(count):
        for a, b, margin in zip(lags.a.tolist(), lags.b.tolist(), margins.tolist(), strict=True):
            for here, there in ((a, b), (b, a)):
                strength[there] = max(strength[there], min(strength[here], margin))
    return strength
