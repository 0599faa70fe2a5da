"""Bare skin in a picture, by its colour: a histogram learned in one frame, and blobs of it in all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from estimator.vision.mask_box import box_about
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

_BINS = 64  # of either chromaticity
_LEAST = 1e-5  # share of a colour that was not seen
_MOST = 0.9  # of skin, the colours of which are searched for in the rest of the picture
_BLACK = 60  # sum of B, G and R below which noise has any chromaticity
_SMOOTHING = 1.0  # standard deviation of the Gaussian that a picture is smoothed with [px]
_BEYOND = 8  # px beyond where the person can be that smoothing and the closing of holes see


@dataclass(frozen=True)
class SkinSettings(CheckedSettings):
    """Settings of the recognition of skin.

    radius: of the discs about given points that colours are learned from, as a share of the person's size in the image.
    ratio: how many times likelier a colour has to be on skin than elsewhere. smoothing: of the histogram, in bins.
    darkest: brightness that skin has in the deepest shade, as a share of its brightness in the discs; hair is darker.
    least: area of a blob, as a share of the squared size of the person. most: share of the picture that skin may take
    up in the frame that it is learned in. merged: times a hand's area from which a blob may be of several. largest:
    times the area of a face and two hands, above which a blob is of none of them.
    Raises InputError where a value is outside its range.
    """

    radius: float = setting(0.06, above=0, at_most=1)
    ratio: float = setting(4.0, above=0)
    smoothing: float = setting(1.0, above=0)
    darkest: float = setting(0.35, at_least=0, at_most=1)
    least: float = setting(0.008, above=0)
    most: float = setting(0.2, above=0, at_most=1)
    merged: float = setting(1.7, above=1)
    largest: float = setting(2.0, above=1)


@dataclass(frozen=True, eq=False)
class SkinModel:
    """log_ratio (64, 64): of a colour on skin to one elsewhere, by the shares of red and green in it. brightness:
    median sum of B, G and R on skin. face, hand [px^2]: areas of their blobs in the frame of which this was learned.
    size [px]: the person's there."""

    log_ratio: np.ndarray
    brightness: float
    face: float
    hand: float
    size: float

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays for `from_arrays`."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> SkinModel:
        """The model with these arrays. Raises InputError where they are invalid."""
        names = [field.name for field in fields(SkinModel)]
        right = all(n in arrays and np.shape(arrays[n]) == ((_BINS, _BINS) if n == "log_ratio" else ()) for n in names)
        if not (right and all(np.isfinite(arrays[n]).all() for n in names)):
            raise InputError("skin model", "its arrays are damaged", remedy="start again, without resuming")
        return SkinModel(np.asarray(arrays["log_ratio"], float), *(float(arrays[n]) for n in names[1:]))


@dataclass(frozen=True, eq=False)
class Blobs:
    """Connected regions of skin. mean (B, 2) [px], covariance (B, 2, 2) [px^2]: of their pixels. area (B,) [px^2].
    merged (B,) bool: too large for one hand. face, hand [px^2]: what areas these have (`SkinModel`)."""

    mean: np.ndarray
    covariance: np.ndarray
    area: np.ndarray
    merged: np.ndarray
    face: float
    hand: float


