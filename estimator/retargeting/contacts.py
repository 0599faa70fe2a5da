"""Which feet of a motion that is followed stand, when, and on what floor: found, or from a csv that `kinemode contact
--out` writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.data.formats.number_table import TIMES, read_number_table
from estimator.inference.contacts import stances_of, standing_probability
from estimator.inference.ground import STEP, Ground, fitted_ground
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.stances import SIDES_PARTS
from humanoid.subject.landmarks import without_side
from humanoid.support.errors import InputError

_UP = np.array([0.0, 0.0, 1.0])
_SOLE = {"heel": ("heel", "ankle"), "big_toe": ("big_toe", "small_toe")}  # part of a sole: landmarks that locate it
_ABOVE = {"heel": 0.02, "ankle": 0.07, "big_toe": 0.02, "small_toe": 0.02}  # m: expected above the floor, standing
_SIDES = ("left", "right")
_LEVEL = 1e-5  # rad: how far the floor may be from level
_LOW = 0.03  # m: of a single frame, what is so little above its lowest point of the feet stands
_SURE = 0.5
_SLOW = 0.35  # m/s: what is faster is landing, leaving or shuffling, not held by the floor
_SPREAD = 0.06  # m: of the places of a stance, in which ankles roll over feet; what moves farther has made a step
_FEWEST = 2  # frames of a stance
_LOWEST = 20.0  # percentile of the frames, of feet that never stand
_ROUNDS = 3
_PARTS = ("hip", "knee", "shoulder", "elbow", "wrist")
_THIGH = 0.42  # m: of the adult whose lengths the others are
_HIPS = 0.05  # m: above a floor; hips of a person sitting or lying on it are higher
_BELOW = 0.1  # m: under a floor, what is lower is not on it, whatever the noise
_SEVERAL = 3  # joints that far below
_MANY = 0.25  # share of the frames


@dataclass(frozen=True)
class SourceContacts:
    """Contacts of the feet.

    names (P): points of the soles, left_heel and left_big_toe, then those of the right foot, as far as they are given.
    landmarks (P): those of the motion that locate each, as left_ankle of left_heel where the motion has no heels.
    standing (T, P) bool. floor [m]: height of the level floor, None without feet, or where the body lies lower. above
    (P,) [m]: how high each landmark is above the floor while it stands. note: what is worth knowing; empty
    where nothing is.
    """

    names: tuple[str, ...]
    landmarks: tuple[str, ...]
    standing: np.ndarray
    floor: float | None
    above: np.ndarray
    note: str = ""


def source_contacts(source: SourceMotion, floor: float | None = None, *, feet_alone: bool = False) -> SourceContacts:
    """Told by how fast points of the feet are and how high above a level floor, which is found with them: see
    `estimator.inference.contacts`.

    Heels, or ankles where there are none, and toes stand independently; all may be in the air. What is faster
    than 0.35 m/s, or over 6 cm above the floor, as a raised foot, does not stand, and a stance whose places are spread
    over more than 6 cm is parted where it is fastest: small steps are steps, as what follows is to hold a foot that
    stands. A motion without feet has no contacts and no floor; of a single frame the lowest points stand. Where
    nothing stands the floor is under the lowest feet. One that the body lies under, as where feet rest on a chair, is
    none: that of lower feet is taken, if there is one. floor
    [m]: its height, where it is known. feet_alone: whatever the rest of the body does.
    """
    told = {
        f"{side}_{part}": name
        for side in _SIDES
        for part, options in _SOLE.items()
        if (name := next((n for o in options if (n := f"{side}_{o}") in source.names), None)) is not None
    }
    landmarks = tuple(told.values())
    points = source.points[:, [source.names.index(name) for name in landmarks]]
    known = np.isfinite(points).all(axis=2)
    frames = len(source.times)
    if not known.any():
        note = f"{source.source} has no feet: contacts and floor are off"
        return SourceContacts((), (), np.zeros((frames, 0), dtype=bool), None, np.zeros(0), note)
    parts = [without_side(name) for name in landmarks]
    kinds = sorted(set(parts))
    kind = np.array([kinds.index(part) for part in parts])
    expected = np.array([_ABOVE[name] for name in kinds])
    standing, stood_on = _standing(points, source.times, kind, expected, floor)
    ground = stood_on or _under_lowest(points, kind, expected)
    where = "found where feet stand" if stood_on else "under the lowest feet, as none stands"
    note = "" if floor is not None else f"{source.source}: floor at {ground.height:.3f} m, {where}"
    if floor is None and not feet_alone and lies_below(source, ground.height):
        raised = ground.height
        standing, lower = _standing_lower(points, source, kind, expected, raised)
        if lower is None:
            why = (
                f"feet are at {raised:.2f} m and the body lies lower: they are on no floor, and nothing is held on one"
            )
            return SourceContacts(tuple(told), landmarks, standing, None, expected[kind], f"{source.source}: {why}")
        ground, note = lower, f"{source.source}: floor at {lower.height:.3f} m, found where lower feet stand"
    standing &= known.any(axis=0)
    return SourceContacts(tuple(told), landmarks, standing, ground.height, ground.above[kind], note)


def _under_lowest(points: np.ndarray, kind: np.ndarray, expected: np.ndarray) -> Ground:
    """A level floor under most of the lowest places of feet (T, P, 3) that never stand."""
    heights = points[..., 2] - expected[kind]
    lowest = np.nanmin(heights[np.isfinite(heights).any(axis=1)], axis=1)
    return Ground(_UP, float(np.percentile(lowest, _LOWEST)), 0.0, expected)


def _standing_lower(
    points: np.ndarray, source: SourceMotion, kind: np.ndarray, expected: np.ndarray, rejected: float
) -> tuple[np.ndarray, Ground | None]:
    """The same as `_standing` of the feet that are under a height [m] that they rest at and the body lies below."""
    height = points[..., 2:] - expected[kind][:, None]
    lower = np.where(height < rejected - STEP, points, np.nan)
    if np.isfinite(lower).all(axis=2).any():
        _, ground = _standing(lower, source.times, kind, expected, None)
        if ground is not None and not lies_below(source, ground.height):
            standing, _ = _standing(points, source.times, kind, expected, ground.height)
            return standing, ground
    return np.zeros(points.shape[:2], dtype=bool), None


def _standing(
    points: np.ndarray, times: np.ndarray, kind: np.ndarray, expected: np.ndarray, floor: float | None
) -> tuple[np.ndarray, Ground | None]:
    """Whether points (T, P, 3) of kinds (P,) stand, (T, P) bool, and the level floor; None where nothing stands."""
    if floor is not None:
        ground = Ground(_UP, floor, 0.0, expected)
        heights = ground.heights(points, kind)
        probability = standing_probability(points, times, heights) if len(times) > 1 else (heights < _LOW) * 1.0
        return _held(np.where(heights < STEP, probability, 0.0), points, times), ground
    if len(times) == 1:
        heights = points[..., 2] - expected[kind]
        lowest = float(np.nanmin(heights))
        return heights < lowest + _LOW, Ground(_UP, lowest, 0.0, expected)
    probability = standing_probability(points, times)
    level: Ground | None = None
    heights = np.zeros(points.shape[:2])
    for _ in range(_ROUNDS):
        tilted = fitted_ground(points, probability, kind, _UP, above=expected, tilt=_LEVEL)
        if tilted is None:
            return _held(probability, points, times), None
        level = Ground(_UP, tilted.height, tilted.std, tilted.above)
        heights = level.heights(points, kind)
        probability = standing_probability(points, times, heights)
    return _held(np.where(heights < STEP, probability, 0.0), points, times), level


def _held(probability: np.ndarray, points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Whether points (T, P, 3) that stand with probabilities (T, P) are held by the floor, (T, P) bool."""
    speed = np.linalg.norm(np.gradient(points, times, axis=0), axis=2)
    held = (probability > _SURE) & ~(speed > _SLOW)  # unknown speeds are not too fast
    for k, first, after in stances_of(held.astype(float)):
        _part_where_it_moves(held[:, k], points[:, k], speed[:, k], first, after)
    for k, first, after in stances_of(held.astype(float)):
        if after - first < _FEWEST:
            held[first:after, k] = False
    return held


