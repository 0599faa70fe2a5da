"""Differences of an image from the empty scene, except shadows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from estimator.vision.cues.silhouette.shading import WINDOW, mark_brightness, mark_texture
from estimator.vision.mask_box import box_about
from humanoid.support.compiled import jit
from humanoid.support.settings import CheckedSettings, setting

_RIM = WINDOW + 4  # pixels across in which a shadow's outline is joined to it
_SHADED = 0.1  # change of brightness that makes shadow or light
_NOISE = 2.5  # smallest spread [grey values]: flicker, compression and rounding are never less
_UNEXPLAINED = 0.35  # share of the texture's variance that may differ where the background shows through


@dataclass(frozen=True)
class SilhouetteSettings(CheckedSettings):
    """Settings of the learning of the background and of the separation of the person from it.

    frames: number of a clip's frames that are used; each costs about 0.1 s once.
    still: motion from one to the next up to which a place counts as still [px, of a picture of 320 px].
    seen: share of the frames that must show a still colour for it to be background at first.
    rounds: how often persons are cut out of the frames and the background is learned again without them.
    threshold: difference from the background that makes foreground, in its standard deviations.
    shadow: darkest shadow, as a share of the background's brightness.
    smallest: foreground or holes below this share of the picture are specks.
    Raises InputError where a value is outside its range.
    """

    frames: int = setting(40, at_least=1)
    still: float = setting(0.25, above=0)
    seen: float = setting(0.15, above=0, below=1)
    rounds: int = setting(2, at_least=1)
    threshold: float = setting(5.0, above=0)
    shadow: float = setting(0.5, above=0, below=1)
    smallest: float = setting(0.0008, above=0, below=1)


@dataclass(frozen=True)
class Background:
    """The background of a fixed camera.

    mean, spread (H, W, 3) float32: of the BGR colours over time, grey values.
    known (H, W) bool: False where the scene was hardly ever seen.
    """

    mean: np.ndarray
    spread: np.ndarray
    known: np.ndarray

    @cached_property
    def scale(self) -> np.ndarray:
        """Inverse (H, W, 3) float32 of the spread, of no less than the noise."""
        return np.asarray(np.float32(1.0) / np.maximum(self.spread, np.float32(_NOISE)))

    @cached_property
    def grey(self) -> np.ndarray:
        """Brightness (H, W) float32 of the mean."""
        return np.asarray(cv2.cvtColor(self.mean, cv2.COLOR_BGR2GRAY))


@dataclass(frozen=True)
class Departure:
    """Difference of an image from a background; both arrays are neutral where the background is unknown.

    squared (H, W) float32: squared difference over the squared threshold; above 1 is foreground.
    shaded (H, W) bool: the background's own texture shows there, but brighter or darker.
    """

    squared: np.ndarray
    shaded: np.ndarray


def smoothed(image: np.ndarray) -> np.ndarray:
    """An image as backgrounds are learned and compared: with less noise."""
    return np.asarray(cv2.GaussianBlur(image, (3, 3), 0))


def departure(picture: np.ndarray, background: Background, settings: SilhouetteSettings) -> Departure:
    """Departure of a `smoothed` image (H, W, 3) uint8 from a background.

    Shadow keeps the background's colour and texture and loses brightness (Horprasert et al., FRAME-RATE 1999).
    The background itself may have been learned in shadow, so that light counts as shadow does.
    """
    limit = np.float32(settings.threshold**2)
    picture = np.ascontiguousarray(picture)
    squared = np.empty(picture.shape[:2], np.float32)
    _squared_difference(picture, background.mean, background.scale, squared)
    shaded = np.zeros(squared.shape, bool)
    box = box_about(squared > limit, _RIM)
    if shaded[box].size:
        shadow, shaded[box] = _shadow(picture[box], background, box, settings)
        np.minimum(squared[box], np.float32(0.5) * limit, out=squared[box], where=shadow)
    squared /= limit
    return Departure(squared, shaded)


@jit
def _squared_difference(picture, mean, scale, squared):  # type: ignore[no-untyped-def]
    """Squared difference of a picture (H, W, 3) uint8 from mean (H, W, 3) float32 in standard deviations, of which
    `scale` (H, W, 3) float32 is the inverse, summed over the channels; fills squared (H, W) float32."""
    height, width = squared.shape
    row = np.empty(3 * width, np.float32)
    for y in range(height):
        colours, expected, scales = picture[y].ravel(), mean[y].ravel(), scale[y].ravel()
        for i in range(3 * width):  # side by side, for the processor's vector units
            difference = (np.float32(colours[i]) - expected[i]) * scales[i]
            row[i] = difference * difference
        for x in range(width):
            squared[y, x] = row[3 * x] + row[3 * x + 1] + row[3 * x + 2]


def _shadow(
    picture: np.ndarray, background: Background, box: tuple[slice, slice], settings: SilhouetteSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Where the part of a picture in a box (H, W, 3) uint8 is the background at another brightness, and where texture
    proves it; (H, W) bool each."""
    possible, other, shows, textured = np.empty((4, *picture.shape[:2]), bool)
    mark_brightness(
        picture, background.mean[box], background.scale[box], np.float32(settings.shadow),
        np.float32(1.0 / settings.shadow), np.float32(settings.threshold**2), np.float32(_SHADED), possible, other,
    )  # fmt: skip
    grey = cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_BGR2GRAY)
    seen, expected = (_reflected(values) for values in (grey, background.grey[box]))
    noise = np.float32((1.5 * _NOISE) ** 2)
    mark_texture(seen, expected, noise, np.float32(_UNEXPLAINED), shows, textured)
    shadow = possible & shows
    shaded = shadow & other
    # the texture test fails along the shadow's own outline
    rim = cv2.dilate(shaded.view(np.uint8), np.ones((_RIM, _RIM), np.uint8)).view(bool)
    return shadow | (possible & rim), shaded & textured


def _reflected(values: np.ndarray) -> np.ndarray:
    """Values (H, W) with what a window about each of them sees beyond the border."""
    beyond = WINDOW // 2
    return np.asarray(cv2.copyMakeBorder(values, beyond, beyond, beyond, beyond, cv2.BORDER_REFLECT_101))
