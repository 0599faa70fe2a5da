"""Pieces of tracks clustered into people, and which of the people that several cameras see together is the subject."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import meeting_points
from estimator.data.people.pieces import Table


def grouped(affinity: np.ndarray) -> np.ndarray:
    """Group (P,) of each piece, from a symmetric matrix (P, P) of affinities.

    Greedy additive edge contraction (Keuper et al., Efficient decomposition of image and mesh graphs by lifted
    multicuts, ICCV 2015): the two groups of largest affinity are joined, affinities of the joined ones add up,
    and it ends when no pair's is above 0.
    """
    count = len(affinity)
    between = affinity.astype(np.float64, copy=True)
    np.fill_diagonal(between, -np.inf)
    group = np.arange(count)
    if count < 2:
        return group
    nearest = between.argmax(axis=1)
    best = between[np.arange(count), nearest]
    while True:
        i = int(best.argmax())
        if not best[i] > 0.0:
            return np.unique(group, return_inverse=True)[1]
        j = int(nearest[i])
        _join(between, i, j)
        group[group == j] = i
        stale = np.flatnonzero((nearest == i) | (nearest == j))
        stale = np.unique(np.append(stale, (i, j)))
        closer = between[:, i] > best
        nearest[closer], best[closer] = i, between[closer, i]
        nearest[stale] = between[stale].argmax(axis=1)
        best[stale] = between[stale, nearest[stale]]


def _join(between: np.ndarray, i: int, j: int) -> None:
    """Make group j a part of group i."""
    between[i] += between[j]
    between[:, i] = between[i]
    between[i, i] = -np.inf
    between[j] = between[:, j] = -np.inf


def exchange_pieces(
    affinity: np.ndarray, group: np.ndarray, who: int, camera: np.ndarray, begin: np.ndarray
) -> np.ndarray:
    """The groups (P,) after the best exchanges between group `who` and each other, which greed alone does not find.

    Exchanged is what one camera, or all, saw of both in a stretch of time: there two people may have changed places.
    Pieces with a `camera` (P,) below 0 stay; `begin` (P,): when each begins. Every exchange raises the sum of
    affinities within the groups, so that it ends.
    """
    group = group.copy()
    changed = True
    while changed:
        changed = False
        for other in [*np.setdiff1d(group, [who]).tolist(), int(group.max()) + 1]:  # and with none
            for c in (*np.unique(camera[camera >= 0]).tolist(), None):
                pieces = np.flatnonzero(camera >= 0 if c is None else camera == c)
                moved = _exchange(affinity, group, (who, other), pieces, begin)
                group[moved] = who + other - group[moved]
                changed |= len(moved) > 0
    return group


def _exchange(
    affinity: np.ndarray, group: np.ndarray, two: tuple[int, int], pieces: np.ndarray, begin: np.ndarray
) -> np.ndarray:
    """The pieces, consecutive in time, that two groups exchange with most gain; none without gain."""
    pieces = pieces[np.isin(group[pieces], two)]
    pieces = pieces[np.argsort(begin[pieces], kind="stable")]
    if not len(pieces):
        return pieces
    mine, theirs = ((group == g).astype(float) for g in two)
    sign = np.where(group[pieces] == two[0], 1.0, -1.0)
    alone = sign * (affinity[pieces] @ (theirs - mine))  # what each would gain if the others stayed
    both = sign[:, None] * affinity[np.ix_(pieces, pieces)] * sign  # and the affinities of those that change along
    ends = np.concatenate([[0.0], np.cumsum(alone)])
    corner = np.zeros((len(ends), len(ends)))
    corner[1:, 1:] = np.cumsum(np.cumsum(both, axis=0), axis=1)
    inner = np.diag(corner)
    gain = ends[None, :] - ends[:, None] + inner[None, :] + inner[:, None] - corner - corner.T
    gain = np.triu(gain, 1)
    i, j = np.unravel_index(int(gain.argmax()), gain.shape)
    return pieces[i:j] if gain[i, j] > 1e-6 else pieces[:0]


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
