"""The part of the person in the pictures that no limb of a pose covers, where a limb may be that was confused with
another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from estimator.trackers.loose_limbed.limbs.features import PERSON, UNKNOWN
from estimator.trackers.loose_limbed.limbs.likelihood import LimbView
from humanoid.limbs.limb import Limb

_EVERY = 8  # one pixel in so many is used: limbs are wider
_WIDER, _MORE = 1.15, 0.015  # of a limb's semi-axes, and m more: a cone is not the flesh, nor a pose quite the person's
_AROUND = np.linspace(0.0, 2.0 * np.pi, 10, endpoint=False)
_FARTHEST = 1e4  # px from the picture, beyond which a limb covers nothing
_SHIFT = 4  # bits of a pixel's fraction


class LeftOver:
    """The views of one instant, against which poses of some limbs are held.

    limbs: of a limb graph. views: with foreground maps.
    """

    def __init__(self, limbs: Sequence[Limb], views: Sequence[LimbView]) -> None:
        self._corners = [_corners(limb) for limb in limbs]
        self._views, middle = views, _EVERY // 2
        self._person = [view.foreground[middle::_EVERY, middle::_EVERY] == PERSON for view in views]

    def share(self, t: np.ndarray, R: np.ndarray) -> float:
        """Share of the person's pixels that no limb covers, at t (L, 3) [m], R (L, 3, 3): the sum over the views."""
        left = zip(self._person, self._covered(t, R), strict=True)
        return sum(float((person & ~covered).sum()) / max(1, int(person.sum())) for person, covered in left)

    def views(self, t: np.ndarray, R: np.ndarray) -> list[LimbView]:
        """The views, unknown where limbs at t (L, 3) [m], R (L, 3, 3) cover the person."""
        views = []
        for view, covered in zip(self._views, self._covered(t, R), strict=True):
            height, width = view.foreground.shape
            full = np.kron(covered, np.ones((_EVERY, _EVERY), bool))
            full = np.pad(full, ((0, max(0, height - len(full))), (0, max(0, width - full.shape[1]))), "edge")
            hidden = full[:height, :width] & (view.foreground == PERSON)
            views.append(replace(view, foreground=np.where(hidden, np.uint8(UNKNOWN), view.foreground)))
        return views

    def _covered(self, t: np.ndarray, R: np.ndarray) -> list[np.ndarray]:
        """For each view the pixels that limbs cover, (h, w) bool."""
        return [self._in_view(view, seen.shape, t, R) for view, seen in zip(self._views, self._person, strict=True)]

    def _in_view(self, view: LimbView, shape: tuple[int, ...], t: np.ndarray, R: np.ndarray) -> np.ndarray:
        covered = np.zeros(shape, np.uint8)
        for corners, place, turn in zip(self._corners, t, R, strict=True):
            pixels = view.camera.project(corners @ turn.T + place)
            if np.isfinite(pixels).all() and np.abs(pixels).max() < _FARTHEST:
                scaled = np.round((pixels + 0.5) / _EVERY * 2.0**_SHIFT - 0.5 * 2.0**_SHIFT).astype(np.int32)
                cv2.fillConvexPoly(covered, cv2.convexHull(scaled), 1, shift=_SHIFT)
        return covered > 0


def _corners(limb: Limb) -> np.ndarray:
    """Points (20, 3) [m] around both ends of a limb's cone, whose outline is theirs."""
    rings = []
    for z, semi in ((limb.start, limb.proximal), (limb.end, limb.distal)):
        a, b = _WIDER * np.asarray(semi, dtype=float) + _MORE
        rings.append(np.stack([a * np.cos(_AROUND), b * np.sin(_AROUND), np.full(len(_AROUND), z)], axis=1))
    return np.concatenate(rings)
