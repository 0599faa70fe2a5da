"""The empty scene of a fixed camera, learned from the frames of a clip."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from estimator.cues.silhouette.stillness import camera_moves, motion, small_size
from estimator.cues.silhouette.subtraction import Background, SilhouetteSettings, departure, smoothed
from estimator.media.threads import one_thread

FEWEST_FRAMES = 3  # without as many there is nothing to learn from
_SAME = 10.0  # colours this close are one [grey values]: light drifts in the course of a clip
_WANDERED = 0.15  # a place that moves in this share of the frames may hide a person
_CUT_STEPS = 2  # iterations of a cutout


@one_thread()
def learn_background(frames: Iterable[np.ndarray], settings: SilhouetteSettings) -> Background | None:
    """Background from frames (H, W, 3) uint8 in order, spread over the clip; None if the camera moves or they are few.

    At first each pixel takes the colour that shows in most frames while the place stands still: a person who stands
    about still moves a little. Then people who move are cut out of every frame by colour and outline, and what is left
    makes the background. Places that are occupied in every frame stay unknown.
    """
    pictures = [smoothed(frame) for frame in frames]
    pictures = [pictures[i] for i in np.unique(np.linspace(0, len(pictures) - 1, settings.frames).astype(int))]
    if len(pictures) < FEWEST_FRAMES or camera_moves(pictures):
        return None
    moving = motion(pictures, settings.still)
    shape = pictures[0].shape[:2]
    still = [_enlarged(m < 0.3, shape) for m in moving]
    background = _steadiest(pictures, still, max(FEWEST_FRAMES, settings.seen * len(pictures)))
    for _ in range(settings.rounds):
        persons = _cutouts(pictures, moving, background, settings)
        empty = [_enlarged(cv2.dilate(p, np.ones((3, 3), np.uint8)) == 0, shape) for p in persons]
        background = _steadiest(pictures, empty, FEWEST_FRAMES)
    return background


def _enlarged(mask: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A small mask at full size, 255 for True."""
    return np.asarray(cv2.resize(mask.astype(np.uint8) * 255, shape[::-1], interpolation=cv2.INTER_NEAREST))


def _steadiest(pictures: list[np.ndarray], usable: list[np.ndarray], fewest: float) -> Background:
    """Mean and spread of the colour that each pixel shows most often, in the frames where it is usable (255)."""
    shape = pictures[0].shape[:2]
    near = (0.0,) * 3, (_SAME,) * 3
    most, best = np.zeros(shape, np.uint16), np.zeros((*shape, 3), np.uint8)
    for candidate, its_mask in zip(pictures, usable, strict=True):
        count = np.zeros(shape, np.uint16)
        for picture, mask in zip(pictures, usable, strict=True):
            count += (cv2.inRange(cv2.absdiff(candidate, picture), *near) & mask & its_mask) >> 7
        better = count > most
        most[better], best[better] = count[better], candidate[better]
    total, squares = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.float32)
    for picture, mask in zip(pictures, usable, strict=True):
        agrees = (cv2.inRange(cv2.absdiff(best, picture), *near) & mask)[..., None] > 0
        offset = np.where(agrees, picture.astype(np.float32) - best, np.float32(0.0))
        total += offset
        squares += offset * offset
    weight = np.maximum(most, 1)[..., None].astype(np.float32)
    mean = total / weight
    spread = np.sqrt(np.maximum(squares / weight - mean * mean, np.float32(0.0)))
    return Background(best + mean, spread, most >= fewest)


def _cutouts(
    pictures: list[np.ndarray], moving: list[np.ndarray], background: Background, settings: SilhouetteSettings
) -> list[np.ndarray]:
    """People who move, for each picture: masks (h, w) uint8 of `small_size`, by GrabCut (Rother et al., 2004)."""
    size = small_size(pictures[0].shape)
    wandered = np.mean([m > 0.5 for m in moving], axis=0) > _WANDERED
    masks = []
    for picture, moves in zip(pictures, moving, strict=True):
        label = _labels(picture, background, (moves > 0.2) | wandered, settings)
        if np.count_nonzero((label & 1) > 0) > 50 and np.count_nonzero((label & 1) == 0) > 50:
            cv2.setRNGSeed(0)  # GrabCut's colour clusters start at random
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            colours = np.zeros((1, 65)), np.zeros((1, 65))
            cv2.grabCut(small, label, (0, 0, 1, 1), *colours, _CUT_STEPS, cv2.GC_INIT_WITH_MASK)
        masks.append(label & 1)
    return masks


def _labels(
    picture: np.ndarray, background: Background, doubtful: np.ndarray, settings: SilhouetteSettings
) -> np.ndarray:
    """GrabCut's labels of a reduced picture, before the cut; odd ones are foreground."""
    size = doubtful.shape[::-1]
    departs = departure(picture, background, settings)
    squared = cv2.resize(departs.squared, size, interpolation=cv2.INTER_AREA)
    shaded = cv2.resize(departs.shaded.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.75
    known = cv2.resize(background.known.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    label = np.full(doubtful.shape, cv2.GC_PR_FGD, np.uint8)
    same = known & (squared < 1.0)
    label[same] = cv2.GC_PR_BGD
    label[same & (shaded | ~doubtful)] = cv2.GC_BGD
    different = (known & (squared > 4.0)).astype(np.uint8)
    label[cv2.erode(different, np.ones((3, 3), np.uint8)) > 0] = cv2.GC_FGD
    return label
