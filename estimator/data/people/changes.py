"""Detection of changes of a track to another person, from another camera."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from estimator.data.people.agreement import WORST, PairAffinities
from estimator.data.people.pieces import SURE, Link, Table

_TURN = 6.0  # frames of perfect agreement won, or lost again, by which a person is known to have changed
_PARTNER = 0.25  # share of a piece's best partner below which there is none


def cut_where_people_change(table: Table, affinities: PairAffinities) -> Table:
    """Cut pieces in two where another camera's piece begins or ends to agree with them: the person has changed there.

    The two alone do not show which of them changed its person, so both are cut; the one that did not is joined again by
    its link.
    """
    cuts: defaultdict[int, set[int]] = defaultdict(set)
    for p, q, frames, gains in _partners(table, affinities):
        for turn in _turns(np.cumsum(gains).tolist()):
            for piece in {p, q} - {table.seed}:
                cuts[piece].add(int(frames[turn]))
    return _cut(table, {piece: np.array(sorted(frames)) for piece, frames in cuts.items()})


def _partners(table: Table, affinities: PairAffinities) -> Iterator[tuple[int, int, np.ndarray, np.ndarray]]:
    """Pieces of two cameras that agree for a while, long enough beside the best partner of each: with the frames (F,)
    in which both were compared, and their weights (F,)."""
    if not len(affinities.first):
        return
    count = len(table.rays)
    ends = [table.piece[rows] * count + table.camera[rows] for rows in (affinities.first, affinities.second)]
    many = int(table.piece.max(initial=0) + 1) * count
    keys, place = np.unique(ends[0] * many + ends[1], return_inverse=True)
    pairs = [(*divmod(key // many, count), *divmod(key % many, count)) for key in keys.tolist()]
    gain = affinities.gain
    won = np.bincount(place, np.maximum(gain, 0.0), len(pairs)).tolist()
    best: defaultdict[tuple[int, int], float] = defaultdict(float)
    for (p, a, q, b), value in zip(pairs, won, strict=True):
        best[p, b], best[q, a] = max(best[p, b], value), max(best[q, a], value)
    rows_of = np.split(np.argsort(place, kind="stable"), np.cumsum(np.bincount(place, minlength=len(pairs)))[:-1])
    frames = _frames(table, affinities.compared_frames)
    for (p, a, q, b), value, rows in zip(pairs, won, rows_of, strict=True):
        if value < max(_TURN, _PARTNER * best[p, b], _PARTNER * best[q, a]):
            continue
        common = np.intersect1d(frames[p, a], frames[q, b])
        course = np.full(len(common), WORST)
        np.maximum.at(course, np.searchsorted(common, table.instant[affinities.first[rows]]), gain[rows])
        yield p, q, common, course


def _frames(table: Table, compared_frames: np.ndarray) -> Mapping[tuple[int, int], np.ndarray]:
    """Frames of each piece in each camera, of those compared."""
    rows = np.flatnonzero(np.isin(table.instant, compared_frames))
    rows = rows[np.lexsort((table.instant[rows], table.camera[rows], table.piece[rows]))]
    keys = np.stack([table.piece[rows], table.camera[rows]], axis=1)
    begins = np.flatnonzero(np.any(np.diff(keys, axis=0, prepend=-1), axis=1))
    return {
        (int(keys[at, 0]), int(keys[at, 1])): table.instant[part]
        for at, part in zip(begins.tolist(), np.split(rows, begins[1:]), strict=True)
    }


def _turns(total: list[float]) -> list[int]:
    """Turning points of running totals, from rising by more than _TURN to falling by more than it, or back: the first
    place of each new course."""
    turns: list[int] = []
    course, low, high = 0, 0, 0
    for t, value in enumerate(total):
        low, high = (t if value < total[low] else low), (t if value > total[high] else high)
        if course >= 0 and total[high] - value > _TURN:
            turns += [high + 1] if course > 0 else []
            course, low = -1, t
        elif course <= 0 and value - total[low] > _TURN:
            turns += [low + 1] if course < 0 else []
            course, high = 1, t
    return turns


def _cut(table: Table, cuts: Mapping[int, np.ndarray]) -> Table:
    """The table with pieces cut in two at some frames, and links between the parts."""
    count = int(table.piece.max(initial=-1)) + 1
    first = np.concatenate([[0], np.cumsum([len(cuts.get(p, ())) + 1 for p in range(count)])])
    piece = first[table.piece]
    for p, frames in cuts.items():
        rows = table.piece == p
        piece[rows] += np.searchsorted(frames, table.instant[rows], side="right")
    links = [
        replace(link, first=int(first[link.first + 1]) - 1, second=int(first[link.second])) for link in table.links
    ]
    links += [Link(k, k + 1, SURE) for p in cuts for k in range(int(first[p]), int(first[p + 1]) - 1)]
    seed = table.seed if table.seed < 0 else int(first[table.seed])
    return replace(table, piece=piece, links=tuple(links), seed=seed)
