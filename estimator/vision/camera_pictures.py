"""The pictures of one camera's clip at the resolution that cues are read at."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.clip import Clip
from estimator.data.media.depth_folder import DepthFolder
from estimator.data.media.picture import read_picture
from estimator.data.media.threads import one_thread
from estimator.vision.person_region import KnownPerson
from estimator.vision.resolution import scaled_camera
from humanoid.support.errors import InputError

_SAME_STEP = 0.1  # share of the usual step from one picture to the next that a step may differ by, to be followed


class PersonMasks(Protocol):
    """Where the person is in a camera's pictures, as passed from one cue to the others."""

    def mask(self, instant: int) -> np.ndarray | None:
        """Approximate mask (H, W) bool at an instant; None where no person is seen."""
        ...


class CameraPictures:
    """One camera's clip, with masks of the person and a picture of the empty scene where these are given.

    camera: at the working resolution. notes: messages to the user; readers of cues add theirs with `note`.
    right: the pictures of the camera that makes a stereo pair with this one, standing to its right, None where there is
    none. person_masks: where the person is, None where no cue provides it.

    Parameters
    ----------
    clip: an open clip or its path. camera: of the clip's own size. working_size: longest side of the returned pictures
        [px]; larger frames are reduced to it.
    masks: a folder of images or a video, white on the person, or None. plate: a picture of the empty scene, or None.
    frames: the number of the clip's frame at each instant (T,), or None where that is the instant's.
    person: where the person is by the keypoints, or None.
    depth: a folder of depth pictures, one for every frame of the clip (`estimator.data.media.depth_folder`), or None.

    Raises
    ------
    InputError: a file is not readable, or its size is not the camera's.
    """

    def __init__(
        self,
        clip: Clip | Path,
        camera: Camera,
        working_size: int,
        *,
        masks: Path | None = None,
        plate: Path | None = None,
        frames: np.ndarray | None = None,
        person: KnownPerson | None = None,
        depth: Path | None = None,
    ) -> None:
        self.right: CameraPictures | None = None
        self.person_masks: PersonMasks | None = None
        self._clip = clip if isinstance(clip, Clip) else Clip.open(clip)
        self._frames = frames
        self._person = person
        self._original, self._plate = camera, plate
        _check_size(self._clip.path, self._clip.image_size, camera)
        self.camera = scaled_camera(camera, min(1.0, working_size / max(camera.image_size)))
        self._masks = Clip.open(masks) if masks else None
        if self._masks is not None:
            _check_size(self._masks.path, self._masks.image_size, camera)
        self._depth = None if depth is None else DepthFolder(depth, camera.image_size)
        self._latest: dict[int, np.ndarray] = {}
        self.notes: tuple[str, ...] = ()

    def note(self, text: str) -> None:
        """Add a note for the user about this camera's pictures."""
        self.notes += (f"{self.camera.name}: {text}",)

    def picture(self, instant: int) -> np.ndarray:
        """The picture (H, W, 3) uint8 BGR of an instant; InputError past the clip's end."""
        return self._picture(self._frame_of(instant))

    def before(self, instant: int) -> np.ndarray | None:
        """The picture of the instant before; None where the motion between the two pictures is not that between the
        instants: a camera with fewer pictures than there are instants shows some of them twice."""
        if instant == 0:
            return None
        before = self._frame_of(instant - 1)
        if self._frames is not None:
            usual = (self._frames[-1] - self._frames[0]) / (len(self._frames) - 1)
            if abs(self._frame_of(instant) - before - usual) > _SAME_STEP * usual:
                return None
        return self._picture(before)

    @property
    def has_masks(self) -> bool:
        """Whether masks of the person are given."""
        return self._masks is not None

    def mask(self, instant: int) -> np.ndarray | None:
        """The given mask (H, W) bool of the person at an instant, None where none are given."""
        if self._masks is None:
            return None
        return np.asarray(self._reduced(_frame(self._masks, self._frame_of(instant))).max(axis=-1) > 127)

    def plate(self) -> np.ndarray | None:
        """The given picture (H, W, 3) uint8 BGR of the empty scene, None where there is none."""
        if self._plate is None:
            return None
        plate, whole = read_picture(self._plate)
        if not whole:
            self.note(f"{self._plate.name} is damaged and only partly decoded")
        _check_size(self._plate, (plate.shape[1], plate.shape[0]), self._original)
        return self._reduced(plate)

    @property
    def has_depth(self) -> bool:
        """Whether depth pictures are given."""
        return self._depth is not None

    def depth(self, instant: int) -> np.ndarray | None:
        """The given depth (H, W) float32 [m] of an instant, NaN where it is not known; None where none is given.
        Reduced pictures have the depth of one of the pixels that they unite: a mean would lie between two surfaces.
        InputError past the clip's end."""
        if self._depth is None:
            return None
        frame = self._frame_of(instant)
        if frame >= self._length:
            raise InputError(self._clip.path, "has no such frame", place=f"frame {frame}")
        whole = self._depth.at(frame)
        (width, height), (rows, columns) = self.camera.image_size, whole.shape
        at_rows = ((np.arange(height) + 0.5) * rows / height).astype(int)
        return np.asarray(whole[at_rows[:, None], ((np.arange(width) + 0.5) * columns / width).astype(int)])

    def instants(self, count: int) -> list[int]:
        """Up to `count` instants, spread evenly over the whole clip."""
        return _spread_over(self._length if self._frames is None else len(self._frames), count)

    def spread(self, count: int) -> tuple[list[np.ndarray], list[int | None]]:
        """Up to `count` pictures (H, W, 3) uint8 BGR, spread evenly over the whole clip, and one in which the person's
        keypoints are, unless it is among them. For each an instant at which these are known, or None."""
        known = {} if self._person is None else {self._frame_of(int(i)): int(i) for i in self._person.instants[::-1]}
        chosen = _spread_over(self._length, count)
        if known and not known.keys() & set(chosen):
            chosen = sorted([*chosen, min(known)])
        return [self._reduced(self._clip.frame(i)) for i in chosen], [known.get(i) for i in chosen]

    def body(self, instant: int, width: float) -> np.ndarray:
        """Mask (H, W) bool of the body by the keypoints, at `width` times its own width; for instants that are known by
        `spread`."""
        assert self._person is not None
        return self._person.mask(instant, self.camera.image_size, width)

    def close(self) -> None:
        """Let go of the files."""
        self._clip.close()
        if self._masks is not None:
            self._masks.close()

    @property
    def _length(self) -> int:
        return self._clip.frame_count or self._clip.report.read

    def _frame_of(self, instant: int) -> int:
        if self._frames is None:
            return instant
        if instant >= len(self._frames):
            raise InputError(self._clip.path, "has no frame there", place=f"instant {instant}")
        return int(self._frames[instant])

    def _picture(self, index: int) -> np.ndarray:
        """A frame at the working resolution; the last two are kept."""
        if index not in self._latest:
            picture = self._reduced(_frame(self._clip, index))
            self._latest = {**{i: p for i, p in self._latest.items() if abs(i - index) == 1}, index: picture}
        return self._latest[index]

    @one_thread()
    def _reduced(self, image: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.resize(image, self.camera.image_size, interpolation=cv2.INTER_AREA))


def _spread_over(length: int, count: int) -> list[int]:
    """Up to `count` of the numbers below `length`, the first and the last among them."""
    return [int(i) for i in np.unique(np.linspace(0, length - 1, count).astype(int))]


def _frame(clip: Clip, index: int) -> np.ndarray:
    try:
        return clip.frame(index)
    except IndexError:
        raise InputError(clip.path, "has no such frame", place=f"frame {index}") from None


def _check_size(source: Path, size: tuple[int, int], camera: Camera) -> None:
    if tuple(size) != tuple(camera.image_size):
        expected = "{} x {}".format(*camera.image_size)
        raise InputError(source, f"is {size[0]} x {size[1]} pixels, the camera {camera.name!r} has {expected}")
