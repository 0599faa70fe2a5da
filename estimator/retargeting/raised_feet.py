"""Whether feet rest on a floor, or on something that the body lies lower than: a chair, a stool, nothing at all."""

from __future__ import annotations

import numpy as np

from estimator.retargeting.source import SourceMotion

_SIDES = ("left", "right")
_PARTS = ("hip", "knee", "shoulder", "elbow", "wrist")
_THIGH = 0.42  # m: of the adult whose lengths the others are
_HIPS = 0.05  # m: above a floor, the middle of the hips of who sits or lies on it is higher
_BELOW = 0.1  # m: under a floor, what is lower is not on it, whatever the noise
_SEVERAL = 3  # joints that far below
_MANY = 0.25  # share of the frames


def lies_below(source: SourceMotion, floor: float) -> bool:
    """Whether much of a body lies under a level floor [m] in many frames: its hips nearer to it than any that rest on
    one, or several joints of its limbs well below it.

    Hips of who sits or lies are 0.08 m above the floor and more; one hand that reaches over an edge is not much. The
    lengths are an adult's, and scaled by the thigh.
    """
    scale = _thigh(source) / _THIGH
    joints = _heights(source, [f"{side}_{part}" for side in _SIDES for part in _PARTS])
    hips = _heights(source, [f"{side}_hip" for side in _SIDES]).mean(axis=1)
    known = np.isfinite(joints).any(axis=1)
    if not known.any():
        return False
    low = (hips < floor + _HIPS * scale) | ((joints < floor - _BELOW * scale).sum(axis=1) >= _SEVERAL)
    return bool(low[known].mean() > _MANY)


def _heights(source: SourceMotion, names: list[str]) -> np.ndarray:
    """Of landmarks (T, L) [m], NaN where missing; those that the motion lacks are left out."""
    places = [source.names.index(name) for name in names if name in source.names]
    return source.points[:, places, 2] if places else np.full((len(source.times), 1), np.nan)


def _thigh(source: SourceMotion) -> float:
    """Length of a thigh [m] in the middle of all frames; an adult's where it is not known."""
    lengths = [
        np.linalg.norm(source.landmark(f"{side}_hip") - source.landmark(f"{side}_knee"), axis=1)
        for side in _SIDES
        if {f"{side}_hip", f"{side}_knee"} <= set(source.names)
    ]
    known = np.concatenate([length[np.isfinite(length)] for length in lengths]) if lengths else np.zeros(0)
    return float(np.median(known)) if len(known) else _THIGH
