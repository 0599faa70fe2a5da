"""Values that were not measured: places that repeat to the last digit while everything else moves, and rest poses.

Programs fill a gap with the last place that was known, and a film that was copied to another rate has pictures twice.
What truly rests comes to rest and leaves it smoothly, or jitters by measurement noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.observation import image_extent
from estimator.data.sequence import GIVEN
from estimator.numerics.stretches import stretches
from humanoid.support.errors import first_of

_FEWEST = 4  # fewest repeated points of a frame that count as a repeated frame
_LEAST = 3  # frames of a place that was filled in; two alike may be chance where places are whole pixels
_ABRUPT = 1.0
"""Extents of the body a second (root mean square distance of its points from their middle, some 0.5 m) from which a
point stops dead or leaps."""
_RARE = 0.01  # share of steps of size zero
_FAR = 0.02  # extents: of the leap itself, 1 cm of a person
_FASTEST = 25.0  # extents a second, 12 m/s: the fastest sprinter
_FIRST = 3  # frames before the motion, at most
_STUCK = 10  # frames of a point that never moves
_FEW = 0.25  # of the points, that never move while others are measured
_LISTED = 6  # names in a note


def repeated_frames(places: np.ndarray) -> np.ndarray:
    """Which frames (T,) have all places (T, N, D) of the frame before, and are followed or preceded by motion.

    NaN where missing; frames of fewer than four places are never called repeated.
    """
    known = np.isfinite(places).all(axis=2)
    both = known[1:] & known[:-1]
    same = (places[1:] == places[:-1]).all(axis=2) & both
    equal = (known[1:] == known[:-1]).all(axis=1) & (same == both).all(axis=1) & (both.sum(axis=1) >= _FEWEST)
    moving = (both & ~same).sum(axis=1) > 0.5 * np.maximum(both.sum(axis=1), 1)
    repeated = np.zeros(len(places), dtype=bool)
    for first, after in stretches(equal):
        around = (*moving[max(0, first - 1) : first], *moving[after : after + 1])
        moves_on = _goes_on(places, first, after) or _is_cut(places, first, after)
        repeated[first + 1 : after + 1] = len(around) > 0 and all(around) and moves_on
    return repeated


def _goes_on(places: np.ndarray, first: int, after: int) -> bool:
    """Whether places (T, N, D) that are the same from frame `first` to `after` move on afterwards as before, or the
    clip begins or ends there: turning round also passes one place twice."""
    if first == 0 or after + 1 >= len(places):
        return True
    before, behind = places[first] - places[first - 1], places[after + 1] - places[after]
    return bool(np.nansum(before * behind) > 0.0)


def _is_cut(places: np.ndarray, first: int, after: int) -> bool:
    """Whether places (T, N, D) that are the same in three frames or more, from `first` to `after`, stop and leave at
    full speed: a person coming to rest is slower just before and just afterwards than one frame away."""
    if after - first < _LEAST - 1:
        return False
    step = np.linalg.norm(np.diff(places, axis=0), axis=2)
    beside, away = (_typical(step, frames) for frames in ((first - 1, after), (first - 2, after + 1)))
    known = np.isfinite(beside).any() and np.isfinite(away).any()
    return bool(known and np.nanmean(beside) > 0.5 * np.nanmean(away))


def _typical(step: np.ndarray, frames: tuple[int, int]) -> list[float]:
    """The median of steps (T, N) at some frames, NaN at those that are missing or have too few."""
    known = [step[t][np.isfinite(step[t])] if 0 <= t < len(step) else step[:0, 0] for t in frames]
    return [float(np.median(own)) if len(own) >= _FEWEST else float("nan") for own in known]


def filled_places(places: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Which places (T, N, D) at times (T,) [s] were filled in rather than measured (T, N): the same to the last digit
    in three frames or more, while most others move, until the point jumps, farther than it moves afterwards: a point
    that starts moving speeds up. Where hardly any other place repeats, as in whole pixels and in exact stances many do,
    a point that stops dead was not measured either. The first place of such a stretch was.
    """
    filled = np.zeros(places.shape[:2], dtype=bool)
    if len(places) < _LEAST:
        return filled
    step = np.linalg.norm(np.diff(places, axis=0), axis=2) / _extent(places)
    still = step == 0.0
    others = (step > 0.0).sum(axis=1) > still.sum(axis=1)
    abrupt = (step > _FAR) & (step > _ABRUPT * np.diff(times)[:, None])
    leap = abrupt[:-1] & ~(step[1:] > 0.5 * step[:-1])
    for k in np.flatnonzero(still.any(axis=0)):
        elsewhere = np.delete(still, k, axis=1).mean() < _RARE
        for first, after in stretches(still[:, k] & others):
            leaves = leap[after : after + 1, k].any()
            stops = elsewhere and (abrupt[max(0, first - 1) : first, k].any() or abrupt[after : after + 1, k].any())
            if after - first + 1 >= _LEAST and (leaves or stops):
                filled[first + 1 : after + 1, k] = True
    return filled


def stuck_points(places: np.ndarray) -> np.ndarray:
    """Which points (N,) of detected places (T, N, D) never move, to the last digit, in all frames that have them, ten
    or more, while hardly any place of the others repeats: detections jitter. At most a quarter of the points; more are
    a person who does not move."""
    step = np.linalg.norm(np.diff(places, axis=0), axis=2)
    known = np.isfinite(step)
    stuck = (known.sum(axis=0) >= _STUCK - 1) & ~(known & (step > 0.0)).any(axis=0)
    others = known & ~stuck
    measured = others.any() and (step[others] == 0.0).mean() < _RARE
    return np.asarray(stuck & measured & (stuck.sum() <= _FEW * known.any(axis=0).sum()))


