"""Edge energy: contrast-normalised gradients (CSS 3.1.2)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.media.threads import length, one_thread
from humanoid.support.settings import check, setting

_REDUCED = 4  # the local contrast changes slowly, so it is taken from a picture this many times smaller


@dataclass(frozen=True)
class EdgeSettings:
    """How edges are found.

    smoothing: standard deviation of the Gaussian the image is smoothed with [px].
    contrast_window: standard deviation of the Gaussian window in which the local contrast is measured [px].
    contrast_floor: contrast, as a share of the whole image's, at which an edge counts half in energy.
    noise_floor: the same as a multiple of the noise that smoothing leaves, which is at least half a grey value.
    Raises InputError where a value is not positive.
    """

    smoothing: float = setting(1.5, above=0)
    contrast_window: float = setting(14.0, above=0)
    contrast_floor: float = setting(0.25, above=0)
    noise_floor: float = setting(6.0, above=0)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class EdgeMap:
    """Edges of one image.

    strength (H, W) float32: 0 to 1; 1 at a lone straight step between two even areas, however small the step.
    direction (H, W, 2) float32: unit gradient direction (x, y), towards the brighter side; zero where strength is 0.
    """

    strength: np.ndarray
    direction: np.ndarray


@one_thread()
def edge_map(image_bgr: np.ndarray, settings: EdgeSettings) -> EdgeMap:
    """Edges of an image (H, W, 3) uint8: smoothed, normalised by the local contrast, Sobel (CSS 3.1.2).

    Each pixel uses the colour channel with the largest gradient. Contrast is the standard deviation within the window.
    A step of height h, smoothed by s, has the slope h / (s sqrt(2 pi)) and the contrast h / 2, which sets the scale.
    """
    across = 2 * int(np.ceil(3.0 * settings.smoothing)) + 1
    smooth = cv2.GaussianBlur(image_bgr.astype(np.float32), (across, across), settings.smoothing)
    dx, dy, magnitude = _steepest(smooth)
    # Sobel's smoothing (variance 1/2) runs along the edge, its difference over two pixels (1/3) across it
    width = np.sqrt(settings.smoothing**2 + 1.0 / 3.0)
    noise = max(0.5, _noise(image_bgr)) / (2.0 * np.sqrt(np.pi) * settings.smoothing)
    variance, whole = _variance(smooth, settings.contrast_window)
    floor = settings.contrast_floor**2 * whole + (settings.noise_floor * noise) ** 2
    contrast = np.sqrt(variance + np.float32(floor))
    strength = np.minimum(magnitude * np.float32(width * np.sqrt(np.pi / 2.0)) / contrast, np.float32(1.0))
    unit = np.float32(1.0) / np.maximum(magnitude, np.float32(1e-12))
    return EdgeMap(strength, cv2.merge([dx * unit, dy * unit]))


def _steepest(smooth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives along x and y [1/px] of the channel with the largest gradient, and its size; (H, W) each."""
    dx, dy = (cv2.split(cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.125)) for order in ((1, 0), (0, 1)))
    best_x, best_y, best = dx[0], dy[0], length(dx[0], dy[0])
    for x, y in zip(dx[1:], dy[1:], strict=True):
        size = length(x, y)
        steeper = (size > best).astype(np.uint8)
        best_x, best_y, best = cv2.copyTo(x, steeper, best_x), cv2.copyTo(y, steeper, best_y), cv2.max(size, best)
    return best_x, best_y, best


def _variance(smooth: np.ndarray, window: float) -> tuple[np.ndarray, float]:
    """Variance of the channel that varies most, within a Gaussian window (H, W), and over the whole image."""
    height, width = smooth.shape[:2]
    small = (max(1, width // _REDUCED), max(1, height // _REDUCED))
    mean, square = (cv2.resize(values, small, interpolation=cv2.INTER_AREA) for values in (smooth, smooth * smooth))
    whole = (square.mean(axis=(0, 1)) - mean.mean(axis=(0, 1)) ** 2).max()
    mean, square = (cv2.GaussianBlur(values, (0, 0), window / _REDUCED) for values in (mean, square))
    local = np.maximum(square - mean * mean, np.float32(0.0)).max(axis=-1)
    return np.asarray(cv2.resize(local, (width, height), interpolation=cv2.INTER_LINEAR)), max(0.0, float(whole))


def _noise(image: np.ndarray) -> float:
    """Standard deviation of the noise of the noisiest channel.

    The median size of a second difference that planes and edges along an axis do not show in (Immerkaer, CVIU 1996, who
    takes the mean), at every fourth pixel.
    """
    at = image.astype(np.int16)
    rows = [at[i : image.shape[0] - 2 + i : 4] for i in range(3)]
    across = [row[:, :-2:4] - 2 * row[:, 1:-1:4] + row[:, 2::4] for row in rows]
    difference = np.abs(across[0] - 2 * across[1] + across[2])
    return float(np.median(difference, axis=(0, 1)).max()) / (0.6745 * 6.0) if difference.size else 0.0
