"""When a run's feet stand, on what floor, and how far they slide while they do."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from estimator.data.floor import KnownFloor
from estimator.inference.belt import Belt
from estimator.inference.contacts import FootPoints, HandPoints, believed_floor, feet_on_floor, foot_contact, stances_of
from estimator.inference.ground import Ground
from estimator.runs.events import SIDES, Event, Side
from estimator.runs.run_reader import Run
from humanoid.subject.landmarks import foot_parts
from humanoid.support.files import replacing
from humanoid.support.summary import Facts, Summarised

_UP = np.array([0.0, 0.0, 1.0])
_SURE = 0.5
_SEEN = 0.05  # share of the frames
UNKNOWN_SPEED = "the feet move as on a treadmill of unknown speed: stance phases are unknown"


@dataclass(frozen=True)
class Stance:
    """A point of a foot that stands from `begin` until `end` [s], both frames included. slide [m]: its largest distance
    along the floor, or the belt, from the middle of its places."""

    point: str
    begin: float
    end: float
    slide: float


@dataclass(frozen=True, repr=False)
class Contact(Summarised):
    """Stances of the feet over time, and the floor; world z up.

    time (T,) [s]. names (P,): of the landmarks of the feet, the left one's first. points (T, P, 3) [m]: their places.
    standing (T, P): probability that each stands. floor: a plane with its uncertainty and how much higher each kind of
    point is; None where there is none, or nothing stands. Boxes and stairs are not part of the floor, but what rests
    there stands. seen (P,): share of the frames in which a keypoint of each was seen; feet that are not seen lie as the
    pose prior has them. hand_names (H), hands (T, H): wrists, and probabilities that these hands stand on the floor,
    where requested. raised: what the feet rest on, such as a stool or a wall, where most of the body is below it, so
    that it is not the floor. belt: of a treadmill, on which feet stand that move with it; where its speed is not known,
    standing is NaN.
    """

    time: np.ndarray
    names: tuple[str, ...]
    points: np.ndarray
    standing: np.ndarray
    floor: Ground | None
    seen: np.ndarray
    hand_names: tuple[str, ...] = ()
    hands: np.ndarray | None = None
    raised: Ground | None = None
    belt: Belt | None = None

    @property
    def places(self) -> np.ndarray:
        """The points (T, P, 3) [m] on what they stand on: in the world, or from a belt of known speed."""
        return self.points if self.known_belt is None else self.known_belt.places(self.points)

    @property
    def known_belt(self) -> Belt | None:
        """The belt, None of unknown speed."""
        return self.belt if self.belt is not None and self.belt.known else None

    @property
    def heights(self) -> np.ndarray:
        """(T, P) [m] above where the points would stand on the floor; NaN without one."""
        if self.floor is None:
            return np.full(self.standing.shape, np.nan)
        return self.floor.heights(self.points, foot_parts(self.names))

    def foot(self, side: Side) -> np.ndarray:
        """Probability (T,) that a foot stands: that of its point which does most."""
        return np.asarray(self.standing[:, [name.startswith(side) for name in self.names]].max(axis=1))

    @property
    def events(self) -> list[Event]:
        """When feet begin to stand ("strike") and cease to ("off"), in order of time; none at the clip's ends."""
        events = []
        for side in filter(self.has, SIDES):
            level = self.foot(side) - _SURE
            for i in np.flatnonzero(np.diff(level > 0.0)):
                share = level[i] / (level[i] - level[i + 1])
                at = float(self.time[i] + share * (self.time[i + 1] - self.time[i]))
                kind: Literal["strike", "off"] = "strike" if level[i + 1] > 0.0 else "off"
                events.append(Event(side, kind, at, int(i + round(share))))
        return sorted(events, key=lambda event: event.time)

    @property
    def stances(self) -> list[Stance]:
        """Stances of all points, one after the other."""
        stances: list[Stance] = []
        places = self.places
        for k, first, after in stances_of(self.standing):
            flat = places[first:after, k, :2]
            flat = flat[np.isfinite(flat).all(axis=1)]
            slide = np.linalg.norm(flat - np.median(flat, axis=0), axis=1).max() if len(flat) else np.nan
            begin, end = float(self.time[first]), float(self.time[after - 1])
            stances.append(Stance(self.names[k], begin, end, float(slide)))
        return stances

    @property
    def hand_stances(self) -> list[Stance]:
        """Stances of the hands, one after the other, where requested; without slides."""
        stretches = [] if self.hands is None else stances_of(self.hands)
        return [
            Stance(self.hand_names[k], float(self.time[first]), float(self.time[after - 1]), np.nan)
            for k, first, after in stretches
        ]

    def _facts(self) -> Facts:
        floor = "none" if self.floor is None else f"at {self.floor.height:.3f} +- {self.floor.std:.3f} m"
        stands = [
            (f"{side} foot stands", f"{np.mean(self.foot(side) > _SURE):.0%}") for side in SIDES if self.has(side)
        ]
        belt = [] if self.known_belt is None else [("belt", self.known_belt.described)]
        facts = [("frames", f"{len(self.time)}"), ("floor", floor), *belt, *stands]
        if self.hands is not None:
            shares = np.mean(self.hands > _SURE, axis=0)
            facts += [(f"{n} stands", f"{share:.0%}") for n, share in zip(self.hand_names, shares, strict=True)]
        return [*facts, ("but", self.remark)] if self.remark else facts

    @property
    def remark(self) -> str:
        """Reason not to trust this; empty where there is none."""
        if self.raised is not None:
            return f"feet rest at {self.raised.height:.2f} m, with the body below them: this is not used as a floor"
        if self.belt is not self.known_belt:
            return UNKNOWN_SPEED
        if not len(self.seen) or self.seen.max() >= _SEEN:
            return ""
        return "the keypoints have no heels and toes: their stances come from ankles and the pose prior alone"

    def has(self, side: Side) -> bool:
        """Whether a foot is among the points."""
        return any(name.startswith(side) for name in self.names)

    def _belt_speed(self) -> np.ndarray:
        """(T, 1) [m/s], (T, 0) without a belt of known speed."""
        return np.zeros((len(self.time), 0)) if self.known_belt is None else self.known_belt.speeds[:, None]

    def write(self, path: str | Path) -> Path:
        """Write a csv, one row a frame: the probabilities, then the heights [m], then those of hands, then the speed of
        a belt [m/s] where there is one; returns its path.

        Raises
        ------
        InputError: it is not writable.
        """
        path = Path(path)
        with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            hands = np.zeros((len(self.time), 0)) if self.hands is None else self.hands
            heads = [f"{n} stands" for n in self.names], [f"{n} height [m]" for n in self.names]
            belt = self._belt_speed()
            ends = [*(f"{n} stands" for n in self.hand_names), *belt.shape[1] * ["belt [m/s]"]]
            rows.writerow(["time [s]", *heads[0], *heads[1], *ends])
            values = np.column_stack([self.time, self.standing, self.heights, hands, belt])
            rows.writerows([["" if np.isnan(v) else f"{v:.6g}" for v in row] for row in values])
        return path


