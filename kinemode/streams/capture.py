"""Pictures as a camera takes them or a file has them; a reader too slow for all of them gets the newest."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

import cv2
import numpy as np

from estimator.data.media.clip import Clip
from humanoid.support.errors import InputError

Clock = Callable[[], float]
Pause = Callable[[float], None]
_AGAIN = 0.2  # s, how often a waiting reader checks for an interruption


@dataclass(frozen=True)
class CapturedPicture:
    """A picture (H, W, 3) uint8 BGR, its number among those that were taken, and when [s], the first at 0."""

    number: int
    time: float
    picture: np.ndarray


class CaptureDevice(Protocol):
    """A source of pictures. name: of its camera. image_size: width, height [px]. rate: frames per second."""

    name: str
    image_size: tuple[int, int]
    rate: float

    def shots(self) -> Iterator[CapturedPicture]:
        """The pictures, each when it is taken."""
        ...


class FileCamera:
    """A clip, played at its own rate, or as fast as it can be read where it is not `paced`.

    clock, pause: what time it is [s], and what waits for so many seconds. Raises InputError where it cannot be opened.
    """

    def __init__(self, path: Path, *, paced: bool, clock: Clock = time.monotonic, pause: Pause = time.sleep) -> None:
        self.path, self._paced, self._clock, self._pause = path, paced, clock, pause
        with closing(Clip.open(path)) as clip:
            self.image_size, self.rate = clip.image_size, clip.fps
        self.name = path.name if path.is_dir() else path.stem

    def shots(self) -> Iterator[CapturedPicture]:
        """See `CaptureDevice`."""
        begun = self._clock()
        with closing(Clip.open(self.path)) as clip:
            for i, picture in enumerate(clip.frames()):
                at = i / self.rate
                if self._paced:
                    self._pause(max(0.0, begun + at - self._clock()))
                yield CapturedPicture(i, at, picture)


class DeviceCamera:
    """A camera of this machine, by its number. Raises InputError where there is none or it gives no picture."""

    def __init__(self, number: int) -> None:
        self.name = f"camera{number}"
        self._capture = cv2.VideoCapture(number)
        taken, picture = self._capture.read() if self._capture.isOpened() else (False, None)
        if not taken or picture is None:
            self._capture.release()
            raise InputError(f"camera {number}", "gives no picture", remedy="is it plugged in, and free?")
        self.image_size = (picture.shape[1], picture.shape[0])
        self.rate = float(self._capture.get(cv2.CAP_PROP_FPS)) or 30.0

    def shots(self) -> Iterator[CapturedPicture]:
        """See `CaptureDevice`; until it gives none any more."""
        begun, number = time.monotonic(), 0
        try:
            while True:
                taken, picture = self._capture.read()
                if not taken or picture is None:
                    return
                yield CapturedPicture(number, time.monotonic() - begun, np.asarray(picture, dtype=np.uint8))
                number += 1
        finally:
            self._capture.release()


class LatestFrameQueue:
    """Takes pictures in a thread of its own and hands out the newest; those that were overtaken are dropped.

    A context manager: the thread ends with it, at the next picture.

    patience [s]: how long that picture is waited for.

    Attributes
    ----------
    dropped: how many were overtaken.
    """

    def __init__(self, shots: Iterable[CapturedPicture], *, patience: float = 1.0) -> None:
        self._shots, self._patience = shots, patience
        self._news = threading.Condition()
        self._waiting: CapturedPicture | None = None
        self._over = self._left = False
        self._error: Exception | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._take, name="pictures", daemon=True)

    def __enter__(self) -> LatestFrameQueue:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._news:
            self._left = True
        self._thread.join(timeout=self._patience)

    def __iter__(self) -> Iterator[CapturedPicture]:
        """The newest picture each time, waiting for one that was not handed out; raises what went wrong."""
        while True:
            with self._news:
                while self._waiting is None and not self._over:
                    self._news.wait(_AGAIN)  # without a limit Ctrl-C would wait, too, on some systems
                shot, self._waiting = self._waiting, None
            if shot is None:
                if self._error is not None:
                    raise self._error
                return
            yield shot

    def _take(self) -> None:
        try:
            for shot in self._shots:
                with self._news:
                    if self._left:
                        return
                    self.dropped += self._waiting is not None
                    self._waiting = shot
                    self._news.notify_all()
        except Exception as error:  # the reader gets it
            self._error = error
        finally:
            with self._news:
                self._over = True
                self._news.notify_all()
