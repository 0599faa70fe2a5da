"""The person's silhouette: what differs from the background, and its outline."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from estimator.vision.cues.background import background_beside, learn_background, widened
from estimator.vision.cues.subtraction import Background, SilhouetteSettings, departure, smoothed
from estimator.vision.mask_box import box_about
from humanoid.support.compiled import jit

__all__ = [
    "Background",
    "Silhouette",
    "SilhouetteSettings",
    "background_beside",
    "foreground_mask",
    "learn_background",
    "person_mask",
    "silhouette_of",
]

_BEHIND = 3.0  # px inside the outline where the background is checked for being known
_BESIDE = 2  # px around one within which its contrast is compared
_NEIGHBOURS = np.ones((3, 3), np.uint8)
_OUTLINE_SMOOTHING = 1.5  # standard deviation of the Gaussian that evens the outline's pixel steps out [px]
_SMOOTHING_REACH = 8  # px around the foreground beyond which that and the slope see nothing of it
_REACH = 0.016  # of the picture's longer side: by which the person may be beyond where they are known to be
_NEAR = 32  # px around the foreground's box beyond which distances are to the outline's own pixels


@dataclass(frozen=True)
class Silhouette:
    """The person's region in one image and its outline; outlines along the image's border do not count.

    mask (H, W) bool: True on the person.
    boundary (M, 2) float64: points (x, y) on the outlines, about one a pixel, holes' outlines included [px].
    normal (M, 2) float64: unit normals there, out of the person.
    nearest (H, W) int32: index into boundary of the outline point nearest to each pixel; -1 where there is none.
    distance (H, W) float32: distance to the outline [px], negative inside; infinite where there is none. known (H, W)
    bool: where the background is known; elsewhere the mask is True because the background is unknown. certain (M,)
    bool: whether the outline point bounds a region that was separated from a known background.
    """

    mask: np.ndarray
    boundary: np.ndarray
    normal: np.ndarray
    nearest: np.ndarray
    distance: np.ndarray
    known: np.ndarray
    certain: np.ndarray


@one_thread()
def foreground_mask(image: np.ndarray, background: Background, settings: SilhouetteSettings) -> np.ndarray:
    """Mask (H, W) bool of what does not belong to the background of an image (H, W, 3) uint8.

    Shadows are left out (`departure`). Where the background is unknown, all is foreground; specks are removed and
    small holes filled.
    """
    squared = departure(smoothed(image), background, settings).squared
    return _segment(squared, np.ones(squared.shape, dtype=bool), background.known, settings)


@one_thread()
def person_mask(
    image: np.ndarray, person: np.ndarray, background: Background | None, settings: SilhouetteSettings
) -> np.ndarray:
    """Mask (H, W) bool of a person in an image (H, W, 3) uint8 whose place is known approximately: person (H, W) bool.
    There and nearby it is what does not belong to the background; where the background is unknown, `person`."""
    if background is None:
        return _tidy(person, settings.smallest * person.size)
    near = widened(person, _REACH)
    squared = np.where(near, departure(smoothed(image), background, settings).squared, np.float32(0.0))
    return _segment(squared, person, background.known, settings)


def _segment(squared: np.ndarray, elsewhere: np.ndarray, known: np.ndarray, settings: SilhouetteSettings) -> np.ndarray:
    """Foreground (H, W) bool by squared departures from the background where this is known, and `elsewhere`."""
    mask = _tidy(((squared > 1.0) & known) | (elsewhere & ~known), settings.smallest * squared.size)
    trimmed, box = np.zeros_like(mask), box_about(mask, _BESIDE)
    if trimmed[box].size:
        trimmed[box] = _trimmed(mask[box], np.where(known[box], squared[box], np.float32(0.0)), known[box])
    return trimmed


def _trimmed(mask: np.ndarray, squared: np.ndarray, known: np.ndarray) -> np.ndarray:
    """A mask without the rim of pixels that show less than half of the contrast beside them: they are blur."""
    rim = mask & known & (cv2.erode(mask.astype(np.uint8), _NEIGHBOURS) == 0)
    beside = cv2.dilate(squared, np.ones((2 * _BESIDE + 1, 2 * _BESIDE + 1), np.uint8))
    return np.asarray(mask & ~(rim & (squared < np.float32(0.25) * beside)))


def _tidy(mask: np.ndarray, smallest: float) -> np.ndarray:
    """A mask without specks, gaps and small holes."""
    closed = cv2.morphologyEx(cv2.medianBlur(mask.astype(np.uint8), 5), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    filled = ~_larger(closed == 0, smallest)
    parts = np.zeros_like(filled)
    box = box_about(filled, 0)
    if parts[box].size:
        parts[box] = _larger(filled[box], smallest)
    return parts


def _larger(mask: np.ndarray, smallest: float) -> np.ndarray:
    """The parts of a mask with at least a number of pixels."""
    count, label = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    areas = np.zeros(count, np.int64)
    _count(label, areas)
    small = areas < smallest
    small[0] = False
    if not small.any():
        return mask
    small[0] = True
    large = np.empty_like(mask)
    _of_parts(label, ~small, large)
    return large


@jit
def _count(label, areas):  # type: ignore[no-untyped-def]
    """Add the pixels of each part, label (H, W), to areas (P,)."""
    for y in range(label.shape[0]):
        start, part = 0, label[y, 0]
        for x in range(label.shape[1]):
            if label[y, x] != part:
                areas[part] += x - start
                start, part = x, label[y, x]
        areas[part] += label.shape[1] - start


@jit
def _of_parts(label, is_large, mask):  # type: ignore[no-untyped-def]
    """Fill a mask (H, W) with whether the part that each pixel is in, label (H, W), is large: is_large (P,) bool."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            mask[y, x] = is_large[label[y, x]]