@one_thread()
def learned_skin(
    picture: np.ndarray,
    points: np.ndarray,
    faces: np.ndarray,
    size: float,
    settings: SkinSettings,
    source: str,
    foreground: np.ndarray | None = None,
) -> SkinModel:
    """Learn the colour of skin from a picture (H, W, 3) uint8 BGR and points on it (K, 2) [px].

    Only the shares of red and green in a colour count, which light and shade do not change (differences of colour, such
    as Cr and Cb, shrink in shade). Colours elsewhere are those of the whole picture except the discs. A face is assumed
    no smaller than a disc, a hand no smaller than half of one.

    faces (K,) bool: which points are on the face. size [px]: the person's in the image, the root mean square distance
    of the keypoints from their centre. source: of the picture, for errors. foreground (H, W) bool: where the person
    can be, None where that is not known; without it a hand before a board of its colour is as large as both.

    Raises
    ------
    InputError: no point in the picture, black at the points, or a colour that takes up too much of the picture.
    """
    height, width = picture.shape[:2]
    inside = np.isfinite(points).all(axis=1)
    inside[inside] &= ((points[inside] >= 0) & (points[inside] < [width, height])).all(axis=1)
    if not inside.any():
        remedy = 'keypoints of face and hands in that frame, or features = "keypoints"'
        raise InputError(source, "has no point on skin to learn its colour from", remedy=remedy)
    discs = np.zeros((height, width), np.uint8)
    radius = max(2, round(settings.radius * size))
    for point in points[inside]:
        cv2.circle(discs, (round(point[0]), round(point[1])), radius, 1, -1)
    total, bins = _colours(picture)
    brightness = float(np.median(total[discs > 0]))
    if brightness < _BLACK:
        raise InputError(source, "is black where skin should be", remedy="begin at a frame that shows the person")
    skin, rest = (_histogram(bins[discs == k], settings.smoothing) for k in (1, 0))
    log_ratio = np.log(skin / rest)
    rough = SkinModel(log_ratio, brightness, 0.0, 0.0, size)
    share = float((_usual(skin)[bins[..., 0], bins[..., 1]] & (total >= _darkest(rough, settings))).mean())
    if share > settings.most:
        problem = f"has the colour of the skin points in {share:.0%} of the picture"
        raise InputError(source, problem, remedy='clothes and a wall of other colours, or features = "keypoints"')
    labels, areas, _ = _components(_mask(picture, rough, foreground, settings))
    near = [_area_at(labels, areas, p, radius) for p in points[inside]]
    disc = np.pi * radius**2
    on_face = [a for a, f in zip(near, faces[inside], strict=True) if f]
    on_hand = [a for a, f in zip(near, faces[inside], strict=True) if not f]
    hand = float(np.median(on_hand)) if on_hand else disc
    face = float(np.median(on_face)) if on_face else 3.0 * hand
    return SkinModel(log_ratio, brightness, max(face, disc), max(hand, 0.5 * disc), size)


@one_thread()
def skin_blobs(picture: np.ndarray, model: SkinModel, foreground: np.ndarray | None, settings: SkinSettings) -> Blobs:
    """Blobs of skin in a picture (H, W, 3) uint8 BGR, by area, the largest first; none in a black picture.

    foreground (H, W) bool: where the person can be, None where that is not known.
    """
    labels, areas, boxes = _components(_mask(picture, model, foreground, settings))
    least, most = settings.least * model.size**2, settings.largest * (model.face + 2.0 * model.hand)
    order = [k for k in np.argsort(-areas, kind="stable") if k > 0 and least <= areas[k] <= most]
    mean, covariance = np.zeros((len(order), 2)), np.zeros((len(order), 2, 2))
    for row, k in enumerate(order):
        left, top, width, height = boxes[k]
        y, x = np.nonzero(labels[top : top + height, left : left + width] == k)
        places = np.stack([x + left, y + top], axis=1).astype(float)
        mean[row] = places.mean(axis=0)
        off = places - mean[row]
        covariance[row] = off.T @ off / len(off) + np.eye(2) / 12.0  # a pixel has a size
    area = areas[order].astype(float)
    return Blobs(mean, covariance, area, area > settings.merged * model.hand, model.face, model.hand)


