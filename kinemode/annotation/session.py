"""One clip being annotated: what the page shows, and what it saves."""

from __future__ import annotations

from pathlib import Path
from threading import Lock
from typing import Any

import cv2

from estimator.data.formats.checked_json import mapping, member
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.media.clip import Clip
from kinemode.annotation.clicks import clicks_for_page, clicks_from_page
from kinemode.annotation.landmark_guide import LandmarkGuide
from viz.palette import SIDES

_POINT_BYTES = 90  # three numbers and the signs around them as JSON writes them, generously


class Annotation:
    """The session that `annotate_server` serves; requests may come at the same time.

    Attributes
    ----------
    clip, guide: the frames, and the landmarks to click.
    track: the points there are: at first those found in files, then those last saved.
    frame, camera: shown first; name of the view.
    out: the file to write. command: what to do with it next.
    saves: how often the page has saved.
    largest_post: bytes of every landmark in every frame.
    """

    def __init__(
        self, clip: Clip, guide: LandmarkGuide, track: KeypointTrack, frame: int, camera: str, out: Path, command: str
    ) -> None:
        self.clip, self.guide, self.track = clip, guide, track
        self.frame, self.camera, self.out, self.command = frame, camera, out, command
        self.saves = 0
        points = sum(len(name.encode("utf-8")) + _POINT_BYTES for name in guide.names)
        self.largest_post = 4096 + track.frame_count * (16 + points)
        self._reading, self._writing = Lock(), Lock()

    def state(self) -> dict[str, Any]:
        """Everything the page needs at its start, for JSON; points as `clicks_for_page` gives them."""
        guide, track = self.guide, self.track
        landmarks = zip(guide.names, guide.sides, guide.about, strict=True)
        return {
            "clip": self.clip.path.name,
            "camera": self.camera,
            "out": str(self.out),
            "image_size": track.image_size,
            "frame_count": track.frame_count,
            "frame": self.frame,
            "landmarks": [{"name": name, "side": side, "about": about} for name, side, about in landmarks],
            "edges": guide.edges,
            "colours": {side: "rgb({}, {}, {})".format(*colour) for side, colour in SIDES.items()},
            "frames": clicks_for_page(track),
        }

    def picture(self, index: int) -> bytes:
        """Frame `index` as PNG, every pixel as decoded; raises IndexError where the clip has none."""
        with self._reading:
            image = self.clip.frame(index)
        return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()

    def save(self, posted: Any) -> dict[str, Any]:
        """Write what the page sent, {"frames": see `clicks_from_page`}, and return the answer.

        Raises InputError where anything in it is wrong, or the file cannot be written; then the file stays as it was.
        """
        frames = member(mapping(posted, "the page"), "frames", "the page", "")
        with self._writing:
            track = clicks_from_page(frames, self.track)
            write_keypoints(self.out, track)
            self.track = track
            self.saves += 1
        there = track.confidence > 0.0
        counts = {"points": int(there.sum()), "frames": int(there.any(axis=1).sum())}
        return {"out": str(self.out), "command": self.command, **counts}