def _part_where_it_moves(held: np.ndarray, points: np.ndarray, speed: np.ndarray, first: int, after: int) -> None:
    """Take the steps out of a stance (first to after) of held (T,) bool in place: while its places (T, 3) are spread
    over more than `_SPREAD`, it is parted where its speed (T,) is largest."""
    while after - first > 1:
        span = points[first:after, :2]
        known = np.isfinite(span).all(axis=1)
        if not known.any() or np.linalg.norm(np.ptp(span[known], axis=0)) <= _SPREAD:
            return
        own = np.nan_to_num(speed[first:after])
        fastest = int(np.argmax(own))
        slow = np.flatnonzero(own <= 0.5 * own[fastest])
        begin, end = int(slow[slow < fastest].max(initial=-1)) + 1, int(slow[slow > fastest].min(initial=len(own)))
        held[first + begin : first + end] = False
        _part_where_it_moves(held, points, speed, first, first + begin)
        first += end


def lies_below(source: SourceMotion, floor: float) -> bool:
    """Whether much of a body lies under a level floor [m] in many frames: its hips nearer to it than any that rest on
    one, or several joints of its limbs well below it.

    Hips of a person sitting or lying are 0.08 m above the floor and more; one hand that reaches over an edge is not
    much. The lengths are an adult's, and scaled by the thigh.
    """
    scale = _thigh(source) / _THIGH
    joints = _heights(source, [f"{side}_{part}" for side in _SIDES for part in _PARTS])
    hips = _heights(source, [f"{side}_hip" for side in _SIDES]).mean(axis=1)
    known = np.isfinite(joints).any(axis=1)
    if not known.any():
        return False
    low = (hips < floor + _HIPS * scale) | ((joints < floor - _BELOW * scale).sum(axis=1) >= _SEVERAL)
    return bool(low[known].mean() > _MANY)


