"""The empty scene of a fixed camera, learned from the frames of a clip, and what in it is still."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np

from estimator.data.media.threads import length, one_thread
from estimator.vision.cues.colour_model import BINS, colour_bins, densities
from estimator.vision.cues.subtraction import Background, SilhouetteSettings, departure, smoothed

SIZE = 320  # longest side of the pictures for motion detection [px]
_REACH = 6.0  # standard deviation of the window over which evenly coloured places take their outlines' motion [px]
_GRAIN = 0.6  # squared slope of the sensor's noise [grey values per pixel, squared]
_EVEN = 0.02  # texture; where there is less, nothing is seen to move
_NOISE = 5.0  # grey values; less contrast may be noise
_CELLS = 8  # the picture is cut into this many rows and columns to see whether the camera moves


def small_size(shape: tuple[int, ...]) -> tuple[int, int]:
    """Width and height of a picture (H, W, ...) reduced to `SIZE`."""
    scale = min(1.0, SIZE / max(shape[:2]))
    return max(1, round(shape[1] * scale)), max(1, round(shape[0] * scale))


def camera_moves(pictures: list[np.ndarray]) -> bool:
    """Whether most textured places, over the whole picture, do not stay where they are."""
    grey = [cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in pictures]
    reference = grey[len(grey) // 2]
    corners: Any = cv2.goodFeaturesToTrack(reference, 600, 0.01, max(reference.shape) / 60)
    if corners is None:
        return False
    corners = _textured(reference, corners)
    height, width = reference.shape
    cell = (corners[:, 0] * (_CELLS / width, _CELLS / height)).astype(int) @ (1, _CELLS)
    occupied, count = np.unique(cell, return_counts=True)
    # a few textured places may all lie on the person; then nothing can be found out, nor need it be
    if len(occupied) < _CELLS**2 / 4:
        return False
    shares = []
    for picture in grey:
        there, status, _ = cv2.calcOpticalFlowPyrLK(reference, picture, corners, np.zeros_like(corners))
        stays = (status[:, 0] > 0) & (np.linalg.norm(there - corners, axis=-1)[:, 0] < 0.7)
        shares.append(np.mean(np.bincount(cell, stays, _CELLS**2)[occupied] >= 0.5 * count))
    return bool(np.quantile(shares, 0.2) < 0.5)


def _textured(grey: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The corners (N, 1, 2) that stand out of the sensor's noise: dark, even places have corners of noise."""
    values = grey.astype(np.float32)
    mean, square = (cv2.boxFilter(v, -1, (9, 9)) for v in (values, values * values))
    x, y = corners[:, 0].astype(int).T
    return np.asarray(corners[(square - mean * mean)[y, x] > _NOISE**2])


