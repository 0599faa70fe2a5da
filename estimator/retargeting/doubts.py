"""Doubts about a retargeted motion: limbs and hips far from the source, leaps of the source,
left and right exchanged.

Of the first 3 s or less of 32 good motions (12 of ASAP, 20 others, nearly all CMU's), each followed by G1 and by Talos,
62 have limbs 5 to 7 degrees off in the middle of all frames and 59 at most, where a joint's limits keep a trunk or a
leg from more, and hips 0.20 m at most, 0.3 of a leg. The other two, Talos frame by frame, lost the source though nearly
all frames kept to limits and floor: limbs were 80 and 125 degrees off, hips 0.38 and 0.43 m. Joints read in another
program's order were 104 degrees off, a robot that could not turn its feet out 113, legs bent to stay above a floor that
was none 63.

Whether left is left in a source: toes point to the front of who has the left hip on the left, and nobody turns round
between two frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.numerics.stretches import stretches
from estimator.retargeting.joint_orders import order_misfit
from estimator.retargeting.leaps import Leap, leap_findings, leap_frames
from estimator.retargeting.motion import RetargetedMotion
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.targets import LIMB, Targets
from humanoid.kinematics.body import Body, points_in_world
from humanoid.support.errors import first_of

_SIDES = ("left", "right")
_PARTS = ("hip", "knee", "ankle", "big_toe")
_BACK = -0.2
"""Cosine of foot and front, in the middle of all frames. Of 126 motions the least is 0.32."""
_SHORTEST_FOOT = 1e-9  # m
_LISTED_SIDES = 4
_FASTEST = 2400.0
"""[degrees/s] Faster than anybody turns: a figure skater's record are 342 turns a minute, 2050 degrees a second."""
_ROUND = 120.0  # degrees: a turn that no noise of a line across the body makes


def turns_round(source: SourceMotion) -> tuple[int, ...]:
    """The frames before which the line across hips or shoulders turns round faster than anybody, as where left and
    right are exchanged from there on, or no longer."""
    frames = set[int]()
    for part in ("hip", "shoulder"):
        ends = [f"{side}_{part}" for side in _SIDES]
        if not set(ends) <= set(source.names):
            continue
        across = source.landmark(ends[0]) - source.landmark(ends[1])
        known = np.flatnonzero(np.linalg.norm(across, axis=1) > _SHORTEST_FOOT)
        line = across[known] / np.linalg.norm(across[known], axis=1)[:, None]
        angle = np.degrees(np.arccos(np.clip((line[1:] * line[:-1]).sum(axis=1), -1.0, 1.0)))
        fast = angle > np.maximum(_ROUND, _FASTEST * np.diff(source.times[known]))
        frames |= set(known[1:][fast].tolist())
    return tuple(sorted(frames))


def mirrored_frames(source: SourceMotion) -> np.ndarray:
    """Frames (T,) bool of a source, or of its parts between such turns, that `is_mirrored`."""
    mirrored = np.zeros(len(source.times), dtype=bool)
    cuts = [0, *turns_round(source), len(mirrored)]
    for first, after in pairwise(cuts):
        part = slice(first, after)
        mirrored[part] = is_mirrored(replace(source, points=source.points[part], times=source.times[part]))
    return mirrored


def without_mirrored_parts(source: SourceMotion) -> SourceMotion:
    """The motion without its parts in which left and right are exchanged, which are missing then, with a note; as it is
    where all of it is mirrored, or nothing."""
    mirrored = mirrored_frames(source)
    if not mirrored.any() or mirrored.all():
        return source
    spans = [f"{source.times[first]:.2f} to {source.times[after - 1]:.2f} s" for first, after in stretches(mirrored)]
    what = "left and right are exchanged, as hips or shoulders turn round at once and toes point backwards,"
    note = f"{source.source}: {what} from {first_of(spans, _LISTED_SIDES)}: treated as missing"
    points = np.where(mirrored[:, None, None], np.nan, source.points)
    return replace(source, points=points, notes=(*source.notes, note))