def _heights(source: SourceMotion, names: list[str]) -> np.ndarray:
    """Heights of landmarks (T, L) [m], NaN where missing; those that the motion lacks are left out."""
    places = [source.names.index(name) for name in names if name in source.names]
    return source.points[:, places, 2] if places else np.full((len(source.times), 1), np.nan)


def _thigh(source: SourceMotion) -> float:
    """Length of a thigh [m] in the middle of all frames; an adult's where it is not known."""
    lengths = [
        np.linalg.norm(source.landmark(f"{side}_hip") - source.landmark(f"{side}_knee"), axis=1)
        for side in _SIDES
        if {f"{side}_hip", f"{side}_knee"} <= set(source.names)
    ]
    known = np.concatenate([length[np.isfinite(length)] for length in lengths]) if lengths else np.zeros(0)
    return float(np.median(known)) if len(known) else _THIGH


_STANDS, _SECONDS = " stands", "time [s]"
_GIVEN = 0.5


def load_standing(path: str | Path, source: SourceMotion) -> dict[str, np.ndarray]:
    """Whether each point of the soles stands (T,) bool, by its name, at a source's frames: as in the file's row that is
    nearest in time.

    The file has a column of times [s] and one or more as "left_heel stands", or "left_heel", of probabilities or 0 and
    1.

    Raises
    ------
    InputError: it cannot be read, has no such columns, or ends before the source does.
    """
    path = Path(path)
    table = read_number_table(path)
    table.check()
    time = next((name for name in table.names if name in (_SECONDS, *TIMES)), None)
    columns = {name.removesuffix(_STANDS): k for k, name in enumerate(table.names)}
    known = [name for name in SIDES_PARTS if name in columns]
    if time is None or not known or not table.rows:
        remedy = f"a column {_SECONDS} and some of {', '.join(SIDES_PARTS)}"
        raise InputError(path, "has no contacts", place=table.place, remedy=remedy)
    values, at = table.values, table.values[:, table.names.index(time)]
    if not (np.diff(at) > 0.0).all() or at[0] > source.times[0] + _GIVEN or at[-1] < source.times[-1] - _GIVEN:
        problem = f"its times go from {at[0]:g} to {at[-1]:g} s, the source's from {source.times[0]:g}"
        raise InputError(path, f"{problem} to {source.times[-1]:g}", remedy="contacts of the same motion, in order")
    nearest = np.abs(source.times[:, None] - at).argmin(axis=1)
    return {name: values[nearest, columns[name]] > _GIVEN for name in known}


def with_standing(contacts: SourceContacts, given: Mapping[str, np.ndarray]) -> SourceContacts:
    """Contacts with what a user knows of some points in place of what was found."""
    standing = contacts.standing.copy()
    for k, name in enumerate(contacts.names):
        if name in given:
            standing[:, k] = given[name]
    return replace(contacts, standing=standing)
