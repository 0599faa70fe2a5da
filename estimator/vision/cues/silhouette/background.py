"""The empty scene of a fixed camera, learned from the frames of a clip."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.media.threads import one_thread
from estimator.vision.cues.silhouette.stillness import camera_moves, motion, small_size
from estimator.vision.cues.silhouette.subtraction import Background, SilhouetteSettings, departure, smoothed

FEWEST_FRAMES = 3  # without as many there is nothing to learn from
_SAME = 10.0  # colours this close are one [grey values]: light drifts in the course of a clip
_NEAR_ENOUGH = (0.0,) * 3, (_SAME,) * 3
_WANDERED = 0.15  # a place that moves in this share of the frames may hide a person
_FEWEST_OF_A_KIND = 50  # pixels of person or scene, below which there is nothing to cut
_CUT_STEPS = 2  # iterations of a cutout
_BESIDE = 0.015  # of the picture's longer side: by which a mask may miss the person


class KnownBody(NamedTuple):
    """Where the body is in a picture by its keypoints, masks (H, W) bool.

    core: surely on the body. body: about its own outline. reach: nothing of the body is beyond it.
    """

    core: np.ndarray
    body: np.ndarray
    reach: np.ndarray


@one_thread()
def learn_background(
    frames: Iterable[np.ndarray], settings: SilhouetteSettings, bodies: Sequence[KnownBody | None] | None = None
) -> Background | None:
    """Background from frames (H, W, 3) uint8 in order, spread over the clip; None if the camera moves or they are few.

    At first each pixel takes the colour seen in most frames while the place does not move: a person who stands around
    still moves a little. Then people who move are cut out of every frame by colour and outline, and the rest makes the
    background. Places that are occupied in every frame stay unknown.

    bodies: where the body is known to be in each frame, None where it is not. There a frame does not show the scene,
    nor do frames before and after in which the body has not left. What is seen beside it counts more.
    """
    pictures = [smoothed(frame) for frame in frames]
    known: list[KnownBody | None] = [None for _ in pictures] if bodies is None else list(bodies)
    if len(pictures) < FEWEST_FRAMES or camera_moves(pictures):
        return None
    moving = motion(pictures, settings.still)
    shape = pictures[0].shape[:2]
    still = [_enlarged(m < 0.3, shape) for m in moving]
    votes = _Votes.of(pictures, known, settings)
    fewest = max(FEWEST_FRAMES, settings.seen * len(pictures))
    background = _steadiest(pictures, votes.given(still), votes.weight, fewest)
    for _ in range(settings.rounds):
        persons = _cutouts(pictures, moving, background, known, settings)
        empty = [_enlarged(cv2.dilate(p, np.ones((3, 3), np.uint8)) == 0, shape) for p in persons]
        background = _steadiest(pictures, votes.given(empty), votes.weight, FEWEST_FRAMES)
    return background


@one_thread()
def background_beside(frames: Iterable[np.ndarray], persons: Sequence[np.ndarray | None]) -> Background | None:
    """Background from frames (H, W, 3) uint8 in which it is known about where the person is: masks (H, W) bool, None
    where no person is seen. None if the camera moves or there are too few frames.

    Each pixel takes the colour seen most often while no person is at it or near it. Places occupied in nearly every
    frame stay unknown.
    """
    pictures = [smoothed(frame) for frame in frames]
    if len(pictures) < FEWEST_FRAMES or camera_moves(pictures):
        return None
    free = [np.full(pictures[0].shape[:2], 255, np.uint8) for _ in pictures]
    for mask, person in zip(free, persons, strict=True):
        if person is not None:
            mask[widened(person, _BESIDE)] = 0
    return _steadiest(pictures, free, [1] * len(pictures), FEWEST_FRAMES)


def widened(mask: np.ndarray, share: float) -> np.ndarray:
    """A mask (H, W) bool and all within a share of the picture's longer side."""
    reach = max(1, round(share * max(mask.shape)))
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), around) > 0)


class _Votes(NamedTuple):
    """Where each picture shows the scene, masks (H, W) uint8, 0 or 255, and its number of votes per pixel."""

    free: list[np.ndarray]
    weight: list[int]

    @staticmethod
    def of(pictures: list[np.ndarray], known: list[KnownBody | None], settings: SilhouetteSettings) -> _Votes:
        """A person seen at a place stays there until the place changes, and came when it changed.

        Pictures in which the body is known together have so many votes that a colour beside the body wins against any
        other that shows while the body is not known, if it shows in a share `seen` of the frames.
        """
        count = sum(k is not None for k in known)
        more = round((1.0 - 2.0 * settings.seen) * (len(known) - count) / max(1, count))
        person = [None if of is None else _cut(picture, of) for picture, of in zip(pictures, known, strict=True)]
        free: list[np.ndarray] = [np.full(p.shape[:2], 255, np.uint8) for p in pictures]
        for order in (range(len(pictures)), range(len(pictures) - 1, -1, -1)):
            there: np.ndarray = np.zeros(free[0].shape, np.uint8)
            before = pictures[0]
            for i in order:
                if (cut := person[i]) is not None:
                    there = cut
                else:
                    unchanged: np.ndarray = cv2.inRange(cv2.absdiff(pictures[i], before), *_NEAR_ENOUGH)
                    there = there & unchanged
                free[i] = free[i] & ~there
                before = pictures[i]
        return _Votes(
            [f if k is None else f & ~(k.body * np.uint8(255)) for f, k in zip(free, known, strict=True)],
            [1 if k is None else 1 + more for k in known],
        )

    def given(self, usable: list[np.ndarray]) -> list[np.ndarray]:
        """The free pixels among the usable."""
        return [np.asarray(u & f) for u, f in zip(usable, self.free, strict=True)]


