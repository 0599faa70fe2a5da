"""Where a camera's depth comes from: another camera beside it, or files of a depth camera."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.depth.settings import DepthSettings
from estimator.vision.depth_map import DepthMap
from estimator.vision.stereo import StereoPair


class DepthSource(Protocol):
    """Depth of one camera's clip. camera: that the depth pictures are of."""

    camera: Camera

    def at(self, instant: int) -> DepthMap:
        """Of an instant."""
        ...


class FromStereo:
    """Depth from a clip and the one of the camera to its right; raises InputError as `StereoPair` does."""

    def __init__(self, left: CameraPictures, right: CameraPictures, settings: DepthSettings) -> None:
        self._left, self._right = left, right
        self._pair = StereoPair(left.camera, right.camera, settings)
        self.camera = self._pair.camera
        self._noise = float(self._pair.std(np.ones(())))

    def at(self, instant: int) -> DepthMap:
        """See `DepthSource`."""
        depth = self._pair.depth(self._left.picture(instant), self._right.picture(instant))
        return DepthMap(self.camera, depth, self._noise)


class FromFiles:
    """Depth from files beside a clip."""

    def __init__(self, pictures: CameraPictures, settings: DepthSettings) -> None:
        self._pictures, self._noise = pictures, settings.depth_noise
        self.camera = pictures.camera

    def at(self, instant: int) -> DepthMap:
        """See `DepthSource`."""
        depth = self._pictures.depth(instant)
        assert depth is not None
        return DepthMap(self.camera, depth, self._noise)


def depth_source(pictures: CameraPictures, settings: DepthSettings) -> DepthSource | None:
    """What there is for a camera; None where there is none."""
    if pictures.right is not None:
        return FromStereo(pictures, pictures.right, settings)
    return FromFiles(pictures, settings) if pictures.has_depth else None
