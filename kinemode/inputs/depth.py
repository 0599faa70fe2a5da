"""Where depth is from: pairs of cameras side by side, and folders of depth pictures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.media.depth_folder import DepthFolder
from estimator.data.timing import CameraClock, Timeline
from humanoid.support.errors import InputError
from kinemode.named import named_pairs

if TYPE_CHECKING:
    from kinemode.request import Pairs


OPTION = "--stereo"
_TOGETHER = 0.1  # of a frame, by how much two pictures that were taken together may be apart


def pairs_of(given: Pairs, cameras: Collection[str]) -> dict[str, str]:
    """The camera on the right of each camera on the left: from `LEFT=RIGHT` texts or a mapping.

    Raises
    ------
    InputError: no pair, an unknown camera, a camera paired with itself, a left one in two pairs.
    """
    pairs: dict[str, str] = {}
    for left, right in named_pairs(given):
        if left is None:
            raise InputError(f"{OPTION} {right}", "is no pair of cameras", remedy="write LEFT=RIGHT")
        place = f"{OPTION} {left}={right}"
        for name in (left, right):
            if name not in cameras:
                remedy = f"cameras with clips: {', '.join(cameras) or 'none'}"
                raise InputError(place, f"there is no camera {name!r}", remedy=remedy)
        if left == right or left in pairs:
            problem = "is one camera twice" if left == right else f"{left} makes a pair with {pairs[left]} too"
            raise InputError(place, problem, remedy="write LEFT=RIGHT")
        pairs[left] = right
    return pairs


def check_together(pairs: Mapping[str, str], clocks: Mapping[str, CameraClock], line: Timeline) -> None:
    """Raise InputError for a pair whose pictures at an instant were not taken together: depth would be wrong."""
    for left, right in pairs.items():
        a, b = (clocks[name].offset + clocks[name].frames[line.frames[name]] for name in (left, right))
        apart, frame = float(np.abs(a - b).max(initial=0.0)), 1.0 / max(clocks[left].rate, clocks[right].rate)
        if apart > _TOGETHER * frame:
            problem = f"their pictures are up to {1e3 * apart:.0f} ms apart"
            remedy = "a pair that is synchronous, or --offset where only the clips' beginnings differ"
            raise InputError(f"{OPTION} {left}={right}", problem, remedy=remedy)


def check_depths(path: Path, image_size: tuple[int, int], count: int) -> None:
    """Raise InputError for a folder that ends before the clip's `count` frames, or as `DepthFolder` does: found before
    an hour of work, not after."""
    folder = DepthFolder(path, image_size)
    if len(folder) < count:
        raise InputError(path, f"has depth pictures of {len(folder)} frames, the clip has {count}")
