"""Edge energy: contrast-normalised gradients (CSS 3.1.2)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from estimator.vision.cues.edges.gradient import block_means, normalised_gradient
from humanoid.support.settings import CheckedSettings, setting

_REDUCED = 4  # the local contrast changes slowly, so it is taken from a picture this many times smaller


@dataclass(frozen=True)
class EdgeSettings(CheckedSettings):
    """Settings of the detection of edges.

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
    window = cv2.getGaussianKernel(across, settings.smoothing, cv2.CV_32F)
    smooth = np.empty((3, *image_bgr.shape[:2]), np.float32)
    for channel, out in zip(cv2.split(image_bgr), smooth, strict=True):
        cv2.sepFilter2D(channel, cv2.CV_32F, window, window, dst=out)
    # Sobel's smoothing (variance 1/2) runs along the edge, its difference over two pixels (1/3) across it
    width = np.sqrt(settings.smoothing**2 + 1.0 / 3.0)
    noise = max(0.5, _noise(image_bgr)) / (2.0 * np.sqrt(np.pi) * settings.smoothing)
    variance, whole = _variance(smooth, settings.contrast_window)
    floor = settings.contrast_floor**2 * whole + (settings.noise_floor * noise) ** 2
    return EdgeMap(*normalised_gradient(smooth, variance, np.float32(floor), np.float32(width * np.sqrt(np.pi / 2.0))))


def _variance(smooth: np.ndarray, window: float) -> tuple[np.ndarray, float]:
    """Variance of the channel (C, H, W) that varies most, within a Gaussian window (H, W), and over the whole image."""
    height, width = smooth.shape[1:]
    mean, square = block_means(smooth, _REDUCED)
    whole = (square.mean(axis=(1, 2)) - mean.mean(axis=(1, 2)) ** 2).max()
    local = np.zeros(mean.shape[1:], np.float32)
    for of_mean, of_square in zip(mean, square, strict=True):
        m, s = (cv2.GaussianBlur(values, (0, 0), window / _REDUCED) for values in (of_mean, of_square))
        local = np.maximum(local, s - m * m)
    return np.asarray(cv2.resize(local, (width, height), interpolation=cv2.INTER_LINEAR)), max(0.0, float(whole))


def _noise(image: np.ndarray) -> float:
    """Standard deviation of the noise of the noisiest channel.

    The median size of a second difference that planes and edges along an axis do not show in (Immerkaer, CVIU 1996, who
    takes the mean), at every fourth pixel.
    """
    height, width = image.shape[:2]
    top, middle, bottom = (image[i : height - 2 + i : 4].astype(np.int16) for i in range(3))
    down = top - 2 * middle + bottom
    left, centre, right = (down[:, j : width - 2 + j : 4] for j in range(3))
    difference = np.abs(left - 2 * centre + right).reshape(-1, image.shape[2])
    if not len(difference):
        return 0.0
    # sorted, as whole numbers are faster than one of them is picked
    ranks = np.sort(np.ascontiguousarray(difference.T), axis=1)
    medians = 0.5 * (ranks[:, (len(difference) - 1) // 2] + ranks[:, len(difference) // 2])
    return float(medians.max()) / (0.6745 * 6.0)
