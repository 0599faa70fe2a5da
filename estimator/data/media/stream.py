"""Pictures that come one by one, as a clip of which only the last few are there."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np

from estimator.data.media.clip import DEFAULT_FPS, Clip, ClipReport
from humanoid.support.errors import InputError

_KEPT = 2  # a cue reads a picture and the one before


class PictureStream(Clip):
    """A clip that has no end: pictures are put in, the last two can be read.

    name: what errors call it.
    """

    def __init__(self, name: str, image_size: tuple[int, int]) -> None:
        self.path, self.image_size = Path(name), image_size
        self.fps, self.frame_count, self.rate_known = DEFAULT_FPS, None, False
        self._latest: dict[int, np.ndarray] = {}

    def put(self, index: int, picture: np.ndarray) -> None:
        """Take the picture (H, W, 3) uint8 BGR of a frame, the one after the frame that was put in before."""
        self._latest = {**{i: p for i, p in self._latest.items() if i > index - _KEPT}, index: picture}

    def frame(self, index: int) -> np.ndarray:
        """See `Clip.frame`; IndexError also for a picture that is not kept any more."""
        if index not in self._latest:
            raise IndexError(f"{self.path} has no frame {index}")
        return self._latest[index]

    def frames(self, start: int = 0) -> Iterator[np.ndarray]:
        """Those that are there, see `Clip.frames`."""
        return (picture for index, picture in sorted(self._latest.items()) if index >= start)

    @cached_property
    def report(self) -> ClipReport:
        """There is none: raises InputError."""
        problem = "pictures that come one by one show no whole clip to learn a background or a floor from"
        raise InputError(str(self.path), problem, remedy="give a picture of the empty scene, or leave out that cue")
