"""Differences of an image from the empty scene, except shadows and changes of brightness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from estimator.vision.mask_box import box_about
from humanoid.support.compiled import jit
from humanoid.support.settings import CheckedSettings, setting

WINDOW = 7  # pixels across in which the texture of image and background is compared


@jit
def mark_brightness(picture, mean, scale, darkest, brightest, most, least, possible, other):  # type: ignore[no-untyped-def]
    """Mark where a picture (H, W, 3) uint8 has the background's colour, and where at another brightness.

    mean, scale (H, W, 3) float32: the background's colours and the inverse of their spread. darkest, brightest: shares
    of the background's brightness that it may have there. most: squared difference of colour, in standard deviations.
    least: change of brightness that counts. All float32. Fills possible, other (H, W) bool.
    """
    height, width = possible.shape
    whole, tiny = np.float32(1.0), np.float32(1e-6)
    seen, expected = np.empty(3 * width, np.float32), np.empty(3 * width, np.float32)
    for y in range(height):
        colours, means, scales = picture[y].ravel(), mean[y].ravel(), scale[y].ravel()
        for i in range(3 * width):  # side by side, for the processor's vector units
            seen[i], expected[i] = np.float32(colours[i]) * scales[i], means[i] * scales[i]
        for x in range(width):
            b, g, r = expected[3 * x], expected[3 * x + 1], expected[3 * x + 2]
            in_b, in_g, in_r = seen[3 * x], seen[3 * x + 1], seen[3 * x + 2]
            ratio = (in_b * b + in_g * g + in_r * r) / max(b * b + g * g + r * r, tiny)
            off_b, off_g, off_r = in_b - ratio * b, in_g - ratio * g, in_r - ratio * r
            off = off_b * off_b + off_g * off_g + off_r * off_r
            possible[y, x] = (ratio > darkest) & (ratio < brightest) & (off < most)
            other[y, x] = abs(ratio - whole) > least


@jit
def mark_texture(seen, expected, noise, unexplained, shows, textured):  # type: ignore[no-untyped-def]
    """Mark where the background's texture, brighter or darker, explains the picture's, and where it has any.

    seen, expected (H + WINDOW - 1, W + WINDOW - 1) float32: brightness of picture and background, with what the windows
    see beyond the border. noise (float32): variance that counts as none. unexplained (float32):
    share of the texture's variance that may differ. Fills shows, textured (H, W) bool.
    """
    height, width = shows.shape
    across = width + WINDOW - 1
    sums = np.zeros((5, across))  # down each column of the window
    totals = np.empty((5, width), np.float32)
    whole, two, four = np.float32(1.0), np.float32(2.0), np.float32(4.0)
    for y in range(height + WINDOW - 1):
        _count(seen[y], expected[y], 1.0, sums)
        if y < WINDOW - 1:
            continue
        for k in range(5):
            _windows(sums[k], totals[k])
        top = y - WINDOW + 1
        a_mean, b_mean, a_square, b_square, product = totals[0], totals[1], totals[2], totals[3], totals[4]
        explained, any_texture = shows[top], textured[top]
        for x in range(width):
            a, b = a_mean[x], b_mean[x]
            gain = a / max(b, whole)
            texture = gain * gain * (b_square[x] - b * b)
            rest = a_square[x] - a * a - two * gain * (product[x] - a * b) + texture
            explained[x] = rest < max(unexplained * texture, noise)
            any_texture[x] = texture > four * noise
        _count(seen[top], expected[top], -1.0, sums)


@jit
def _count(seen, expected, sign, sums):  # type: ignore[no-untyped-def]
    """Add a row of two pictures, seen and expected (W,), of their squares and product to sums (5, W), or with sign -1
    take it away. Squares have the precision of the pictures, so that in sums of float64 nothing is lost."""
    for x in range(len(seen)):
        a, b = seen[x], expected[x]
        sums[0, x] += sign * a
        sums[1, x] += sign * b
        sums[2, x] += sign * (a * a)
        sums[3, x] += sign * (b * b)
        sums[4, x] += sign * (a * b)


@jit
def _windows(sums, totals):  # type: ignore[no-untyped-def]
    """Fill totals (W,) float32 with the means of windows, of the sums (W + WINDOW - 1,) down their columns."""
    width = len(totals)
    share = 1.0 / (WINDOW * WINDOW)
    s0, s1, s2, s3 = sums[:width], sums[1 : 1 + width], sums[2 : 2 + width], sums[3 : 3 + width]
    s4, s5, s6 = sums[4 : 4 + width], sums[5 : 5 + width], sums[6 : 6 + width]
    for x in range(width):  # written out, for the processor's vector units
        totals[x] = (s0[x] + s1[x] + s2[x] + s3[x] + s4[x] + s5[x] + s6[x]) * share


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
