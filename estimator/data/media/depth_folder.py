"""Depth pictures as files: 16-bit PNG in millimetres, .npy in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.data.media.clip import listed, natural_order
from estimator.data.media.picture import read_numbers
from humanoid.support.errors import InputError

KINDS = {".png": 1e-3, ".npy": 1.0}
"""Metres of one unit, by ending."""
PLAUSIBLE = 0.3, 20.0  # m, of a picture's median: beyond it the unit is another one
_LOOKED_AT = 9  # pictures, spread over the clip, of which one has to have depth


class DepthFolder:
    """Depth pictures of one camera in natural order of their names, one for every frame of its clip.

    Parameters
    ----------
    path: the folder. image_size: width and height of the camera's pictures [px].

    Raises
    ------
    InputError: no such files or both kinds, another size, another unit, no depth in any of the checked pictures.
    """

    def __init__(self, path: str | Path, image_size: tuple[int, int]) -> None:
        self.path, self.image_size = Path(path), image_size
        self.files = sorted((p for p in listed(self.path) if p.suffix.lower() in KINDS), key=natural_order)
        kinds = {p.suffix.lower() for p in self.files}
        if len(kinds) != 1:
            problem = "has .png and .npy files" if kinds else "has no depth pictures"
            raise InputError(self.path, problem, remedy="16-bit .png in millimetres or .npy in metres")
        spread = np.unique(np.linspace(0, len(self.files) - 1, _LOOKED_AT).round().astype(int))
        if not any(np.isfinite(self.at(int(i))).any() for i in spread):
            raise InputError(self.path, "has no depth in any picture", remedy="0 and NaN mean unknown")

    def __len__(self) -> int:
        return len(self.files)

    def at(self, index: int) -> np.ndarray:
        """Depth (H, W) float32 along the optical axis [m] of a frame, NaN where it is unknown: 0, negative or not
        finite in the file, all of it where the folder ends before.

        Raises
        ------
        InputError: the file cannot be read, or is of another size or unit.
        """
        width, height = self.image_size
        if not 0 <= index < len(self.files):
            return np.full((height, width), np.nan, np.float32)
        path = self.files[index]
        raw = _read(path)
        if raw.shape != (height, width):
            size = " x ".join(map(str, raw.shape[::-1]))
            raise InputError(path, f"is {size}, not {width} x {height} as the camera's pictures")
        depth = raw.astype(np.float32) * np.float32(KINDS[path.suffix.lower()])
        depth[~(np.isfinite(depth) & (depth > 0.0))] = np.nan
        known = depth[np.isfinite(depth)]
        if len(known) and not PLAUSIBLE[0] <= (median := float(np.median(known))) <= PLAUSIBLE[1]:
            problem = f"has a median depth of {median:g} m, not {PLAUSIBLE[0]:g} to {PLAUSIBLE[1]:g}"
            raise InputError(path, problem, remedy="16-bit .png in millimetres or .npy in metres")
        return depth


def _read(path: Path) -> np.ndarray:
    """A file's numbers as they are."""
    if path.suffix.lower() == ".png":
        image = read_numbers(path)
        if image.dtype != np.uint16 or image.ndim != 2:
            bits, channels = 8 * image.dtype.itemsize, 1 if image.ndim == 2 else image.shape[2]
            raise InputError(path, f"has {channels} channels of {bits} bits", remedy="a picture of one, of 16 bits")
        return image
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(path, f"cannot be read: {error}", remedy="a plain array of metres") from None
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "fiu":
        raise InputError(path, "is not an array of numbers with rows and columns", remedy="a plain array of metres")
    return array