def contact_of_run(run: Run, *, hands: bool = False) -> Contact | None:
    """Contact of the drawn trajectory, on the floor that was known when it was tracked or is found; None where the
    subject has no heels and toes as landmarks."""
    feet = FootPoints.of(run.body)
    if feet is None:
        return None
    points = run.landmarks[:, feet.landmark]
    seen = np.zeros(points.shape[:2], dtype=bool)
    confidence = run.confidence[: len(run)]  # shorter in runs from before keypoints were kept
    seen[: len(confidence)] = (confidence[:, :, feet.landmark] > 0.0).any(axis=1)
    if run.markers is not None:
        seen |= run.body.landmarks_beside(np.isfinite(run.markers[run.index]).all(axis=2))[:, feet.landmark]
    shares = seen.mean(axis=0) if len(seen) else np.zeros(len(feet.names))
    shown = seen if shares.max(initial=0.0) >= _SEEN else None
    standing, floor, raised, belt = feet_on_floor(
        run.body, feet, run.q, points, run.time, _UP, _known_floor(run), shown
    )
    standing[:, ~np.isfinite(points).all(axis=2).any(axis=0)] = 0.0
    contact = Contact(run.time, feet.names, points, standing, floor, shares, raised=raised, belt=belt)
    palms = HandPoints.of(run.body) if hands else None
    if palms is None:
        return contact
    places = run.landmarks[:, palms.landmark]
    return replace(contact, hand_names=palms.names, hands=palms.standing(places, run.time, floor))


def _known_floor(run: Run) -> KnownFloor | Ground:
    """That which the smoothed trajectory is above; else the one that was given, unless the body is nowhere near it."""
    if run.floor is not None:
        return run.floor
    return believed_floor(run.body, run.header.cameras, run.header.floor, run.q)


def contact_of_points(time: np.ndarray, names: Sequence[str], points: np.ndarray) -> Contact:
    """Contact of points of the feet (T, P, 3) [m], z up, NaN where missing, at times (T,) [s], rising; by names as
    left_heel, see `foot_landmarks`."""
    standing, floor, belt = foot_contact(points, time, foot_parts(names), _UP)
    known = np.isfinite(points).all(axis=2)
    standing[:, ~known.any(axis=0)] = 0.0  # points that are never seen are unknown
    return Contact(time, tuple(names), points, standing, floor, known.mean(axis=0), belt=belt)
