"""Detections of everybody in every camera as one table, cut into pieces that are each one person's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import Rays
from estimator.data.formats.keypoints_reading import Person
from estimator.data.formats.people_tracks import PersonTrack, largest_first

SURE, LIKELY, NAMED = 5.0, 1.0, 1.0
"""Evidence for two pieces of a track that follow each other being one person, in frames of perfect agreement: where no
other person was near, where one was, and where the file gives both the same id."""
_MOST_PIECES = 2000  # beyond it tracks stay whole, and beyond it again the lightest are left out


@dataclass(frozen=True)
class CameraDetections:
    """Content of one camera's file.

    frames: its people by frame. names (J): landmark of each keypoint. chosen: the subject's detections where the user
    chose the person. instants (T,): number of the instant that each frame shows, the same numbers for all cameras; the
    frames' own without it.
    """

    camera: Camera
    names: Sequence[str | None]
    frames: Mapping[int, Sequence[Person]]
    chosen: Mapping[int, Person] | None = None
    instants: np.ndarray | None = None

    def instant(self, frame: int) -> int:
        """Number of the instant that a frame shows, -1 where unknown."""
        if self.instants is None:
            return frame
        return int(self.instants[frame]) if frame < len(self.instants) else -1


@dataclass(frozen=True)
class Link:
    """Pieces first and second follow each other in one track of one camera; strength: the evidence for it."""

    first: int
    second: int
    strength: float


@dataclass(frozen=True)
class Table:
    """All detections (D) of all cameras (C).

    people (D): themselves. camera, frame, instant, track, piece (D,): where each belongs; tracks are numbered camera by
    camera, the largest first, pieces through all cameras. rays (C), first (C + 1): a camera's detections are
    rows first[c] to first[c + 1] of the table. weight (D,): size in the image, as a share of it, times confidence.
    links: between pieces. seed: piece of the detections that the user chose, over all cameras; -1 without any.
    landmarks (L): names of the rays' columns.
    """

    people: Sequence[Person]
    camera: np.ndarray
    frame: np.ndarray
    instant: np.ndarray
    track: np.ndarray
    piece: np.ndarray
    rays: Sequence[Rays]
    first: np.ndarray
    weight: np.ndarray
    links: tuple[Link, ...]
    seed: int
    landmarks: tuple[str, ...]


def table_of(all_detections: Sequence[CameraDetections]) -> Table:
    """Detections of tracks that are cut wherever two people may have changed places: where another person was near,
    where the id changes, and where a detection is missing.

    In a crowd that leaves too many pieces, tracks stay whole, and the lightest are left out.
    """
    landmarks = tuple(dict.fromkeys(name for s in all_detections for name in s.names if name is not None))
    tracks = [
        largest_first(s.frames) if s.chosen is None else [PersonTrack(dict(s.chosen), set())] for s in all_detections
    ]
    seed = 0 if any(s.chosen is not None for s in all_detections) else -1
    cut = _Builder(landmarks, seed, cut=True).filled(all_detections, tracks)
    if cut.pieces <= _MOST_PIECES:
        return cut.table()
    lightest = sorted((t.weight for each in tracks for t in each), reverse=True)[:_MOST_PIECES][-1]
    heavy = [[t for t in each if t.weight >= lightest] for each in tracks]
    return _Builder(landmarks, seed, cut=False).filled(all_detections, heavy).table()


class _Builder:
    """Rows of the table while they are collected. cut: whether tracks are cut where they are not certain."""

    def __init__(self, landmarks: tuple[str, ...], seed: int, *, cut: bool) -> None:
        self._landmarks, self._seed, self._cut = landmarks, seed, cut
        self._people: list[Person] = []
        self._rows: list[tuple[int, int, int, int, int, float]] = []  # camera, frame, instant, track, piece, weight
        self._rays: list[Rays] = []
        self._first = [0]
        self._links: list[Link] = []
        self.pieces = seed + 1

    def filled(self, all_detections: Sequence[CameraDetections], tracks: Sequence[Sequence[PersonTrack]]) -> _Builder:
        """The pieces with the tracks of every camera."""
        for c, (camera_detections, ours) in enumerate(zip(all_detections, tracks, strict=True)):
            diagonal = float(np.hypot(*camera_detections.camera.image_size))
            for number, track in enumerate(ours):
                self._add(c, number, track, camera_detections, diagonal)
            pixels = _by_landmark(self._people[self._first[-1] :], camera_detections.names, self._landmarks)
            self._rays.append(Rays.of(camera_detections.camera, pixels))
            self._first.append(len(self._people))
        return self

    def _add(
        self, c: int, number: int, track: PersonTrack, camera_detections: CameraDetections, diagonal: float
    ) -> None:
        people, piece = track.people, None if camera_detections.chosen is None else self._seed
        before: int | None = None
        for frame in sorted(
            f for f, person in people.items() if person.size > 0.0 and camera_detections.instant(f) >= 0
        ):
            person = people[frame]
            uncertain = before is not None and self._cut and _uncertain(track, before, frame)
            if piece is None and uncertain and before is not None:
                self._links.append(_link(self.pieces - 1, people[before], person, frame in track.doubtful))
            if piece is None and (uncertain or before is None):
                self.pieces += 1
            before = frame
            self._people.append(person)
            owner = self.pieces - 1 if piece is None else piece
            self._rows.append((c, frame, camera_detections.instant(frame), number, owner, person.weight / diagonal))

    def table(self) -> Table:
        """The collected table."""
        rows = np.array(self._rows).reshape(-1, 6)
        camera, frame, instant, track, piece = rows[:, :5].astype(np.int64).T
        return Table(
            self._people, camera, frame, instant, track, piece, self._rays, np.array(self._first), rows[:, 5],
            tuple(self._links), self._seed, self._landmarks,
        )  # fmt: skip


def _uncertain(track: PersonTrack, before: int, frame: int) -> bool:
    """Whether two people may have changed places between two frames of a track."""
    return frame in track.doubtful or frame - before > 1 or track.people[before].id != track.people[frame].id


def _link(piece: int, before: Person, after: Person, doubtful: bool) -> Link:
    named = NAMED if before.id is not None and before.id == after.id else 0.0
    other = before.id != after.id
    return Link(piece, piece + 1, (LIKELY if doubtful or other else SURE) + named)


def _by_landmark(people: Sequence[Person], names: Sequence[str | None], landmarks: Sequence[str]) -> np.ndarray:
    """Pixels (N, L, 2) in the order of the landmarks."""
    pixels = np.full((len(people), len(landmarks), 2), np.nan)
    if not people:
        return pixels
    points = np.stack([p.points[:, :2] for p in people])
    place = {name: j for j, name in reversed(list(enumerate(names))) if name is not None}
    for column, name in enumerate(landmarks):
        if name in place:
            pixels[:, column] = points[:, place[name]]
    return pixels