def is_mirrored(source: SourceMotion) -> bool:
    """Whether the toes of both feet point backwards, as where left and right are exchanged, or axes are left-handed.

    The front is across the hips and the shank, which a foot is never behind, however far a person bends.
    """
    if not {f"{side}_{part}" for side in _SIDES for part in _PARTS} <= set(source.names):
        return False
    across = source.landmark("left_hip") - source.landmark("right_hip")
    cosines = [_forward(source, side, across) for side in _SIDES]
    return all(len(cosine) and float(np.median(cosine)) < _BACK for cosine in cosines)


def _forward(source: SourceMotion, side: str, across: np.ndarray) -> np.ndarray:
    """Cosines of a foot with the front, in the frames in which it is known."""
    knee, ankle, toe = (source.landmark(f"{side}_{part}") for part in _PARTS[1:])
    front, foot = np.cross(across, knee - ankle), toe - ankle
    length = np.linalg.norm(front, axis=1) * np.linalg.norm(foot, axis=1)
    known = length > _SHORTEST_FOOT
    return np.asarray((front * foot).sum(axis=1)[known] / length[known])


_OFF = 60.0  # degrees: a limb's end is as far from where it should be as the limb is long
_HIPS_OFF = 0.4  # of the length of thigh and shank
_LIGHT = 0.5  # of a limb's weight: what counts less may be anywhere
_ACROSS = ("hips", "shoulders", "head")  # lines across the trunk are short, and heads turn as they can
_SHORTEST = 1e-9  # m
_MIRRORED = "the toes point backwards, as left and right are exchanged or the axes are left-handed,"
_TURNS = "hips or shoulders turn round faster than anybody"
_NO_BODY = 1.5
"""Factor of the largest misfit of names that are searched for; names that a file gives are trusted further. Of 273
parts of 1 s of captured motions, exact or with 20 and 30 mm of noise, the largest is 1.02, of robots and their people
0.4; of parts whose names are permuted among half of all joints or more the least is 1.2, and 2 % are below 1.5."""
_LISTED = 4
_LEG = ("hip", "knee", "ankle")
_REVERSED = "the subject's toes point backwards, as its heels and toes, or left and right, are exchanged,"


class Doubts(NamedTuple):
    """findings: a sentence each. frames (T,) bool: those that they speak against."""

    findings: tuple[str, ...]
    frames: np.ndarray


def doubts_of(body: Body, motion: RetargetedMotion, source: SourceMotion, leaps: Sequence[Leap] = ()) -> Doubts:
    """Doubts about a motion that follows a source, whose leaps are those before its gaps were filled."""
    targets = motion.targets
    own = np.array([targets.combination @ points_in_world(body.at(q), targets.joint, targets.local) for q in motion.q])
    rows = _limbs(targets)
    angles = _angles(own[:, rows], targets.target[:, rows])
    mirrored, reversed_feet = mirrored_frames(source), np.full(len(own), is_mirrored(_at_rest(body)))
    turning = _beside(turns_round(source), len(own))
    unknown = np.asarray((targets.weight <= 0.0).all(axis=1))
    doubts = [
        (leap_findings(source, tuple(leaps)), leap_frames(source, tuple(leaps))),
        _of_limbs(source, [targets.names[row] for row in rows], angles),
        _of_hips(source, _hips_off(targets, own), _leg(body)),
        _of_lengths(source),
        (_sentence(source, unknown, "the source is entirely missing"), unknown),
        (_sentence(source, turning, _TURNS, "left and right are to be checked there"), turning),
        (_sentence(source, mirrored, _MIRRORED, "names and axes of the file are to be checked"), mirrored),
        (_sentence(source, reversed_feet, _REVERSED, "its landmarks are to be checked"), reversed_feet),
    ]
    findings = tuple(sentence for sentences, _ in doubts for sentence in sentences)
    return Doubts(findings, np.any([frames for _, frames in doubts], axis=0))


def _beside(turns: Sequence[int], count: int) -> np.ndarray:
    """Frames (T,) bool before and after the turns."""
    frames = np.zeros(count, dtype=bool)
    frames[[t - k for t in turns for k in (0, 1)]] = True
    return frames