def motion(pictures: list[np.ndarray], limit: float) -> list[np.ndarray]:
    """For each picture, the confidence that its places move to the one before or after: 0 to 1, of `small_size`.

    Motion shows only where there is texture; evenly coloured places take the motion of the texture around them.
    """
    size = small_size(pictures[0].shape)
    small = [cv2.cvtColor(cv2.resize(p, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY) for p in pictures]
    fastest = [np.zeros(small[0].shape, np.float32) for _ in small]
    search: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    for i in range(len(small) - 1):
        for here, other in ((i, i + 1), (i + 1, i)):
            flow = search.calc(small[here], small[other], None)
            np.maximum(fastest[here], length(flow[..., 0], flow[..., 1]), out=fastest[here])
    return [_spread_out(speed > limit, picture) for speed, picture in zip(fastest, small, strict=True)]


def _spread_out(moves: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """Mean of `moves` in a Gaussian window, weighted by texture."""
    dx, dy = (cv2.Sobel(grey, cv2.CV_32F, *order, scale=0.125) for order in ((1, 0), (0, 1)))
    energy = np.maximum(dx * dx + dy * dy - np.float32(_GRAIN), np.float32(0.0))
    texture = energy / (energy + np.float32(4.0))  # half for a slope of 2 grey values a pixel
    moving, all_texture = (cv2.GaussianBlur(v, (0, 0), _REACH) for v in (texture * moves, texture))
    return np.asarray(moving / (all_texture + np.float32(_EVEN)))


FEWEST_FRAMES = 3  # without as many there is nothing to learn from
_SAME = 10.0  # colours this close are one [grey values]: light drifts in the course of a clip
_NEAR_ENOUGH = (0.0,) * 3, (_SAME,) * 3
_WANDERED = 0.15  # a place that moves in this share of the frames may hide a person
_FEWEST_OF_A_KIND = 50  # pixels of person or scene, below which there is nothing to cut
_CUT_STEPS = 2  # iterations of a cutout
_RATHER = 3.0  # times as dense on the person as beside: such colours are the person's
_BY_ONE = np.ones((3, 3), np.uint8)  # pixels by which masks grow and shrink
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
        empty = [_enlarged(cv2.dilate(p, _BY_ONE) == 0, shape) for p in persons]
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
    """Where each picture may show the scene, where it does for sure as far as people go, masks (H, W) uint8, 0 or 255,
    and its number of votes per pixel."""

    free: list[np.ndarray]
    sure: list[np.ndarray]
    weight: list[int]

    @staticmethod
    def of(pictures: list[np.ndarray], known: list[KnownBody | None], settings: SilhouetteSettings) -> _Votes:
        """A person seen at a place stays there until the place changes, and came when it changed. Where the place later
        has the person's colours again, the person is back.

        Pictures in which the body is known show the scene beside the person who is cut out of them, however little of
        it is still. They have so many votes together that a colour beside the body wins against any other that shows
        while the body is not known, if it shows in a share `seen` of the frames.
        """
        count = sum(k is not None for k in known)
        more = round((1.0 - 2.0 * settings.seen) * (len(known) - count) / max(1, count))
        shape = pictures[0].shape[:2]
        person = [None if of is None else _cut(picture, of) for picture, of in zip(pictures, known, strict=True)]
        free: list[np.ndarray] = [np.full(shape, 255, np.uint8) for _ in pictures]
        for order in (range(len(pictures)), range(len(pictures) - 1, -1, -1)):
            there: np.ndarray = np.zeros(shape, np.uint8)
            before = pictures[0]
            for i in order:
                cut = person[i]
                there = there & _agreement(pictures[i], before) if cut is None else cut.around
                free[i] = free[i] & ~there
                before = pictures[i]
        back = _back(pictures, person, known)
        free = [f & ~(b if k is None else _full(k.body)) for f, b, k in zip(free, back, known, strict=True)]
        nowhere = np.zeros(shape, np.uint8)
        return _Votes(
            free,
            [nowhere if k is None else _full(k.reach) for k in known],
            [1 if k is None else 1 + more for k in known],
        )

    def given(self, usable: list[np.ndarray]) -> list[np.ndarray]:
        """The free pixels among the usable."""
        return [np.asarray((u | s) & f) for u, s, f in zip(usable, self.sure, self.free, strict=True)]


def _full(mask: np.ndarray) -> np.ndarray:
    """A mask (H, W) bool as uint8, 0 or 255."""
    return np.asarray(mask * np.uint8(255))


class _Cutout(NamedTuple):
    """A person cut out of a picture, masks (H, W) uint8, 0 or 255: within a narrower and a wider border."""

    inside: np.ndarray
    around: np.ndarray


def _back(pictures: list[np.ndarray], cutouts: list[_Cutout | None], known: list[KnownBody | None]) -> list[np.ndarray]:
    """Where each picture in which the person is not known has their colours at a place that is known to have been
    theirs, (H, W) uint8, 0 or 255: where they were cut out, the colour that was there; about their outline, too, one
    that is rather theirs, by where they surely were, than of what is beside them."""
    shape = pictures[0].shape[:2]
    counts, about, insides = np.zeros((2, BINS)), np.zeros(shape, np.uint8), list[tuple[np.ndarray, np.ndarray]]()
    for picture, cutout, of in zip(pictures, cutouts, known, strict=True):
        if cutout is not None and of is not None:
            bins, body = colour_bins(picture), _full(of.body)
            for k, chosen in enumerate((of.core, cutout.around == 0)):
                counts[k] += np.bincount(bins[chosen], minlength=BINS)
            insides.append((picture, cutout.inside & body))  # a cutout can run over into what lies beside
            about |= body
    person, scene = densities(counts)
    own = np.where(person > _RATHER * scene, 255, 0).astype(np.uint8)
    back: list[np.ndarray] = [np.zeros(shape, np.uint8) for _ in pictures]
    for picture, of, place in zip(pictures, known, back, strict=True):
        if of is None and insides:
            place |= about & own[colour_bins(picture)]
            for there, inside in insides:
                place |= inside & _agreement(picture, there)
    return back


def _agreement(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Where two pictures (H, W, 3) uint8 have one colour, (H, W) uint8, 0 or 255."""
    return np.asarray(cv2.inRange(cv2.absdiff(first, other), *_NEAR_ENOUGH))


def _cut(picture: np.ndarray, of: KnownBody) -> _Cutout:
    """The person in a picture, from the place of the body by its keypoints."""
    size = small_size(picture.shape)
    label = np.full(size[::-1], cv2.GC_PR_BGD, np.uint8)
    label[_reduced(of.body, size) > 0.5] = cv2.GC_PR_FGD
    _instruct(label, of)
    grab(picture, label)
    person, shape = label & 1, picture.shape[:2]
    return _Cutout(*(_enlarged(m(person, _BY_ONE) > 0, shape) for m in (cv2.erode, cv2.dilate)))


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
    return np.asarray(cv2.resize(_full(mask), shape[::-1], interpolation=cv2.INTER_NEAREST))


def _steadiest(pictures: list[np.ndarray], usable: list[np.ndarray], weight: list[int], fewest: float) -> Background:
    """Mean and spread of the colour that each pixel shows most often, in the frames where it is usable (255).

    weight: how often each frame counts.
    """
    shape = pictures[0].shape[:2]
    most, best = np.zeros(shape, np.uint16), np.zeros((*shape, 3), np.uint8)
    for candidate, its_mask in zip(pictures, usable, strict=True):
        count = np.zeros(shape, np.uint16)
        for picture, mask, times in zip(pictures, usable, weight, strict=True):
            agrees = _agreement(candidate, picture) & mask & its_mask
            count += agrees & np.uint8(min(times, 255))  # 255 becomes the number
        better = count > most
        most[better], best[better] = count[better], candidate[better]
    often = np.zeros(shape, np.uint16)
    total, squares = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.float32)
    for picture, mask in zip(pictures, usable, strict=True):
        agrees = (_agreement(best, picture) & mask)[..., None] > 0
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
    label[cv2.erode(different, _BY_ONE) > 0] = cv2.GC_FGD
    return label
