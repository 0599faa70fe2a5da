"""Clips: a video file or a folder of images, frame by frame."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from estimator.data.media.container import container_of
from estimator.data.media.picture import read_picture
from humanoid.support.errors import InputError

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg writes its own complaints to the terminal otherwise
import cv2

if "OPENCV_LOG_LEVEL" not in os.environ:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # errors are reported here, once

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp")
DEFAULT_FPS = 30.0
FPS_RANGE = (0.5, 2000.0)
_FFMPEGS_OWN = 25.0  # frames per second, of streams that store no time
_SHORT, _SHARE = 0.5, 0.02  # s, and share of a duration, by which a clip may be shorter than an estimate of it
_NO_TIMEOUTS = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 0, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 0]
"""OpenCV ends a file where a read takes over 30 s, as it does when the process is suspended or a disk is slow."""
_ASPECTS = (0.25, 4.0)  # of pixels, that a file may mean
_READ_ON = 30  # a frame this little ahead is reached sooner by reading on than by seeking


@dataclass(frozen=True)
class ClipReport:
    """Result of one pass through a clip.

    declared: frames the file claims, None where it makes no usable claim, or FFmpeg only estimates it.
    read: frames that could be decoded.
    times (read,): time of each frame [s], the first at 0, strictly increasing.
    fps: mean frame rate of `times`, the declared one for a single frame.
    notes: what a user should know.
    """

    declared: int | None
    read: int
    times: np.ndarray
    fps: float
    notes: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether as many frames were read as declared."""
        return self.declared is None or self.read >= self.declared


class Clip:
    """Frames of a video or of a folder of images; open one with `Clip.open`.

    Frames are (height, width, 3) uint8 in BGR. `frame(i)` gives the very frame that reading from the start gives.

    Attributes
    ----------
    path: where it comes from.
    image_size: width, height [px] as displayed (a video's rotation flag is applied).
    fps: declared frames per second; 30 where nothing sensible is declared.
    frame_count: declared number of frames, None if unknown or only estimated; `report.read` is the verified one.
    rate_known: whether the frame rate is given or declared, not assumed.
    pixel_aspect: width of a pixel over its height, as declared by the file (sample aspect ratio); 1 without.
    """

    path: Path
    image_size: tuple[int, int]
    fps: float
    frame_count: int | None
    rate_known: bool
    pixel_aspect: float = 1.0

    @staticmethod
    def open(path: str | Path, *, fps: float | None = None) -> Clip:
        """Open a clip; `fps` replaces what the file declares (and a video's own frame times).

        Raises
        ------
        InputError: missing, empty, unreadable, or neither a video nor a folder of images.
        """
        path = Path(path)
        if fps is not None and not _sane_fps(fps):
            raise InputError(path, "fps must be {:g} to {:g}, got {:g}".format(*FPS_RANGE, fps))
        if not path.exists():
            raise InputError(path, "no such clip", remedy="a video file or a folder of images is needed")
        return FolderClip(path, fps) if path.is_dir() else VideoClip(path, fps)

    def frame(self, index: int) -> np.ndarray:
        """Frame `index`; raises IndexError where the clip has none."""
        raise NotImplementedError

    def frames(self, start: int = 0) -> Iterator[np.ndarray]:
        """Frames in order from `start` to the last that can be read."""
        raise NotImplementedError

    @cached_property
    def report(self) -> ClipReport:
        """Verified frame count and frame times; reads through the whole clip the first time."""
        raise NotImplementedError

    @property
    def times(self) -> np.ndarray:
        """Time of each readable frame [s], (report.read,)."""
        return self.report.times

    def close(self) -> None:
        """Let go of the file; reading again opens it again."""


