"""Which of the people that several cameras see together is the subject."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import meeting_points
from estimator.data.people.groups import exchange_pieces, grouped
from estimator.data.people.pieces import Table

_PASSES = 3  # through all groups, which settle in the first or second
_LOOKS = 5  # instants whose size is used for a person's
_ALIKE = 1.4  # ratio of two sizes beyond which it is another person: arms are raised, people crouch
_SPEED = (
    0.25  # body sizes a frame that an unseen person may have moved: 7 a second, a sprinter's, at 30 frames a second
)
_NEAR = 0.5  # body sizes two places of one person may differ because limbs moved


def subject_rows(table: Table, cameras: Sequence[Camera], affinity: np.ndarray) -> np.ndarray:
    """Which detections (D,) are the subject's, by the affinities (P, P) of pieces; none where no two cameras see a
    person together.

    The person of the seed; without a seed the one with the largest sum of size x confidence in the frames where two
    cameras or more see it. With it go all tracks that can be the same person at another time: never seen beside
    it, of its size, and near enough to be reached.
    """
    pieces = grouped(affinity)
    first, _ = _largest(table, pieces[table.piece])
    if first < 0:
        return np.zeros(len(table.piece), dtype=bool)
    camera, begin = _of_pieces(table, len(affinity))
    group = exchange_pieces(affinity, pieces, first, camera, begin)[table.piece]
    first, score = _largest(table, group)
    if first < 0:
        return np.zeros(len(table.piece), dtype=bool)
    shared, subject = seen_together(table, group), group == first
    for other in np.argsort(-score, kind="stable").tolist():
        if score[other] > 0.0 and other != first and continues(table, cameras, shared, subject, group == other):
            subject = subject | (group == other)
    return np.asarray(subject)


def group_everybody(table: Table, affinity: np.ndarray) -> np.ndarray:
    """Group (P,) of each piece, after the best exchanges between all groups with a person seen by two cameras."""
    pieces, passes = grouped(affinity), 0
    camera, begin = _of_pieces(table, len(affinity))
    before = np.full_like(pieces, -1)
    while passes < _PASSES and not np.array_equal(before, pieces):
        before, passes = pieces, passes + 1
        score = _largest(table, pieces[table.piece])[1]
        for who in np.argsort(-score, kind="stable")[: np.count_nonzero(score > 0.0)].tolist():
            pieces = exchange_pieces(affinity, pieces, who, camera, begin)
    return pieces


def _of_pieces(table: Table, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Camera and first instant of each piece (P,), camera -1 for that of the seed."""
    camera, begin = np.full(count, -1), np.full(count, np.iinfo(np.int64).max)
    camera[table.piece] = table.camera
    np.minimum.at(begin, table.piece, table.instant)
    if table.seed >= 0:
        camera[table.seed] = -1
    return camera, begin


def _largest(table: Table, group: np.ndarray) -> tuple[int, np.ndarray]:
    """The seed's group, or the largest, -1 without any; and the sizes of all."""
    shared = seen_together(table, group)
    score = np.bincount(group[shared], table.weight[shared], int(group.max(initial=0)) + 1)
    if table.seed >= 0:
        return int(group[table.piece == table.seed][0]), score
    return (int(score.argmax()) if score.max(initial=0.0) > 0.0 else -1), score


def seen_together(table: Table, group: np.ndarray) -> np.ndarray:
    """Which detections (D,) have another camera's of the same group and frame beside them."""
    when = group * (int(table.instant.max(initial=0)) + 1) + table.instant
    seen = np.unique(when * len(table.rays) + table.camera) // len(table.rays)  # each camera once
    instants, count = np.unique(seen, return_counts=True)
    return np.isin(when, instants[count > 1])


def continues(
    table: Table, cameras: Sequence[Camera], shared: np.ndarray, subject: np.ndarray, other: np.ndarray
) -> bool:
    """Whether the rows `other` can be the subject's too; shared: see `seen_together`."""
    places = [
        set(zip(table.camera[rows].tolist(), table.instant[rows].tolist(), strict=True)) for rows in (subject, other)
    ]
    if not places[0].isdisjoint(places[1]) or not (subject & shared).any():
        return False
    ours, theirs = np.unique(table.instant[subject & shared]), np.unique(table.instant[other & shared])
    gaps = np.abs(ours[:, None] - theirs[None, :])
    i, j = np.unravel_index(int(gaps.argmin()), gaps.shape)
    sizes = [_size(table, cameras, subject, ours), _size(table, cameras, other, theirs)]
    a, b = _points(table, cameras, subject, int(ours[i])), _points(table, cameras, other, int(theirs[j]))
    reach = (_NEAR + _SPEED * float(gaps[i, j])) * max(sizes)
    near = float(np.linalg.norm(np.nanmean(a, axis=0) - np.nanmean(b, axis=0))) < reach
    return near and max(sizes) < _ALIKE * min(sizes)


def _size(table: Table, cameras: Sequence[Camera], rows: np.ndarray, frames: np.ndarray) -> float:
    """Median diagonal [m] of a person's landmarks in some of the frames."""
    some = frames[np.unique(np.linspace(0, len(frames) - 1, _LOOKS).round().astype(int))]
    points = [_points(table, cameras, rows, int(frame)) for frame in some]
    spans = [float(np.linalg.norm(np.nanmax(p, axis=0) - np.nanmin(p, axis=0))) for p in points]
    return float(np.median(spans))


def _points(table: Table, cameras: Sequence[Camera], rows: np.ndarray, frame: int) -> np.ndarray:
    """Landmarks (N, 3) [m] that two cameras or more see of a person in a frame."""
    used = np.flatnonzero(rows & (table.instant == frame))
    by_camera = [cameras[c] for c in table.camera[used]]
    directions = [
        table.rays[c].directions[row - table.first[c]] for c, row in zip(table.camera[used], used, strict=True)
    ]
    points = meeting_points(by_camera, np.stack(directions))
    return points[np.isfinite(points).all(axis=1)]
