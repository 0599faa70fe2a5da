"""Edges as a cue: energy by contrast-normalised gradients (CSS section 3.1.2), matched along the normals of the body's
contours (eq. 8).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from estimator.numerics.robust import LECLERC
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import Assignments, nothing
from estimator.vision.cues.base import CameraView, ContourMatch, Cue, ExplainedPose, Matcher
from estimator.vision.cues.cue_picture import CONTOUR_LEGEND, CuePicture, contour_dots, links
from estimator.vision.cues.edge_matching import edge_assignments
from estimator.vision.prediction import Prediction
from humanoid.support.compiled import jit
from humanoid.support.settings import CheckedSettings, setting


@jit
def normalised_gradient(planes, variance, floor, scale):  # type: ignore[no-untyped-def]
    """Strength (H, W) and direction (H, W, 2) of edges, both float32, see
    `EdgeMap`.

    planes (C, H, W) float32: the channels, which are reflected at the border. variance (H, W) float32: local contrast,
    squared, to which `floor` (float32) is added. scale (float32): strength of the slope 1 at the contrast 1.
    Sobel's derivatives [1/px]; each pixel has those of the channel in which they are largest.
    """
    height, width = variance.shape
    strength, direction = np.empty((height, width), np.float32), np.empty((height, width, 2), np.float32)
    best, best_x, best_y = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    down, level = np.empty(width, np.float32), np.empty(width, np.float32)
    zero, two, eighth, whole = np.float32(0.0), np.float32(2.0), np.float32(0.125), np.float32(1.0)
    least = np.float32(1e-24)
    for y in range(height):
        for c in range(planes.shape[0]):
            channel = planes[c]
            above, here = channel[y - 1 if y > 0 else min(1, height - 1)], channel[y]
            below = channel[y + 1 if y < height - 1 else max(0, height - 2)]
            for x in range(width):
                down[x] = below[x] - above[x]
                level[x] = above[x] + two * here[x] + below[x]
            for x in (0, width - 1):
                beside = down[min(1, width - 1)] if x == 0 else down[max(0, width - 2)]
                dy = two * (down[x] + beside)
                take = (c == 0) | (dy * dy > best[x])
                best[x], best_x[x], best_y[x] = (dy * dy, zero, dy) if take else (best[x], best_x[x], best_y[x])
            # slices, so that no index can be negative and the loop can do several pixels at once
            left, right, d0, d1, d2 = level[:-2], level[2:], down[:-2], down[1:-1], down[2:]
            most, most_x, most_y = best[1:-1], best_x[1:-1], best_y[1:-1]
            for x in range(width - 2):
                dx = right[x] - left[x]
                dy = d0[x] + two * d1[x] + d2[x]
                square = dx * dx + dy * dy
                steeper = (c == 0) | (square > most[x])
                most[x] = square if steeper else most[x]
                most_x[x] = dx if steeper else most_x[x]
                most_y[x] = dy if steeper else most_y[x]
        local, strong, towards = variance[y], strength[y], direction[y]
        for x in range(width):
            size = math.sqrt(best[x])
            strong[x] = min(scale * eighth * size / math.sqrt(local[x] + floor), whole)
            unit = whole / math.sqrt(max(best[x], least))
            towards[x, 0], towards[x, 1] = best_x[x] * unit, best_y[x] * unit
    return strength, direction


@jit
def block_means(planes, side):  # type: ignore[no-untyped-def]
    """Means of planes (C, H, W) float32, and of their squares, in square blocks of `side` pixels: (C, H // side,
    W // side) float32 each, at least one block; what is left over at the right and below is left out."""
    channels, height, width = planes.shape
    rows, columns = max(1, height // side), max(1, width // side)
    tall, wide = height // rows, width // columns
    mean, square = np.empty((channels, rows, columns), np.float32), np.empty((channels, rows, columns), np.float32)
    total, squares = np.empty(width, np.float32), np.empty(width, np.float32)
    share = np.float32(1.0 / (tall * wide))
    for c in range(channels):
        for row in range(rows):
            total[:] = np.float32(0.0)
            squares[:] = np.float32(0.0)
            for y in range(row * tall, (row + 1) * tall):
                line = planes[c, y]
                for x in range(width):
                    total[x] += line[x]
                    squares[x] += line[x] * line[x]
            for column in range(columns):
                first, second = np.float32(0.0), np.float32(0.0)
                for x in range(column * wide, (column + 1) * wide):
                    first += total[x]
                    second += squares[x]
                mean[c, row, column], square[c, row, column] = share * first, share * second
    return mean, square


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


@dataclass(frozen=True)
class EdgeCueSettings(EdgeSettings):
    """Settings of edges: their detection, and their part in the energy.

    evidence: independent measurements that all contour points together count as, 0 for none. noise: standard deviation,
        as a fraction of the subject's extent. window: how far along the normal edges are searched for, in extents.
        candidates: how many are kept (CSS eq. 8). nu: Leclerc spread.
    motion_boundary: k of W = 1 - k S_p, 0.2 to 0.4 in CSS; where there is flow.
    """

    evidence: float = setting(40.0, at_least=0)
    noise: float = setting(0.02, above=0)
    window: float = setting(0.12, above=0)
    candidates: int = setting(4, at_least=1)
    nu: float = setting(6.0, above=0)
    motion_boundary: float = setting(0.3, at_least=0, at_most=1)


_NONE = np.zeros((0, 0), dtype=np.float32)


class Edges(Cue):
    """Edges along the body's contours."""

    name = "edges"
    summary = "image edges along the contours of the body (CSS section 3.1.2)"
    settings = EdgeCueSettings()
    on_contours = True

    def read(self, pictures: CameraPictures, instant: int, settings: EdgeSettings, prepared: Any) -> EdgeMap:
        """See `Cue.read`."""
        return edge_map(pictures.picture(instant), settings)

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return EdgeMatcher(view)


class EdgeMatcher(Matcher):
    """Edges of one image. Motion boundaries of the flow and the silhouette's outline, where there are any, select those
    that can be the body's."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: EdgeCueSettings = view.settings
        self._edges: EdgeMap = view.cues[Edges.name]

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """Edges along the contours' normals (CSS eq. 8), and the energy of contour points without any."""
        s, view, edges, contours = self._settings, self.view, self._edges, prediction.contours
        if s.evidence <= 0.0:
            return []
        count = len(contours.state)
        if not count:
            return [_match()]
        sigma = view.sigma(s.noise)
        each = view.weight * s.evidence / count
        *group, share = edge_assignments(
            contours.pixels, contours.normals, contours.state, edges.strength, edges.direction, self._boundary,
            self._distance, max(2.0, s.window * view.extent), 2.0 * sigma, s.candidates, 2.0 * sigma,
            s.motion_boundary, each, 1.0 / sigma**2, LECLERC, float(s.nu),
        )  # fmt: skip
        missing, hidden = len(share) - share.sum(), count - len(share)
        return [
            _match(
                Assignments(*group),
                each * (0.5 * s.nu * missing + view.shared.occluded * view.shared.back_facing * hidden),
            )
        ]

    @cached_property
    def _boundary(self) -> np.ndarray:
        """The potential S_p (H, W) of motion boundaries, empty where no flow is known."""
        flow = self.view.cues.get("flow")
        return _NONE if flow is None else flow.whole_boundary()

    @cached_property
    def _distance(self) -> np.ndarray:
        """Distance (H, W) [px] to the silhouette's outline, empty where none is known."""
        silhouette = self.view.cues.get("silhouette")
        return _NONE if silhouette is None else np.where(silhouette.known, silhouette.distance, np.float32(0.0))

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        groups = [match.features for match in self.contours(shown.assigned)]
        terms = [self.view.on_contours(shown.assigned, g) for g in groups if len(g.point)]
        yield CuePicture(
            "edges",
            "edges and the body's contours",
            (160.0 * self._edges.strength).astype(np.uint8),
            [*(links(term, shown.posed, "hypothesis") for term in terms), *contour_dots(shown.prediction.contours)],
            [*CONTOUR_LEGEND, ("to the edges that may be theirs", "hypothesis")],
        )


def _match(group: Any = None, unassigned: float = 0.0) -> ContourMatch:
    return ContourMatch(
        "edges", nothing() if group is None else group, unassigned, "contour without an edge, or hidden"
    )
