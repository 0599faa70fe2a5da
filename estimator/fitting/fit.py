"""Result of a fit; the frames of a clip that a person is fitted from, whose poses differ; and how large a person is
whom one camera sees stand on a floor of known height.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation, PoseEstimate, image_extent
from estimator.data.sequence import with_shares
from estimator.energy.priors import world_up
from estimator.fitting.settings import FitSettings
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError, first_of

_SIZES, _NU = 0.06, 4.0  # of the logarithm of people's heights about the subject's, with tails, as there are children
_SOLE = 0.02  # m: of a sole above the floor, as shoes and the flesh have it
_LOWEST_CAMERA = 0.3  # m above the floor: a lower camera sees distances badly
_INDEPENDENT = 4.0  # frames at most that count as independent
_SMALLEST, _LARGEST = 0.4, 1.4  # sizes beyond which the floor or the unit is in doubt


class FloorSize(NamedTuple):
    """factor: by which the person is larger than modelled, and as much farther away, with what is known of people. std:
    its relative standard deviation. seen: the same factor by the floor alone. believed: whether people can be so."""

    factor: float
    std: float
    seen: float
    believed: bool


def size_by_floor(body: Body, poses: np.ndarray, observations: Sequence[Observation], floor: float) -> FloorSize | None:
    """The size from the lowest parts of the poses (F, nq) on their rays, and the floor's height in the world [m].

    A person k times as large and as far away looks the same to a pinhole; so a camera h above the floor sees a person h
    over (h less the height of the soles above the floor) times as large as modelled. The median over the frames, which
    leaves out those in the air. None where the camera is parallel, or no more than 0.3 m above the floor, and of a body
    without a free root or flesh.
    """
    camera = observations[0].cameras[0]
    up = world_up(observations[0].cameras)
    drop = float(camera.origin_world @ up) - floor
    if camera.parallel or not body.has_free_root or drop < _LOWEST_CAMERA:
        return None
    lowest = FloorDistances(body, up, floor).lowest(body.placed(poses))
    sole = lowest[lowest < 0.9 * drop]
    if not len(sole):
        return None
    logs = np.log(drop / (drop - sole))
    seen = float(np.median(logs))
    scatter = 1.4826 * float(np.median(np.abs(logs - seen))) / np.sqrt(min(len(logs), _INDEPENDENT))
    variance = (_SOLE / drop) ** 2 + scatter**2 + camera.focal_std**2
    people = _SIZES**2 + seen**2 / _NU
    share = people / (people + variance)
    believed = bool(_SMALLEST < np.exp(seen) < _LARGEST)
    factor = float(np.exp(share * seen)) if believed else 1.0
    return FloorSize(factor, float(np.sqrt(share * variance)), float(np.exp(seen)), believed)


SIZES = (0.5, 1.25)
"""Least and largest size of a person, relative to the subject: of an adult of 1.70 m, 0.85 to 2.13 m."""
OTHER_SIZE, SAME_SIZE = 0.03, 0.02  # logarithms: from which a person is of another size, up to which of the same
_HEIGHT_OFF = 0.03  # logarithm of heights from which two are reported to differ
_LISTED = 12  # names in a note
_AT_BOUND = 1e-3  # of a proportion, relative to the end of its range


@dataclass(frozen=True)
class ShapeFit:
    """The flesh that was fitted, part by part (CSS section 5, second and third stage).

    parts (G): names of the parts, one for both where sides mirror each other. factors (G, 2): of the half-axes a and b
    of the sections, relative to the given subject. tapers (G, 2): changes of the tapers along a and b. std (G, 4):
    standard deviations of girth (the log of both factors), flatness (half the log of their ratio) and the tapers, zero
    where a part has no such parameter. frames: indices of the frames whose pictures were used. poses (F, nq),
    covariance (F, nv, nv): the body in these frames, and how uncertain it is with proportions and shape as uncertain
    as they are. agreement: shares of the body's outline that lie on the silhouettes' before and after, NaN without any.
    """

    parts: tuple[str, ...]
    factors: np.ndarray
    tapers: np.ndarray
    std: np.ndarray
    frames: tuple[int, ...]
    poses: np.ndarray
    covariance: np.ndarray
    agreement: tuple[float, float]


@dataclass(frozen=True)
class Fit:
    """Outcome of a fit.

    subject: the subject with the fitted lengths, and the fitted flesh if there is a `shape`. names (P): proportions by
    joint. scales (P,): estimate relative to the given subject. covariance (P, P): of the scales. observations (F): the
    frames used, in the readings that were chosen of them; none if none were usable, and the subject is then the given
    one. poses (F, nq), pose_covariance (F, nv, nv): of the subject with the fitted lengths, in these frames; how
    uncertain each pose is by its own frame, with the lengths as uncertain as they are. shape: of the flesh, None where
    it was not fitted. size: by which the subject was resized as a whole before its proportions were fitted. height
    [m]: what the user knows of the person, None where nothing. by_floor: what one camera sees of the size by a known
    floor, None where nothing. bent: joints of a static trial that are too far from upright standing to be known.
    noise: of each camera's keypoints about the fitted person, as a factor of what is expected; none where there
    are none.
    moved: by name, how far [m] keypoints and markers lie from where they are expected on the body, of those that do not
    lie there by chance.
    """

    subject: Subject
    names: tuple[str, ...]
    scales: np.ndarray
    covariance: np.ndarray
    observations: tuple[Observation, ...]
    poses: np.ndarray
    pose_covariance: np.ndarray
    shape: ShapeFit | None = None
    size: float = 1.0
    height: float | None = None
    by_floor: FloorSize | None = None
    bent: tuple[str, ...] = ()
    noise: tuple[float, ...] = ()
    moved: Mapping[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, a sentence each."""
        notes = self._notes_on_size()
        if self.bent:
            joints = first_of(self.bent, _LISTED)
            notes = (*notes, f"bent in the static trial, so not taken as known there: {joints}")
        if self.moved:
            places = [f"{name} ({1e3 * metres:.0f} mm)" for name, metres in self.moved.items()]
            problem = f"far from where they are expected on the body: {first_of(places, _LISTED)}"
            notes = (*notes, f"{problem}. Check their names, and which side is left")
        return notes

    def _notes_on_size(self) -> tuple[str, ...]:
        if self.height is not None:
            seen = stature(self.subject)
            if abs(np.log(seen / self.height)) < _HEIGHT_OFF:
                return ()
            problem = f"the cameras see a person of {seen:.2f} m, the height given is {self.height:.2f} m"
            return (f"{problem}: look whether the cameras' unit is the metre",)
        if self.by_floor is not None:
            return (_floor_note(self.by_floor, self.size),)
        if self.size == 1.0:
            return ()
        return (f"the person is {self.size:.2f} times as large as the subject, which is resized as a whole",)

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the scales (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def mean_size(self) -> float:
        """The geometric mean of the scales, 1 without any."""
        return float(np.exp(np.log(self.scales).mean())) if len(self.scales) else 1.0

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the frames used."""
        return tuple(o.index for o in self.observations)

    @property
    def estimates(self) -> dict[int, PoseEstimate]:
        """By index of the frame, its pose and how uncertain that is, lengths and flesh marginalised; of the frames that
        the last stage used. Hypotheses of a track begin with them (CSS section 5)."""
        last = (self.frames, self.poses, self.pose_covariance)
        if self.shape is not None:
            last = (self.shape.frames, self.shape.poses, self.shape.covariance)
        return {index: PoseEstimate(q, covariance) for index, q, covariance in zip(*last, strict=True)}


def _floor_note(by_floor: FloorSize, size: float) -> str:
    if not by_floor.believed:
        problem = f"to stand on the floor the person would be {by_floor.seen:.2f} times as large, which is implausible"
        return f"{problem}: check --floor, and whether the cameras' unit is the metre"
    return f"by the floor the person is {size:.2f} (+-{by_floor.std:.0%}) times as large as the subject"


def unfitted(subject: Subject, body: ProportionedBody) -> Fit:
    """The fit without frames: prior knowledge of a subject and its body."""
    none = np.zeros((0, body.base.nq)), np.zeros((0, body.base.nv, body.base.nv))
    return Fit(subject, body.names, np.ones(len(body.names)), np.diag(body.std**2), (), *none)


def fit_resized(subject: Subject, fit: Callable[[Subject], tuple[Fit, float]], rounds: int) -> Fit:
    """The fit of a subject that is resized as a whole, within `SIZES`, until it is as large as the person, or often
    enough. fit: of a subject, and the factor by which its size should change."""
    (best, asked), size = fit(subject), 1.0
    for _ in range(rounds):
        step = float(np.clip(size * asked, *SIZES)) / size
        if abs(np.log(step)) < SAME_SIZE:
            break
        size *= step
        best, asked = fit(subject.resized(size))
    return replace(best, size=size)


def stature(subject: Subject) -> float:
    """Height [m] of a subject that stands upright in its neutral pose, by its landmarks.

    Raises
    ------
    InputError: it has no top of the head.
    """
    body = Body(subject)
    if "head_top" not in body.landmark_names:
        raise InputError("height", f"{subject.source} has no landmark head_top", remedy="leave it out")
    return float(np.ptp(body.landmarks(body.at(body.neutral))[:, 2]))


def bounded_lengths(subject: Subject) -> tuple[str, ...]:
    """The proportions of a fitted subject that rest on an end of their hard range."""
    return tuple(p.joint for p in subject.proportions if p.scale_min > 1.0 - _AT_BOUND or p.scale_max < 1.0 + _AT_BOUND)


def bound_note(subject: Subject) -> str:
    """A warning about them, empty where there are none."""
    names = bounded_lengths(subject)
    if not names:
        return ""
    ends = (f"{p.joint} ({'least' if p.scale_min > 1.0 - _AT_BOUND else 'largest'})" for p in subject.proportions)
    listed = ", ".join(end for end in ends if end.partition(" ")[0] in names)
    return (
        f"lengths rest on the bounds of what is allowed: {listed}. Angles are wrong where the person is beyond them:"
        " look whether the cameras' unit is the metre, the keypoints are of this layout, and of one person"
    )


_FULL = 0.8  # share of a typical frame's keypoints that the frames of a later piece have
_TINY = 1e-6  # s


def chosen_pieces(observations: Sequence[Observation], settings: FitSettings) -> list[list[Observation]]:
    """Pieces of usable frames in the order of time, none if no frame is usable.

    A clip of no more than `FitSettings.seconds` is one piece, its frames evenly spread. Of a longer one the first piece
    is its beginning; each other one is where the person looks least like in those before, since frames that are alike
    leave open how a bend of the limbs is shared with their lengths.
    """
    usable = [o for o in observations if o.has_enough_points]
    if not usable:
        return []
    if usable[-1].time - usable[0].time <= settings.seconds + _TINY:
        return [with_shares(evenly_spread(usable, settings.frames))]
    pieces = _pieces(usable, settings)
    typical = np.median([o.count for o in usable])
    others = [p for p in pieces[1:] if min(o.count for o in p) >= _FULL * typical]
    chosen, shapes = [pieces[0]], [_shape(p) for p in others]
    apart = [_apart(shape, _shape(pieces[0])) for shape in shapes]
    while others and len(chosen) < settings.pieces:
        k = int(np.argmax(apart))
        chosen.append(others.pop(k))
        last = shapes.pop(k)
        apart.pop(k)
        apart = [min(before, _apart(shape, last)) for before, shape in zip(apart, shapes, strict=True)]
    return [with_shares(piece) for piece in sorted(chosen, key=lambda piece: piece[0].time)]


def evenly_spread(frames: Sequence[Observation], count: int) -> list[Observation]:
    """So many frames at most, evenly spread."""
    if len(frames) <= count:
        return list(frames)
    picks = np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))
    return [frames[int(k)] for k in picks]


def _pieces(usable: Sequence[Observation], settings: FitSettings) -> list[list[Observation]]:
    """The whole clip in pieces of equal length, one after the other."""
    length = settings.seconds / settings.pieces
    number = np.floor(np.array([o.time - usable[0].time for o in usable]) / length + _TINY).astype(int)
    count = max(1, settings.frames // settings.pieces)
    return [evenly_spread([usable[int(i)] for i in np.flatnonzero(number == k)], count) for k in np.unique(number)]


def _shape(piece: Sequence[Observation]) -> np.ndarray:
    """The keypoints (C, L, 2) of the frame in its middle about their mean, in extents of the person; NaN where
    missing."""
    middle = piece[len(piece) // 2]
    known, shape = middle.known_pixels, np.full(middle.pixels.shape, np.nan)
    for c, (pixels, confidence) in enumerate(zip(known, middle.confidence, strict=True)):
        if np.isfinite(pixels).any():
            shape[c] = (pixels - np.nanmean(pixels, axis=0)) / image_extent(pixels, confidence)
    return shape


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """How far two shapes are apart: the median of their keypoints, so that a wrong one does not decide."""
    apart = np.linalg.norm(a - b, axis=2)
    known = np.isfinite(apart)
    return float(np.median(apart[known])) if known.any() else 0.0