def _cut(picture: np.ndarray, of: KnownBody) -> np.ndarray:
    """The person in a picture, (H, W) uint8, 0 or 255, from the place of the body by its keypoints."""
    size = small_size(picture.shape)
    label = np.full(size[::-1], cv2.GC_PR_BGD, np.uint8)
    label[_reduced(of.body, size) > 0.5] = cv2.GC_PR_FGD
    _instruct(label, of)
    grab(picture, label)
    return _enlarged(cv2.dilate(label & 1, np.ones((3, 3), np.uint8)) > 0, picture.shape[:2])


def _instruct(label: np.ndarray, of: KnownBody) -> None:
    """Change GrabCut's labels (h, w) to agree with the keypoints."""
    size = label.shape[::-1]
    label[_reduced(of.reach, size) < 0.5] = cv2.GC_BGD
    label[_reduced(of.core, size) > 0.5] = cv2.GC_FGD


def _reduced(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Shares of a mask (H, W) in the pixels of a smaller picture."""
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA))


def grab(picture: np.ndarray, label: np.ndarray, steps: int = _CUT_STEPS) -> None:
    """GrabCut (Rother et al., 2004) of a picture reduced to the size of its labels (h, w), which it changes."""
    if min(np.count_nonzero(label & 1), np.count_nonzero((label & 1) == 0)) <= _FEWEST_OF_A_KIND:
        return
    cv2.setRNGSeed(0)  # the colour clusters start at random
    small = cv2.resize(picture, label.shape[::-1], interpolation=cv2.INTER_AREA)
    colours = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(small, label, (0, 0, 1, 1), *colours, steps, cv2.GC_INIT_WITH_MASK)


def _enlarged(mask: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A small mask at full size, 255 for True."""
    return np.asarray(cv2.resize(mask.astype(np.uint8) * 255, shape[::-1], interpolation=cv2.INTER_NEAREST))


def _steadiest(pictures: list[np.ndarray], usable: list[np.ndarray], weight: list[int], fewest: float) -> Background:
    """Mean and spread of the colour that each pixel shows most often, in the frames where it is usable (255).

    weight: how often each frame counts.
    """
    shape = pictures[0].shape[:2]
    most, best = np.zeros(shape, np.uint16), np.zeros((*shape, 3), np.uint8)
    for candidate, its_mask in zip(pictures, usable, strict=True):
        count = np.zeros(shape, np.uint16)
        for picture, mask, times in zip(pictures, usable, weight, strict=True):
            agrees = cv2.inRange(cv2.absdiff(candidate, picture), *_NEAR_ENOUGH) & mask & its_mask
            count += agrees & np.uint8(min(times, 255))  # 255 becomes the number
        better = count > most
        most[better], best[better] = count[better], candidate[better]
    often = np.zeros(shape, np.uint16)
    total, squares = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.float32)
    for picture, mask in zip(pictures, usable, strict=True):
        agrees = (cv2.inRange(cv2.absdiff(best, picture), *_NEAR_ENOUGH) & mask)[..., None] > 0
        often += agrees[..., 0]
        offset = np.where(agrees, picture.astype(np.float32) - best, np.float32(0.0))
        total += offset
        squares += offset * offset
    number = np.maximum(often, 1)[..., None].astype(np.float32)
    mean = total / number
    spread = np.sqrt(np.maximum(squares / number - mean * mean, np.float32(0.0)))
    return Background(best + mean, spread, most >= fewest)


def _cutouts(
    pictures: list[np.ndarray],
    moving: list[np.ndarray],
    background: Background,
    known: list[KnownBody | None],
    settings: SilhouetteSettings,
) -> list[np.ndarray]:
    """People who move, for each picture: masks (h, w) uint8 of `small_size`, by GrabCut (Rother et al., 2004)."""
    wandered = np.mean([m > 0.5 for m in moving], axis=0) > _WANDERED
    masks = []
    for picture, moves, of in zip(pictures, moving, known, strict=True):
        label = _labels(picture, background, (moves > 0.2) | wandered, settings)
        if of is not None:
            _instruct(label, of)
        grab(picture, label)
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
