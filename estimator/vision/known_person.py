"""Where a person is in the pictures of a clip, from keypoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.limbs import Limbs, limbs_of
from estimator.vision.resolution import resized_pixels
from humanoid.kinematics.body import Body

_FEWEST = 3  # keypoints; fewer do not locate a body


@dataclass(frozen=True, eq=False)
class KnownPerson:
    """Where a person is, from the keypoints of one camera.

    limbs: of the body. pixels (T, L, 2) [px], seen (T, L) bool: its landmarks at every instant. image_size: of the
    pictures that the keypoints are of.
    """

    limbs: Limbs
    pixels: np.ndarray
    seen: np.ndarray
    image_size: tuple[int, int]

    @cached_property
    def instants(self) -> np.ndarray:
        """The instants (K,) with enough keypoints."""
        sufficient = [
            seen.sum() >= _FEWEST and self.limbs.scale(pixels, seen) > 0.0
            for pixels, seen in zip(self.pixels, self.seen, strict=True)
        ]
        return np.flatnonzero(sufficient)

    def mask(self, instant: int, size: tuple[int, int], width: float) -> np.ndarray:
        """Mask (H, W) bool of the body in a picture of `size` (width, height), at `width` times its own width."""
        pixels = resized_pixels(self.pixels[instant], self.image_size, size)
        return self.limbs.mask(pixels, self.seen[instant], size, width)


def known_persons(
    body: Body, cameras: Sequence[Camera], pixels: np.ndarray, confidence: np.ndarray
) -> list[KnownPerson]:
    """Where the person is by the keypoints, for every camera.

    body: of any proportions; only the widths of its parts beside their lengths count. pixels (T, C, L, 2) [px],
    confidence (T, C, L): of its landmarks, 0 where they are missing.

    Raises
    ------
    InputError: the body has no surface.
    """
    limbs = limbs_of(body)
    return [
        KnownPerson(limbs, pixels[:, c], confidence[:, c] > 0.0, camera.image_size) for c, camera in enumerate(cameras)
    ]