def _colours(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums (H, W) of B, G and R, and bins (H, W, 2) of the shares of red and green in them."""
    total, bins = np.empty(picture.shape[:2], np.int32), np.empty((*picture.shape[:2], 2), np.int32)
    shares_of_colours(picture, np.float32(_BINS), total, bins)
    return total, bins


def _histogram(bins: np.ndarray, smoothing: float) -> np.ndarray:
    """Shares (64, 64) of colours (N, 2), smoothed, none of them 0."""
    counts = np.zeros((_BINS, _BINS))
    np.add.at(counts, (bins[:, 0], bins[:, 1]), 1.0)
    smooth = cv2.GaussianBlur(counts, (0, 0), smoothing)
    return np.asarray((smooth + _LEAST) / (smooth + _LEAST).sum())


def _usual(skin: np.ndarray) -> np.ndarray:
    """(64, 64) bool: the fewest colours that make up most of skin, of their shares. Which of them distinguish skin from
    the rest is not a measure for a picture that is full of them, where none does."""
    order = np.argsort(-skin, axis=None)
    usual = np.zeros(skin.size, dtype=bool)
    usual[order[: np.searchsorted(np.cumsum(skin.ravel()[order]), _MOST) + 1]] = True
    return usual.reshape(skin.shape)


def _darkest(model: SkinModel, settings: SkinSettings) -> float:
    """The sum of B, G and R below which nothing is skin."""
    return max(_BLACK, settings.darkest * model.brightness)


def _mask(picture: np.ndarray, model: SkinModel, foreground: np.ndarray | None, settings: SkinSettings) -> np.ndarray:
    """(H, W) uint8: skin, without specks, its small holes filled."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    box = np.s_[:, :] if foreground is None else box_about(foreground, _BEYOND)
    part = mask[box]
    if part.size:
        total, bins = _colours(cv2.GaussianBlur(picture[box], (0, 0), _SMOOTHING))
        likely = model.log_ratio > np.log(settings.ratio)
        mark_skin(total, bins, likely, float(_darkest(model, settings)), part)
        if foreground is not None:
            part &= foreground[box]
        opened = cv2.morphologyEx(part, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        mask[box] = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    return mask


def _components(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Labels (H, W) of the connected regions of a mask (H, W) uint8, and of each its area and its box (left, top,
    width, height); 0 is all else, with what area it has near them."""
    x, y, width, height = cv2.boundingRect(mask)
    # OpenCV numbers regions by blocks of two by two pixels: from an even place on they come in the same order
    left, top = x - x % 2, y - y % 2
    box = np.s_[top : max(y + height, 1), left : max(x + width, 1)]
    labels = np.zeros(mask.shape, np.int32)
    _, labels[box], stats, _ = cv2.connectedComponentsWithStats(mask[box], connectivity=8)
    boxes = stats[:, : cv2.CC_STAT_AREA] + np.array([left, top, 0, 0], np.int32)
    return labels, stats[:, cv2.CC_STAT_AREA], boxes


def _area_at(labels: np.ndarray, areas: np.ndarray, point: np.ndarray, radius: int) -> float:
    """Area of the largest region within a radius of a point."""
    height, width = labels.shape
    x, y = round(float(point[0])), round(float(point[1]))
    window = labels[max(y - radius, 0) : min(y + radius, height), max(x - radius, 0) : min(x + radius, width)]
    present = np.unique(window[window > 0])
    return float(areas[present].max()) if len(present) else 0.0


@jit
def shares_of_colours(picture, steps, total, bins):  # type: ignore[no-untyped-def]
    """Fill, for a picture (H, W, 3) uint8 BGR, total (H, W) int32, the sums of B, G and R, and bins (H, W, 2) int32,
    the shares of red and green in them in `steps` (float32, at most 1,000) steps.

    A quotient of such small whole numbers is either one itself or so far from one that float32 rounds it to none.
    """
    for y in range(picture.shape[0]):
        colours, sums, shares = picture[y], total[y], bins[y]
        for x in range(picture.shape[1]):
            green, red = np.int32(colours[x, 1]), np.int32(colours[x, 2])
            sums[x] = np.int32(colours[x, 0]) + green + red
            more = np.float32(sums[x] + 1)
            shares[x, 0] = np.int32(np.float32(red) * steps / more)
            shares[x, 1] = np.int32(np.float32(green) * steps / more)


@jit
def mark_skin(total, bins, likely, least, mask):  # type: ignore[no-untyped-def]
    """Fill mask (H, W) uint8 with whether a colour is likely, (64, 64) bool, and its sum total (H, W) at least `least`;
    bins (H, W, 2) int32 are the row and column of each."""
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            mask[y, x] = likely[bins[y, x, 0], bins[y, x, 1]] and total[y, x] >= least
