"""Arrays of single frames, some of them missing or smaller than others, as one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from humanoid.support.errors import InputError

_MOST = 50_000_000  # entries that are filled up


def stacked(frames: Sequence[np.ndarray | None], source: Path, name: str) -> np.ndarray:
    """Arrays of T frames as one (T, ...), of which one at least is there.

    What a frame lacks is NaN, and numbers and booleans become floats for it, or empty where they are text.

    Raises
    ------
    InputError: some have more axes than others, or are text and others are not; or most of many entries would be
        filling. source, name: whose they are, for what is said.
    """
    there = [a for a in frames if a is not None]
    text = {a.dtype.kind == "U" for a in there}
    if len({a.ndim for a in there}) > 1 or len(text) > 1:
        raise InputError(source, "is of different kinds in different frames", place=name, remedy="take frames singly")
    if len(there) == len(frames) and len({a.shape for a in there}) == 1:
        return np.stack(there)
    width = max(a.dtype.itemsize // 4 for a in there) if text == {True} else 1
    shape = (len(frames), *np.max([a.shape for a in there], axis=0, initial=0).astype(int).tolist())
    if np.prod(shape, dtype=float) * width > _MOST:
        raise InputError(source, f"would fill {shape} entries", place=name, remedy="take frames singly")
    out = np.full(shape, "", dtype=f"U{max(width, 1)}") if text == {True} else np.full(shape, np.nan)
    for t, array in enumerate(frames):
        if array is not None:
            filled = out[t : t + 1]
            filled[(slice(None), *map(slice, array.shape))] = array
    return out