class FolderClip(Clip):
    """Images of a folder in natural order of their names (2 before 10)."""

    def __init__(self, path: Path, fps: float | None) -> None:
        files = [p for p in listed(path) if p.suffix.lower() in IMAGE_SUFFIXES]
        if not files:
            raise InputError(path, "has no images", remedy=f"known are {', '.join(IMAGE_SUFFIXES)}")
        self.path, self.files = path, sorted(files, key=natural_order)
        self.frame_count = len(self.files)
        self.rate_known, self.fps = fps is not None, fps or DEFAULT_FPS
        first, _ = read_picture(self.files[0])
        self._damaged: set[int] = set()
        self.image_size = (first.shape[1], first.shape[0])

    def frame(self, index: int) -> np.ndarray:
        """See `Clip.frame`; raises InputError for an image that cannot be read or has another size."""
        if not 0 <= index < len(self.files):
            raise IndexError(f"{self.path} has no frame {index}")
        image, whole = read_picture(self.files[index])
        if not whole:
            self._damaged.add(index)
        if (image.shape[1], image.shape[0]) != self.image_size:
            size, first = f"{image.shape[1]} x {image.shape[0]}", "{} x {}".format(*self.image_size)
            raise InputError(self.files[index], f"is {size} pixels, the images before it {first}")
        return image

    def frames(self, start: int = 0) -> Iterator[np.ndarray]:
        """See `Clip.frames`."""
        return (self.frame(i) for i in range(start, len(self.files)))

    @cached_property
    def report(self) -> ClipReport:
        """See `Clip.report`; every image is checked."""
        read = sum(1 for _ in self.frames())
        notes = [] if self.rate_known else [f"a folder of images has no frame rate: {DEFAULT_FPS:g} assumed"]
        if self._damaged:
            first = self.files[min(self._damaged)].name
            notes.append(f"{len(self._damaged)} images are damaged and only partly decoded, {first} first")
        return ClipReport(len(self.files), read, np.arange(read) / self.fps, self.fps, tuple(notes))


