"""A film of the live view on the demonstration's clip, as it is in docs/pictures: an mp4, and a GIF for pages.

Every frame is waited for until the browser has drawn it, which without a graphics card takes longer than tracking it;
the film has the clip's rate, not that of this machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import kinemode as km
from benchmarks.support.browser import opened_browser, programs
from benchmarks.support.common import Work, tell, work_folder
from estimator.data.media.film import write_film
from humanoid.support.errors import InputError
from kinemode.demo import CAMERA, FPS, make_clip
from kinemode.target import made_folder

SIZE = (720, 640)  # px, of the window
TURN = 0.5  # share of the clip after which it is seen from the side
PATIENCE = 30.0  # s that a frame is waited for
GIF_EVERY = 3  # of the pictures, or it would be larger than a megabyte


def main(*, out: Path, frames: int | None = None, work: Work = None) -> None:
    """Render the clip, fit the person, track it live in front of a browser.

    Parameters
    ----------
    out
        The film, an mp4; a GIF of every third picture is written beside it.
    frames
        Only so many of the first.
    """
    if programs() is None:
        raise InputError("chromium", "and its chromedriver are not installed")
    with work_folder(work) as folder:
        clip = make_clip(folder / "clip", frames=frames)
        files: dict[str, Any] = {"cameras": clip.cameras, "keypoints": {CAMERA: clip.keypoints[CAMERA]}}
        person = km.fit("human34", None, **files).subject
        seen = km.load_keypoints(clip.keypoints[CAMERA])
        points = np.concatenate([seen.pixels, seen.confidence[..., None]], axis=2)
        with opened_browser(made_folder(folder / "profile")) as browser:
            browser.set_window_size(*SIZE)
            film = Film(browser, points)
            session = km.live(
                clip.videos[CAMERA], keypoints=film, subject=person, cameras=clip.cameras, camera=CAMERA,
                layout=seen.layout, realtime=False, browser=False, ready=browser.get,
            )  # fmt: skip
            film.take(len(points) - 1)
    tell(session.summary())
    write_film(out, film.pictures, FPS)
    gif = write_film(out.with_suffix(".gif"), film.pictures[::GIF_EVERY], FPS / GIF_EVERY)
    for written in (out, gif):
        tell(f"{written}: {written.stat().st_size / 1e6:.2f} MB")


class Film:
    """Gives the keypoints (T, K, 3) of each frame when the one before was drawn and its picture taken."""

    def __init__(self, browser: Any, points: np.ndarray) -> None:
        self._browser, self._points = browser, points
        self.pictures: list[np.ndarray] = []

    def __call__(self, picture: np.ndarray, at: float) -> np.ndarray:
        """See `kinemode.kinds.KeypointSource`."""
        frame = round(at * FPS)
        if frame > 0:
            self.take(frame - 1)
        return self._points[frame]

    def take(self, frame: int) -> None:
        """Take the picture of a frame."""
        drawn = f"return typeof shownLast === 'number' && shownLast === {frame} && !viewer.needs_render"
        self._wait(lambda: bool(self._browser.execute_script(drawn)))
        if frame == int(TURN * len(self._points)):
            self._browser.execute_script("look(-1)")
            self._wait(lambda: bool(self._browser.execute_script("return !viewer.needs_render")))
        png = np.frombuffer(self._browser.get_screenshot_as_png(), np.uint8)
        self.pictures.append(np.asarray(cv2.imdecode(png, cv2.IMREAD_COLOR), dtype=np.uint8))

    @staticmethod
    def _wait(done: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not done():
            if time.monotonic() > end:
                raise InputError("chromium", "does not draw the page")
            time.sleep(0.02)
