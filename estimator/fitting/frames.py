"""The frames of a clip that a person is fitted from: pieces of it whose poses differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.lifted import with_shares
from estimator.data.observation import Observation, image_extent
from estimator.fitting.settings import FitSettings

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