class VideoClip(Clip):
    """A video file, decoded by OpenCV's FFmpeg."""

    def __init__(self, path: Path, fps: float | None) -> None:
        if path.stat().st_size == 0:
            raise InputError(path, "is empty")
        self.path = path
        self._given_fps = fps
        self._capture = _capture(path)
        self._next = 0
        declared_fps, count = self._capture.get(cv2.CAP_PROP_FPS), self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self._container = container_of(path)
        aspect = self._capture.get(cv2.CAP_PROP_SAR_NUM) / max(self._capture.get(cv2.CAP_PROP_SAR_DEN), 1.0)
        self.pixel_aspect = aspect if _ASPECTS[0] <= aspect <= _ASPECTS[1] else 1.0
        said = _sane_fps(declared_fps) and (self._container.timed or declared_fps != _FFMPEGS_OWN)
        self._fps_known = fps is not None or said
        self.fps = float(fps or (declared_fps if self._fps_known else DEFAULT_FPS))
        estimate = int(count) if np.isfinite(count) and 0 < count < 1e9 else None
        self.frame_count = estimate if self._container.counted else None
        lasts = self._container.shown or (None if estimate is None or not said else estimate / declared_fps)
        self._lasts = None if self._container.counted else lasts
        first = self._read()
        if first is None:
            raise InputError(path, "has no frame that can be decoded")
        self.image_size = (first.shape[1], first.shape[0])
        self.rate_known = self._fps_known or not any("assumed" in note for note in self._timing(self._stamps)[2])

    def frame(self, index: int) -> np.ndarray:
        """See `Clip.frame`."""
        if index < 0 or (index >= self._next + _READ_ON and index >= self.report.read):
            raise IndexError(f"{self.path} has no frame {index}")
        if not self._next <= index < self._next + _READ_ON and not self._seek(index):
            self._rewind()
        while self._next < index and self._capture.grab():
            self._next += 1
        image = self._read() if self._next == index else None
        if image is None:
            raise IndexError(f"{self.path} has no frame {index}")
        return image

    def frames(self, start: int = 0) -> Iterator[np.ndarray]:
        """See `Clip.frames`."""
        index = start
        while True:
            try:
                image = self.frame(index)
            except IndexError:
                return
            yield image
            index += 1

    @cached_property
    def report(self) -> ClipReport:
        """See `Clip.report`."""
        stamps = self._stamps
        notes: list[str] = []
        times, fps, timing = self._timing(stamps)
        if self.frame_count is not None and len(stamps) < self.frame_count:
            notes.append(f"ends early: {len(stamps)} of {self.frame_count} declared frames could be read")
        elif self._lasts is not None and self._given_fps is None and len(times):
            lasted = times[-1] + 1.0 / fps
            if lasted < self._lasts - max(_SHORT, _SHARE * self._lasts):
                notes.append(f"ends early: {lasted:.1f} of {self._lasts:.1f} declared seconds could be read")
        return ClipReport(self.frame_count, len(stamps), times, fps, tuple(notes) + timing)

    def close(self) -> None:
        """See `Clip.close`."""
        self._capture.release()
        self._next = 1 << 60  # any instant requested next lies before it

    @cached_property
    def _stamps(self) -> np.ndarray:
        """Presentation time of every frame [s], by one pass on a reader of its own."""
        capture = _capture(self.path)
        stamps = []
        while capture.grab():
            stamps.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
        capture.release()
        return np.array(stamps)

    def _timing(self, stamps: np.ndarray) -> tuple[np.ndarray, float, tuple[str, ...]]:
        """Frame times, rate and notes: the file's own stamps where they make sense, else a constant rate."""
        count = len(stamps)
        if count > 1 and self._given_fps is None and self._container.timed and _increasing(stamps):
            times = stamps - stamps[0]
            rate = (count - 1) / times[-1]
            if _sane_fps(rate) and (not self._fps_known or 0.25 < rate / self.fps < 4.0):
                intervals = np.diff(times)
                varies = intervals.max() > 1.5 * intervals.min()
                notes = ("the frame rate varies: the frames' own times are used",) if varies else ()
                return times, float(rate), notes
        known = ((),) if self._fps_known else ((f"no usable frame rate: {DEFAULT_FPS:g} assumed; give it with --fps",),)
        return np.arange(count) / self.fps, self.fps, known[0]

    def _read(self) -> np.ndarray | None:
        ok, image = self._capture.read()
        if not ok or image is None:
            return None
        self._next += 1
        return np.asarray(image, dtype=np.uint8)

    def _rewind(self) -> None:
        self._capture.release()
        self._capture = _capture(self.path)
        self._next = 0

    def _seek(self, index: int) -> bool:
        """Jump so that `index` is read next; False where the jump cannot be trusted.

        Containers differ in how exactly they seek, so the frame before is fetched and has to carry the time stamp
        it has when the clip is read from the start.
        """
        if index < _READ_ON or not self._capture.isOpened() or not _increasing(self._stamps):
            return False
        before = index - 1
        if not self._capture.set(cv2.CAP_PROP_POS_FRAMES, before) or not self._capture.grab():
            return False
        if abs(self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0 - self._stamps[before]) > 1e-4:
            return False
        self._next = index
        return True


def listed(folder: Path) -> list[Path]:
    """Files of a folder, except hidden ones."""
    try:
        return [p for p in folder.iterdir() if not p.name.startswith(".")]
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror}") from None


def natural_order(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Sort key that puts 2 before 10."""
    parts = re.split(r"([0-9]+)", path.name.lower())
    return [(0, int(p), "") if p.isdigit() else (1, 0, p) for p in parts], path.name


def _capture(path: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, _NO_TIMEOUTS)
    if not capture.isOpened():
        raise InputError(path, "is not a video that can be decoded", remedy="try converting it: ffmpeg -i IN out.mp4")
    return capture


def _sane_fps(fps: float) -> bool:
    return bool(np.isfinite(fps)) and FPS_RANGE[0] <= fps <= FPS_RANGE[1]


def _increasing(stamps: np.ndarray) -> bool:
    return len(stamps) > 1 and bool(np.isfinite(stamps).all()) and bool((np.diff(stamps) > 0.0).all())
