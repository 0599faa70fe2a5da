"""Where the keypoints of a live picture come from: a detector, or a file that is played back."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from estimator.data.formats.keypoints import load_keypoints
from estimator.vision.resolution import Size, fitted_track
from kinemode.inputs.named import PathLike


class KeypointSource(Protocol):
    """Finds one person's keypoints. A function will do."""

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """Keypoints (K, 3), x, y [px] and confidence, in a picture (H, W, 3) uint8 BGR taken at a time [s]; None where
        nobody is seen."""
        ...


class PlayedBack:
    """The keypoints of a file, by time.

    path: of the file. picture: size [px] of the pictures that it is played beside. rate: frames per second of these,
    for a file that declares none.

    Attributes
    ----------
    names (K): landmark of each keypoint, None where none corresponds. notes: for the user.

    Raises
    ------
    InputError: as `estimator.data.formats.keypoints.load_keypoints`; keypoints of pictures of another aspect.
    """

    def __init__(self, path: PathLike, name: str, picture: Size, rate: float) -> None:
        track = load_keypoints(path)
        fitted, notes = fitted_track(name, track, track.image_size, picture)
        self.names, self.notes = fitted.names, (*track.notes, *notes)
        self._rate = track.fps or rate
        self._points = np.concatenate([fitted.pixels, fitted.confidence[..., None]], axis=2)

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """See `KeypointSource`: those of the frame nearest in time, None after the last."""
        frame = round(time * self._rate)
        return self._points[frame] if frame < len(self._points) else None