def frames_elsewhere(places: np.ndarray, times: np.ndarray) -> int:
    """Number of the first frames of places (T, N, D) at times (T,) [s] that are too far away to be reached in time:
    exporters write a rest pose at the origin before the motion. 0 to 3."""
    step = np.linalg.norm(np.diff(places[: _FIRST + 2], axis=0), axis=2)
    known = np.isfinite(step).sum(axis=1) >= _FEWEST
    moved = np.array([np.median(s[np.isfinite(s)]) if k else 0.0 for s, k in zip(step, known, strict=True)])
    leaps = np.flatnonzero(moved > _FASTEST * _extent(places) * np.diff(times[: _FIRST + 2]))
    return int(leaps[-1]) + 1 if len(leaps) and leaps[-1] < _FIRST and len(places) > 2 * _FIRST else 0


def _extent(places: np.ndarray) -> float:
    """Root mean square distance of a frame's points from their middle, the median of the frames."""
    known = np.isfinite(places).all(axis=2)
    extents = [image_extent(*frame) for frame in zip(places, known, strict=True) if np.count_nonzero(frame[1]) >= 2]
    return max(float(np.median(extents)), 1e-12) if extents else 1.0


class Unmeasured(NamedTuple):
    """Entries of places (T, N, D) that were not measured. first: number of frames at the beginning. repeated (T,):
    frames; filled (T, N): places of others."""

    first: int
    repeated: np.ndarray
    filled: np.ndarray

    @staticmethod
    def of(places: np.ndarray, times: np.ndarray) -> Unmeasured:
        """The unmeasured places among places with NaN where missing, at times (T,) [s]."""
        first, repeated = frames_elsewhere(places, times), repeated_frames(places)
        repeated[:first] = False
        left = np.where(repeated[:, None, None], np.nan, places)
        left[:first] = np.nan
        return Unmeasured(first, repeated, filled_places(left, times))

    @property
    def all(self) -> np.ndarray:
        """Which places (T, N) are any of these."""
        every = self.filled | self.repeated[:, None]
        every[: self.first] = True
        return every


def measured_points(
    source: str, names: Sequence[str], points: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Points (T, N, 3) at times (T,) [s], NaN where they were not measured, and notes on what was treated as missing.
    source, names (N): of the file and its points, for the notes."""
    first, repeated, filled = unmeasured = Unmeasured.of(points, times)
    what = "repeat to the last digit while the body moves and are treated as missing"
    listed = first_of([name for name, own in zip(names, filled.T, strict=True) if own.any()], _LISTED)
    notes = (
        (repeated.sum(), f"frames {what}"),
        (filled.sum(), f"places {what}: {listed}"),
        (first, "frames at the beginning are elsewhere, as a rest pose is: treated as missing"),
    )
    own = tuple(f"{source}: {number} {text}" for number, text in notes if number)
    return np.where(unmeasured.all[..., None], np.nan, points), own


def measured_keypoints(track: KeypointTrack, times: np.ndarray) -> KeypointTrack:
    """The keypoints without those that were not measured, with notes on what was treated as missing: at exactly zero,
    in repeated pictures, and filled in. times (N,): of the track's first frames [s]. Of what a person clicked only
    zeros are treated as missing."""
    if not track.names:
        return track
    zero = (track.confidence > 0.0) & (track.pixels == 0.0).all(axis=2)
    left = _without(track, zero, (f"{zero.sum()} keypoints at exactly zero are treated as missing",))
    return left if track.layout == GIVEN else _without_repeats(left, times)


def _without_repeats(track: KeypointTrack, times: np.ndarray) -> KeypointTrack:
    """The keypoints of a detector without those that only repeat others, and without a rest pose before the motion."""
    count = min(len(times), track.frame_count)
    seen = track.confidence > 0.0
    places = np.where(seen[..., None], track.pixels, np.nan)[:count]
    first, repeated, filled = unmeasured = Unmeasured.of(places, times[:count])
    stuck = stuck_points(np.where(unmeasured.all[..., None], np.nan, places))
    wrong = np.zeros_like(seen)
    wrong[:count] = (unmeasured.all | stuck) & seen[:count]
    notes = (
        (first, "frames at the beginning are elsewhere, as a rest pose is, and are treated as missing"),
        (repeated.sum(), "frames that repeat the one before while the person moves are treated as missing"),
        (filled.sum(), "keypoints that repeat to the last digit while the person moves are treated as missing"),
        (stuck.sum(), f"keypoints that never move while others do are treated as missing: {_listed(track, stuck)}"),
    )
    return _without(track, wrong, tuple(f"{number} {text}" for number, text in notes if number))


def _without(track: KeypointTrack, wrong: np.ndarray, notes: tuple[str, ...]) -> KeypointTrack:
    """The track without keypoints wrong (T, N) and with notes on them, unchanged where there are none."""
    if not wrong.any():
        return track
    pixels, confidence = track.pixels.copy(), track.confidence.copy()
    pixels[wrong], confidence[wrong] = np.nan, 0.0
    return replace(track, pixels=pixels, confidence=confidence, notes=(*track.notes, *notes))


def _listed(track: KeypointTrack, chosen: np.ndarray) -> str:
    """The names of some of a track's keypoints, by number where they have none."""
    return first_of([track.names[i] or f"keypoint {i}" for i in np.flatnonzero(chosen)], _LISTED)
