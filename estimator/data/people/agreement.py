"""Affinity of two pieces of tracks: evidence for and against their being one person."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse import csr_array

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import RayPairs
from estimator.data.people.pieces import Table
from humanoid.subject.landmarks import mirror_index

FIT = 0.05  # body sizes: the same person's detections are nearer than this, real ones at 0.01 to 0.02
_SHARPEST = 0.01  # body sizes: no detector and calibration are better than a third of this
_SPREAD = 3.0  # times the usual distance within which two detections support one person
_FAR = 0.2  # body sizes at a first look: two detections that are not compared further
WORST = -2.0  # what a frame counts at most against it
_BESIDE = 5.0  # what it counts against two pieces to be seen beside each other in one camera
_MOST_COMPARED = 4_000_000  # pairs of detections


@dataclass(frozen=True)
class PairAffinities:
    """Pairs of detections (R) of two cameras in one frame, those worth a closer look, and their affinities.

    first, second (R,): rows of the table. distance (R,): see `RayPairs`. compared_frames (F,): the frames in which all
    detections were compared, so that people who were compared there and are not listed do not fit at all. scale:
    distance at which there is no evidence for or against one person.
    """

    first: np.ndarray
    second: np.ndarray
    distance: np.ndarray
    compared_frames: np.ndarray
    scale: float

    @property
    def gain(self) -> np.ndarray:
        """Score of each pair (R,): 1 for perfect agreement, 0 where nothing could be compared, -2 at least."""
        gain = np.maximum(1.0 - np.square(self.distance / self.scale), WORST)
        return np.where(np.isnan(gain), 0.0, gain)


def pair_affinities(table: Table, cameras: Sequence[Camera]) -> PairAffinities:
    """Compare every camera's detections with every other's, in evenly spread frames where there are very many."""
    compared_frames = _compared_frames(table, len(cameras))
    mirror = mirror_index(table.landmarks)
    near_pairs: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for a, b in combinations(range(len(cameras)), 2):
        pairs = RayPairs((cameras[a], cameras[b]), (table.rays[a], table.rays[b]), mirror)
        for i, j in _pairs(table, a, b, compared_frames):
            distance = pairs.distances(i, j, _FAR)
            near = ~np.isinf(distance)
            near_pairs.append((i[near] + table.first[a], j[near] + table.first[b], distance[near]))
    first, second, distance = (
        np.concatenate([f[k] for f in near_pairs]) if near_pairs else np.zeros(0) for k in range(3)
    )
    first, second = first.astype(np.int64), second.astype(np.int64)
    return PairAffinities(first, second, distance, compared_frames, _scale(table, first, second, distance))


def _scale(table: Table, first: np.ndarray, second: np.ndarray, distance: np.ndarray) -> float:
    """Usual distance of rays by detectors and calibration, from each detection's best partner in each other camera:
    most people are seen by two cameras, and a median tolerates the others."""
    best = np.full((len(table.people), len(table.rays)), np.inf)
    np.fmin.at(best, (first, table.camera[second]), distance)
    np.fmin.at(best, (second, table.camera[first]), distance)
    usual = float(np.median(best[np.isfinite(best)])) if np.isfinite(best).any() else FIT
    return float(np.clip(_SPREAD * usual, _SHARPEST, FIT))


def _compared_frames(table: Table, cameras: int) -> np.ndarray:
    frames, place = np.unique(table.instant, return_inverse=True)
    counts = np.zeros((cameras, len(frames)))
    np.add.at(counts, (table.camera, place), 1.0)
    pairs = (np.square(counts.sum(axis=0)) - np.square(counts).sum(axis=0)).sum() / 2.0
    return frames[:: max(1, int(np.ceil(pairs / _MOST_COMPARED)))]


def _pairs(table: Table, a: int, b: int, compared_frames: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Places of detections of cameras a and b that are of one frame, some frames at a time."""
    members = [_by_frame(table.instant[table.first[c] : table.first[c + 1]], compared_frames) for c in (a, b)]
    i: list[np.ndarray] = []
    j: list[np.ndarray] = []
    for ours, theirs in zip(*members, strict=True):
        i.append(np.repeat(ours, len(theirs)))
        j.append(np.tile(theirs, len(ours)))
        if sum(map(len, i)) > 500_000:
            yield np.concatenate(i), np.concatenate(j)
            i, j = [], []
    if i:
        yield np.concatenate(i), np.concatenate(j)


def _by_frame(frames: np.ndarray, compared_frames: np.ndarray) -> list[np.ndarray]:
    order = np.argsort(frames, kind="stable")
    low, high = (np.searchsorted(frames[order], compared_frames, side=side) for side in ("left", "right"))
    return [order[a:b] for a, b in zip(low.tolist(), high.tolist(), strict=True)]


def piece_affinities(table: Table, affinities: PairAffinities) -> np.ndarray:
    """Symmetric matrix (P, P): affinity of two pieces to be one person, in frames of perfect agreement."""
    count = int(table.piece.max(initial=-1)) + 1
    made = np.zeros((count, count))
    np.add.at(made, (table.piece[affinities.first], table.piece[affinities.second]), affinities.gain - WORST)
    made += made.T
    is_compared = np.isin(table.instant, affinities.compared_frames)
    for c in range(len(table.rays)):
        here = table.camera == c
        made -= _BESIDE * _together(table, here, count) + WORST * _together(table, here & is_compared, count)
    made += WORST * _together(table, is_compared, count)  # of two cameras, those of one camera being subtracted
    for link in table.links:
        made[link.first, link.second] += link.strength
        made[link.second, link.first] += link.strength
    np.fill_diagonal(made, 0.0)
    return made


def _together(table: Table, rows: np.ndarray, count: int) -> np.ndarray:
    """Number of pairs of detections of two pieces (P, P) in the same frame, among some rows of the table."""
    frames, place = np.unique(table.instant[rows], return_inverse=True)
    shape = (count, len(frames))
    seen = csr_array((np.ones(len(place)), (table.piece[rows], place)), shape=shape)
    return np.asarray((seen @ seen.T).toarray())


def median_distance(table: Table, affinities: PairAffinities, a: int, b: int) -> float:
    """Median over the frames that cameras a and b both have of the distance of their detections in body sizes; those
    not worth a closer look count as far. NaN without such frames."""
    a, b = min(a, b), max(a, b)
    ours, theirs = (table.instant[table.camera == c] for c in (a, b))
    common = np.intersect1d(np.intersect1d(ours, theirs), affinities.compared_frames)
    pair = (table.camera[affinities.first] == a) & (table.camera[affinities.second] == b)
    distance = np.full(len(common), _FAR)
    distance[np.searchsorted(common, table.instant[affinities.first[pair]])] = affinities.distance[pair]
    return float(np.nanmedian(distance)) if a != b and np.isfinite(distance).any() else np.nan
