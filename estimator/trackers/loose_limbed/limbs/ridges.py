"""Edges and ridges of any direction and several widths: derivatives of Gaussians, steered.

The first derivative in a direction n is n . g with the gradient g, the second n' H n with the Hessian H (Freeman and
Adelson, PAMI 13(9), 1991): five maps of a scale answer for all directions. Both are normalised by the scale, so that a
step and a bar of one contrast answer alike at every size (Lindeberg, IJCV 30(2), 1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.media.threads import one_thread

SCALES = (3.0, 4.7, 7.3, 11.5, 18.0)
"""Standard deviations of the Gaussians [px]: half the widths of limbs in pictures of 300 to 1000 px."""

_REACH = 3.5  # standard deviations after which a Gaussian is cut off
_FINEST = 3.0  # px of a reduced picture, that a Gaussian's standard deviation stays above


@dataclass(frozen=True, eq=False)
class Ridges:
    """Derivatives of one picture, smoothed by Gaussians of several sizes.

    scales (S,): standard deviations [px], rising. steps (S,) int: one value for so many pixels along each side. Each of
    `first` (S): (H / step, W / step, 2) float32, sigma times the derivatives by x and y [grey values]. Each of `second`
    (S): (H / step, W / step, 3) float32, sigma squared times those by xx, xy and yy.
    """

    scales: np.ndarray
    steps: np.ndarray
    first: tuple[np.ndarray, ...]
    second: tuple[np.ndarray, ...]

    def edge(self, scale: int, pixels: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """First derivative (N,) across a line at `angle` (N,) [rad], which goes from x to y, at pixels (N, 2)."""
        at = self._at(scale, self.first[scale], pixels)
        return np.asarray(at[:, 1] * np.cos(angle) - at[:, 0] * np.sin(angle))

    def ridge(self, scale: int, pixels: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Ridge response (N,): how much more the grey values curve across a line at `angle` (N,) [rad] than along it,
        dark or bright: Sidenbladh and Black, IJCV 54, 2003, section 3.2. pixels (N, 2)."""
        xx, xy, yy = self._at(scale, self.second[scale], pixels).T
        c, s = np.cos(angle), np.sin(angle)
        across = s * s * xx - 2.0 * s * c * xy + c * c * yy
        along = c * c * xx + 2.0 * s * c * xy + s * s * yy
        return np.asarray(np.abs(across) - np.abs(along))

    def _at(self, scale: int, values: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """The nearest values (N, C) of a map; of the border beyond it."""
        x, y = np.floor((pixels.T + 0.5) / self.steps[scale]).astype(int)
        return np.asarray(values[y.clip(0, len(values) - 1), x.clip(0, values.shape[1] - 1)], dtype=float)


@one_thread()
def ridges_of(picture: np.ndarray, scales: tuple[float, ...] = SCALES) -> Ridges:
    """Derivatives of a picture (H, W, 3) uint8 BGR, or (H, W) grey, at scales [px], rising, each at least 3.

    Large scales are computed from reduced pictures: smoothing by 12 px loses nothing with every fourth pixel.
    """
    grey = (picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)).astype(np.float32)
    steps = [2 ** int(np.log2(max(1.0, sigma / _FINEST))) for sigma in scales]
    maps = [_derivatives(_reduced(grey, step), sigma, step) for sigma, step in zip(scales, steps, strict=True)]
    first, second = zip(*maps, strict=True)
    return Ridges(np.array(scales), np.array(steps), first, second)


def _reduced(grey: np.ndarray, step: int) -> np.ndarray:
    if step == 1:
        return grey
    height, width = grey.shape
    return np.asarray(cv2.resize(grey, (max(1, width // step), max(1, height // step)), interpolation=cv2.INTER_AREA))


def _derivatives(grey: np.ndarray, sigma: float, step: int) -> tuple[np.ndarray, np.ndarray]:
    """sigma D and sigma^2 DD of a reduced picture; the mean over `step` pixels is part of the smoothing."""
    own = float(np.sqrt((sigma / step) ** 2 - (1.0 - step**-2) / 12.0))
    half = int(np.ceil(_REACH * own))
    x = np.arange(-half, half + 1, dtype=float)
    bell = np.exp(-0.5 * np.square(x / own))
    bell /= bell.sum()
    slope = x * bell  # cv2 correlates: no sign turns
    slope /= (slope * x).sum()
    bend = (np.square(x / own) - 1.0) * bell
    bend -= bell * bend.sum()  # a constant has no curvature
    bend /= 0.5 * (bend * x * x).sum()

    def filtered(along_x: np.ndarray, along_y: np.ndarray, order: int) -> np.ndarray:
        answer = cv2.sepFilter2D(grey, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(answer * np.float32((sigma / step) ** order))

    first = np.stack([filtered(slope, bell, 1), filtered(bell, slope, 1)], axis=-1)
    second = [filtered(bend, bell, 2), filtered(slope, slope, 2), filtered(bell, bend, 2)]
    return first, np.stack(second, axis=-1)
