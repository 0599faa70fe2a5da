"""Which landmarks of two sides are compared, and what of them is aligned first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMB_JOINTS = tuple(f"{side}_{part}" for part in _PARTS for side in ("left", "right"))
HIPS = ("left_hip", "right_hip")
FEWEST = 3  # fewer points do not fix a rotation
HIPS_ALIGNED, CENTRED, UNALIGNED = "hips aligned", "centred", "nothing aligned"


class SharedLandmarks(NamedTuple):
    """Landmarks that are compared. ours, theirs (L): their places on either side. root: places among the L of those
    whose midpoint is moved to the origin, None for none. aligned: the same in words."""

    names: tuple[str, ...]
    ours: list[int]
    theirs: list[int]
    root: list[int] | None
    aligned: str


def shared_landmarks(
    ours: Sequence[str], theirs: Sequence[str], joints: Sequence[str] | None = None
) -> SharedLandmarks:
    """The landmarks that are compared of those that both sides have: a person's twelve limb joints, so that figures of
    people are comparable, or all of them where fewer than three are limb joints. joints: these instead.

    Hips are aligned where both are among them; otherwise the mean of all, and with fewer than three nothing.
    """
    both = [name for name in ours if name in theirs]
    limbs = [name for name in (LIMB_JOINTS if joints is None else joints) if name in both]
    names = tuple(limbs if joints is not None or len(limbs) >= FEWEST else both)
    at_ours, at_theirs = ([list(have).index(name) for name in names] for have in (ours, theirs))
    root, aligned = _root(names)
    return SharedLandmarks(names, at_ours, at_theirs, root, aligned)


def _root(names: Sequence[str]) -> tuple[list[int] | None, str]:
    if set(HIPS) <= set(names):
        return [names.index(hip) for hip in HIPS], HIPS_ALIGNED
    return (list(range(len(names))), CENTRED) if len(names) >= FEWEST else (None, UNALIGNED)
