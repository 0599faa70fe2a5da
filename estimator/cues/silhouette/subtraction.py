"""Where an image departs from the empty scene, shadows aside."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from humanoid.support.compiled import jit
from humanoid.support.settings import check, setting

_WINDOW = 7  # pixels across in which the texture of image and background is compared
_RIM = _WINDOW + 4  # pixels across in which a shadow's outline is joined to it
_SHADED = 0.1  # change of brightness that makes shadow or light
_NOISE = 2.5  # smallest spread [grey values]: flicker, compression and rounding are never less
_UNEXPLAINED = 0.35  # share of the texture's variance that may differ where the background shows through


@dataclass(frozen=True)
class SilhouetteSettings:
    """How the background is learned and the person told from it.

    frames: so many of a clip's frames are looked at; each costs about 0.1 s once.
    still: motion from one to the next up to which a place counts as still [px, of a picture of 320 px].
    seen: share of the frames a still colour must show in to be background at first.
    rounds: how often persons are cut out of the frames and the background is learned again without them.
    threshold: difference from the background that makes foreground, in its standard deviations.
    shadow: darkest shadow, as a share of the background's brightness.
    smallest: foreground or holes below this share of the picture are specks.
    Raises InputError where a value cannot be.
    """

    frames: int = setting(40, at_least=1)
    still: float = setting(0.25, above=0)
    seen: float = setting(0.15, above=0, below=1)
    rounds: int = setting(2, at_least=1)
    threshold: float = setting(5.0, above=0)
    shadow: float = setting(0.5, above=0, below=1)
    smallest: float = setting(0.0008, above=0, below=1)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Background:
    """What a fixed camera sees without people.

    mean, spread (H, W, 3) float32: of the BGR colours over time, grey values.
    known (H, W) bool: False where the scene was hardly ever seen.
    """

    mean: np.ndarray
    spread: np.ndarray
    known: np.ndarray


@dataclass(frozen=True)
class Departure:
    """How an image differs from a background; both say nothing where the background is unknown.

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
    squared = np.empty(picture.shape[:2], np.float32)
    _squared_difference(np.ascontiguousarray(picture), background.mean, background.spread, np.float32(_NOISE), squared)
    shaded = np.zeros(squared.shape, bool)
    x, y, width, height = cv2.boundingRect((squared > limit).view(np.uint8))
    if width:
        box = tuple(slice(max(0, start - _RIM), start + size + _RIM) for start, size in ((y, height), (x, width)))
        scale = np.float32(1.0) / np.maximum(background.spread[box], np.float32(_NOISE))
        shadow, shaded[box] = _shadow(picture[box].astype(np.float32), background.mean[box], scale, settings)
        squared[box] = np.where(shadow, np.minimum(squared[box], np.float32(0.5) * limit), squared[box])
    return Departure(squared / limit, shaded)


@jit
def _squared_difference(picture, mean, spread, least, squared):  # type: ignore[no-untyped-def]
    """Squared difference of a picture (H, W, 3) uint8 from mean (H, W, 3) float32 in standard deviations `spread`
    (H, W, 3) float32, at least `least`, summed over the channels; fills squared (H, W) float32."""
    height, width = squared.shape
    row = np.empty(3 * width, np.float32)
    for y in range(height):
        colours, expected, spreads = picture[y].ravel(), mean[y].ravel(), spread[y].ravel()
        for i in range(3 * width):  # side by side, for the processor's vector units
            difference = (np.float32(colours[i]) - expected[i]) * (np.float32(1.0) / max(spreads[i], least))
            row[i] = difference * difference
        for x in range(width):
            squared[y, x] = row[3 * x] + row[3 * x + 1] + row[3 * x + 2]


def _shadow(
    image: np.ndarray, mean: np.ndarray, scale: np.ndarray, settings: SilhouetteSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Where an image is the background at another brightness, and where texture proves it; (H, W) bool each.

    `scale` (H, W, 3) is the inverse of the spread.
    """
    seen, expected = image * scale, mean * scale
    power = np.maximum(_over_channels(expected * expected), np.float32(1e-6))
    ratio = _over_channels(seen * expected) / power
    off_colour = _over_channels((seen - ratio[..., None] * expected) ** 2)
    possible = (ratio > settings.shadow) & (ratio < 1.0 / settings.shadow) & (off_colour < settings.threshold**2)
    shows, textured = _texture(image, mean)
    shadow = possible & shows
    shaded = shadow & (np.abs(ratio - np.float32(1.0)) > _SHADED)
    # the texture test fails along the shadow's own outline
    rim = cv2.dilate(shaded.astype(np.uint8), np.ones((_RIM, _RIM), np.uint8)) > 0
    return shadow | (possible & rim), shaded & textured


def _over_channels(values: np.ndarray) -> np.ndarray:
    """Sum over the channels of (H, W, 3), (H, W)."""
    return np.asarray(cv2.transform(values, np.ones((1, 3), np.float32)))


def _texture(image: np.ndarray, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether the background's texture, brighter or darker, explains the image's; whether it has any. (H, W) bool."""
    seen, expected = (cv2.cvtColor(values, cv2.COLOR_BGR2GRAY) for values in (image, mean))

    def local(values: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.boxFilter(values, -1, (_WINDOW, _WINDOW)))

    a, b = local(seen), local(expected)
    gain = a / np.maximum(b, np.float32(1.0))
    texture = gain * gain * (local(expected * expected) - b * b)
    rest = local(seen * seen) - a * a - np.float32(2.0) * gain * (local(seen * expected) - a * b) + texture
    noise = np.float32((1.5 * _NOISE) ** 2)
    return rest < np.maximum(np.float32(_UNEXPLAINED) * texture, noise), texture > np.float32(4.0) * noise