def _at_rest(body: Body) -> SourceMotion:
    """A body's landmarks in one frame."""
    return SourceMotion(body.landmark_names, body.landmarks(body.at(body.neutral))[None], np.zeros(1), "subject")


def _limbs(targets: Targets) -> list[int]:
    """Rows of the directions that count."""
    names, shares = targets.names, targets.combination.sum(axis=1)
    heavy = targets.weight.max(axis=0, initial=0.0) >= _LIGHT / LIMB**2
    return [r for r, name in enumerate(names) if abs(shares[r]) < _SHORTEST and heavy[r] and name not in _ACROSS]


def _angles(own: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Angles (T, B) [deg] between directions (T, B, 3), NaN where the source has none."""
    across = np.linalg.norm(np.cross(own, wanted), axis=2)
    return np.asarray(np.degrees(np.arctan2(across, (own * wanted).sum(axis=2))))


def _hips_off(targets: Targets, own: np.ndarray) -> np.ndarray:
    """Distances (T,) [m] of the middle of the hips from where they are to be, 0 where that is not known."""
    rows = [r for r, name in enumerate(targets.names) if name == "hips" and targets.combination[r].sum() > _LIGHT]
    off = np.linalg.norm(own[:, rows] - targets.target[:, rows], axis=2)
    return np.asarray(np.nan_to_num(off).max(axis=1, initial=0.0))


def _leg(body: Body) -> float:
    """Length of thigh and shank [m] of a body at rest, infinite without them."""
    places = dict(zip(body.landmark_names, body.landmarks(body.at(body.neutral)), strict=True))
    for side in ("left", "right"):
        if {f"{side}_{part}" for part in _LEG} <= places.keys():
            hip, knee, ankle = (places[f"{side}_{part}"] for part in _LEG)
            return float(np.linalg.norm(hip - knee) + np.linalg.norm(knee - ankle))
    return float("inf")


def _of_limbs(source: SourceMotion, names: Sequence[str], angles: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Doubts from directions, angles (T, B) [deg]."""
    far = np.nan_to_num(angles) > _OFF
    worst = np.nan_to_num(angles).max(axis=0, initial=0.0)
    listed = [f"{names[k].replace('_', ' ')} by up to {worst[k]:.0f}" for k in np.argsort(-worst) if worst[k] > _OFF]
    frames = np.asarray(far.any(axis=1))
    what = f"limbs are off the source's directions ({first_of(listed, _LISTED)} degrees)"
    remedy = "the subject cannot follow there, or joints do not match their names"
    return _sentence(source, frames, what, remedy), frames


def _of_hips(source: SourceMotion, off: np.ndarray, leg: float) -> tuple[tuple[str, ...], np.ndarray]:
    """Doubts from the path, off it by (T,) [m], of a body with legs of this length [m]."""
    frames = np.asarray(off > _HIPS_OFF * leg)
    return _sentence(source, frames, f"the hips are up to {off.max(initial=0.0):.1f} m off the source's path"), frames


def _of_lengths(source: SourceMotion) -> tuple[tuple[str, ...], np.ndarray]:
    """Evidence against the names of a source's landmarks: impossible limbs."""
    misfit = order_misfit(source.points, source.names)
    frames = np.full(len(source.times), misfit.value > _NO_BODY)
    return _sentence(
        source, frames, f"limbs are not those of a body ({misfit.why})", "joints do not match their names"
    ), frames


def _sentence(source: SourceMotion, frames: np.ndarray, what: str, remedy: str = "") -> tuple[str, ...]:
    """The finding for frames (T,) bool; none without any."""
    at = np.flatnonzero(frames)
    if not len(at):
        return ()
    number = f"{len(at)} frame{'s' if len(at) > 1 else ''}"
    when = f"from {source.times[at[0]]:.2f} to {source.times[at[-1]]:.2f} s"
    return (f"{source.source}: {what} in {number} {when}{': ' if remedy else ''}{remedy}",)