@one_thread()
def silhouette_of(mask: np.ndarray, known: np.ndarray | None = None) -> Silhouette:
    """Silhouette of a mask (H, W) bool; `known` (H, W) bool: where the background is, by default everywhere."""
    known = np.ones(mask.shape, dtype=bool) if known is None else known
    inside = np.ascontiguousarray(mask, dtype=np.uint8)
    outline, boundary, normal = _outline(inside)
    if len(boundary) == 0:
        nowhere, none = np.full(mask.shape, -1, np.int32), np.zeros(0, dtype=bool)
        return Silhouette(mask, boundary, normal, nowhere, _signed_distance(inside), known, none)
    off_outline = np.ones(mask.shape, np.uint8)
    off_outline[outline[:, 1], outline[:, 0]] = 0
    _, label = cv2.distanceTransformWithLabels(
        off_outline, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    index = np.full(int(label[outline[:, 1], outline[:, 0]].max()) + 1, -1, np.int32)
    index[label[outline[:, 1], outline[:, 0]]] = np.arange(len(outline))
    nearest, distance = np.empty(mask.shape, np.int32), np.empty(mask.shape, np.float32)
    _to_nearest(label, index, outline, nearest, distance)
    near = box_about(inside, _NEAR) if _off_border(inside) else np.s_[:, :]  # outlines there are left out
    distance[near] = _signed_distance(np.ascontiguousarray(inside[near]))
    x, y = np.round(boundary - _BEHIND * normal).astype(int).T
    certain = known[y.clip(0, len(known) - 1), x.clip(0, known.shape[1] - 1)]
    return Silhouette(mask, boundary, normal, nearest, distance, known, certain)


def _off_border(inside: np.ndarray) -> bool:
    """Whether nothing of a mask lies on the image's border."""
    return not (inside[[0, -1]].any() or inside[:, [0, -1]].any())


@jit
def _to_nearest(label, index, outline, nearest, distance):  # type: ignore[no-untyped-def]
    """From the labels (H, W) of nearest pixels, `index` of each label and outline (M, 2), all int: index of the outline
    pixel nearest to each pixel and distance beyond it, half a pixel less than to it; fills nearest and distance (H, W).
    """
    for y in range(label.shape[0]):
        for x in range(label.shape[1]):
            k = index[label[y, x]]
            dx, dy = x - outline[k, 0], y - outline[k, 1]
            nearest[y, x], distance[y, x] = k, math.sqrt(dx * dx + dy * dy) - 0.5


def _outline(inside: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (M, 2) int just inside the outline; the outline's points and outward normals (M, 2) beside them."""
    height, width = inside.shape
    contours, _ = cv2.findContours(inside, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2), int), np.empty((0, 2)), np.empty((0, 2))
    x, y = np.concatenate(contours)[:, 0].T
    order = np.unique(x.astype(np.int64) * height + y)
    pixels = np.stack((order // height, order % height), axis=-1)
    x, y = pixels.T
    pixels = pixels[(x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)]
    box = box_about(inside, _SMOOTHING_REACH)
    x, y = (pixels - (box[1].start, box[0].start)).T
    smooth = cv2.GaussianBlur(inside[box].astype(np.float32), (0, 0), _OUTLINE_SMOOTHING)
    slope = [cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.125)[y, x] for order in ((1, 0), (0, 1))]
    gradient = np.stack(slope, axis=-1).astype(np.float64)
    length = np.linalg.norm(gradient, axis=-1)
    clear = length > 0.02  # a line one pixel wide has no outside
    # one Newton step to where the smoothed mask is one half, the place of the outline between the pixels
    within = smooth[y, x][clear, None]
    pixels, gradient, length = pixels[clear], gradient[clear], length[clear, None]
    normal = -gradient / length
    return pixels, pixels + np.clip((within - 0.5) / length, 0.0, 1.0) * normal, normal


def _signed_distance(inside: np.ndarray) -> np.ndarray:
    """Distance of each pixel to the outline, which runs half a pixel outside the outermost pixels."""
    if inside.all() or not inside.any():
        return np.full(inside.shape, -np.inf if inside.any() else np.inf, np.float32)
    within, without = (_distance(m) for m in (inside, 1 - inside))
    return np.where(inside > 0, 0.5 - within, without - 0.5).astype(np.float32)


def _distance(mask: np.ndarray) -> np.ndarray:
    """Distance (H, W) from each pixel to the nearest outside the mask [px].

    The last bits of OpenCV's vary with the place in memory; squared distances are whole numbers, which settles them.
    """
    distance = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.sqrt(np.round(distance * distance)))
