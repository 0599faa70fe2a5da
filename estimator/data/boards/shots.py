"""One camera's pictures of a board: a video, a folder, or picture files; and the corners found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from estimator.data.media.clip import IMAGE_SUFFIXES, Clip, FolderClip
from estimator.data.media.picture import read_picture
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class BoardSighting:
    """The board as a camera saw it.

    camera: its name. frame: number of the picture. label: the picture's name. pixels (N, 2): of the board's corners,
    NaN where one is not seen.
    """

    camera: str
    frame: int
    label: str
    pixels: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Which corners are seen, (N,)."""
        return np.isfinite(self.pixels[:, 0])


class Shots:
    """The pictures of one camera by number.

    paths: a video or a folder, or picture files in the order given. name: of the camera.

    Raises
    ------
    InputError: no pictures.
    """

    def __init__(self, name: str, paths: Sequence[Path]) -> None:
        self.name, self.paths = name, list(paths)
        alone = self.paths[0] if len(self.paths) == 1 else None
        if alone is not None and (alone.is_dir() or alone.suffix.lower() not in IMAGE_SUFFIXES):
            self._clip: Clip | None = Clip.open(alone)
        else:
            self._clip = None
            wrong = [p for p in self.paths if p.is_dir() or p.suffix.lower() not in IMAGE_SUFFIXES]
            if wrong:
                remedy = "one video or folder for each camera, NAME=PATH, or picture files of one"
                raise InputError(wrong[0], f"cannot go together with other pictures of {name!r}", remedy=remedy)

    @property
    def source(self) -> str:
        """What to call them in errors."""
        return str(self.paths[0]) if len(self.paths) == 1 else str(self.paths[0].parent)

    @cached_property
    def count(self) -> int:
        """How many there are."""
        if self._clip is None:
            return len(self.paths)
        return len(self._clip.files) if isinstance(self._clip, FolderClip) else self._clip.report.read

    @cached_property
    def image_size(self) -> tuple[int, int]:
        """Width and height [px]."""
        if self._clip is not None:
            return self._clip.image_size
        height, width = read_picture(self.paths[0])[0].shape[:2]
        return width, height

    def picture(self, index: int) -> np.ndarray:
        """A picture (H, W, 3) uint8 BGR; raises InputError where it is of another size than the first."""
        if self._clip is not None:
            return self._clip.frame(index)
        picture = read_picture(self.paths[index])[0]
        if picture.shape[1::-1] != self.image_size:
            sizes = "{} x {} pixels, the first {} x {}".format(*picture.shape[1::-1], *self.image_size)
            raise InputError(self.paths[index], f"is {sizes}", remedy="calibrate with pictures of one size")
        return picture

    def label(self, index: int) -> str:
        """What a picture is called."""
        if isinstance(self._clip, FolderClip):
            return self._clip.files[index].name
        return f"frame {index}" if self._clip is not None else self.paths[index].name

    def close(self) -> None:
        """Let go of the file."""
        if self._clip is not None:
            self._clip.close()
