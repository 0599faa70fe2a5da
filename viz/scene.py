"""A run's arrays and pictures for drawing, without the run file, and a viewpoint that no camera has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.clip import Clip
from estimator.runs.contact import Contact, contact_of_run
from estimator.runs.filtering import evenly_spaced, frame_rate
from estimator.runs.forces import Forces
from estimator.runs.run_reader import Run
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from viz.source_figure import SourceFigure, heading, source_figure

Frames = Callable[..., Iterable[np.ndarray]]
"""Opens a clip's frames, from the first on or from the one that is given."""


@dataclass(frozen=True)
class Scene:
    """T instants of a body in front of C cameras, with up to K hypotheses each.

    cameras (C). frames (C): opens each camera's clip as BGR images; None without pictures.
    index (T,) int: number of each instant. time (T,) [s]. status (T): see `FrameResult`.
    q (T, nq): the best hypothesis, NaN where there is none. path (T,) int: which mode it is, -1 for none.
    mode_q (T, K, nq), mode_weight (T, K): all hypotheses, NaN where there are fewer.
    pixels (T, C, L, 2) [px], confidence (T, C, L): keypoints of the body's landmarks, NaN and 0 where missing.
    clip_frames (C): number of each clip's frame at each instant (T,), None where that is `index`.
    interval (T, 2, nq): ends of the calibrated 90 % interval of joints with one coordinate in q, NaN elsewhere; None
    where it is not known. contact: gives when the feet stand, and on what floor; None without it. source: the motion
    that the body follows, drawn beside it; None where it was tracked. forces: on the feet, drawn as arrows; None where
    they are not known.
    """

    body: Body
    cameras: tuple[Camera, ...]
    frames: tuple[Frames | None, ...]
    index: np.ndarray
    time: np.ndarray
    status: tuple[str, ...]
    q: np.ndarray
    mode_q: np.ndarray
    mode_weight: np.ndarray
    path: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray
    clip_frames: tuple[np.ndarray | None, ...] = ()
    interval: np.ndarray | None = None
    contact: Callable[[], Contact | None] = lambda: None
    source: SourceFigure | None = None
    forces: Forces | None = None

    def __len__(self) -> int:
        return len(self.time)

    def has_body(self, t: int) -> bool:
        """There is a best hypothesis at instant t."""
        return bool(np.isfinite(self.q[t]).all())

    @property
    def rate(self) -> float:
        """Instants per second, 30 where there is only one; the usual one where they are not evenly spaced."""
        span = float(self.time[-1] - self.time[0]) if len(self) > 1 else 0.0
        if not span > 0.0:
            return 30.0
        return (len(self) - 1) / span if evenly_spaced(self.time) else frame_rate(self.time)

    def paced(self, frames: Iterable[np.ndarray], rows: range) -> Iterator[np.ndarray]:
        """The pictures of some instants as a film of `rate` shows them for as long as they last: of unevenly spaced
        instants some more than once, or not at all."""
        if len(rows) < 3 or evenly_spaced(self.time[rows]):
            yield from frames
            return
        time, rate = self.time[rows], self.rate
        instants = time[0] + np.arange(round((time[-1] - time[0]) * rate) + 1) / rate
        shown = np.clip(np.searchsorted(time, instants + 0.5 / rate, side="right") - 1, 0, len(rows) - 1)
        for picture, count in zip(frames, np.bincount(shown, minlength=len(rows)), strict=True):
            yield from [picture] * int(count)

    def others(self, t: int) -> list[tuple[int, np.ndarray, float]]:
        """(index, q, weight) of the hypotheses at instant t other than the best one, lightest first."""
        modes = [
            (k, self.mode_q[t, k], float(self.mode_weight[t, k]))
            for k in range(self.mode_q.shape[1])
            if k != self.path[t] and np.isfinite(self.mode_q[t, k]).all() and self.mode_weight[t, k] > 0.0
        ]
        return sorted(modes, key=lambda mode: mode[2])

    def frame_of(self, camera: int, t: int) -> int:
        """Number of a camera's clip frame at instant t."""
        own = self.clip_frames[camera] if self.clip_frames else None
        return int(self.index[t] if own is None else own[t])

    def label(self, camera: int, t: int) -> str:
        """The instant's number, and that of the camera's clip frame where it is another."""
        frame = self.frame_of(camera, t)
        return f"frame {self.index[t]}" + ("" if frame == self.index[t] else f" (clip {frame})")

    def images(self, camera: int, rows: Sequence[int]) -> Iterator[np.ndarray | None]:
        """The picture of one camera at each of the given instants (ascending); None where there is none."""
        opener = self.frames[camera]
        first = self.frame_of(camera, rows[0]) if len(rows) else 0
        stream = iter(()) if opener is None else iter(opener(first) if first else opener())
        position, image = first - 1, None
        for t in rows:
            while position < self.frame_of(camera, t):
                image = next(stream, None)
                position += 1
                if image is None:
                    break
            yield image


def as_scene(source: Scene | Run) -> Scene:
    """The content of a run file so far, with its clips where available.

    Raises InputError for a run without a single tracked frame.
    """
    if isinstance(source, Scene):
        return source
    run, cameras = source, source.header.cameras
    if len(run) == 0 or not np.isfinite(run.q).all(axis=1).any():
        raise InputError(run.file, "contains no tracked frames", remedy="track with --resume first")
    pixels, confidence = run.pixels[: len(run)], run.confidence[: len(run)]
    if len(pixels) < len(run):
        shape = (len(run), len(cameras), len(run.body.landmark_names))
        pixels, confidence = np.full((*shape, 2), np.nan), np.zeros(shape)
    frames = tuple(_opener(run.header.clips.get(camera.name)) for camera in cameras)
    status = tuple(str(s) for s in run.status)
    return Scene(
        run.body, cameras, frames, run.index, run.time, status, run.q, run.mode_q, run.mode_weight, run.path,
        pixels, confidence, tuple(_own_frames(run, camera.name) for camera in cameras),
        None if run.header.retargeted else run.interval(0.9),
        partial(contact_of_run, run), source_figure(run),
    )  # fmt: skip


def _own_frames(run: Run, camera: str) -> np.ndarray | None:
    return run.header.frames_of(camera)[: len(run)] if camera in run.header.clip_frames else None


def _opener(clip: str | None) -> Frames | None:
    """Opens a clip's frames each time; None where the clip is missing."""
    if clip is None or not Path(clip).exists():
        return None

    def frames(start: int = 0) -> Iterator[np.ndarray]:
        opened = Clip.open(clip)
        try:
            yield from opened.frames(start)
        finally:
            opened.close()

    return frames


def evenly(count: int, wanted: int) -> list[int]:
    """At most `wanted` of `count` instants, evenly spaced, first and last included."""
    return sorted(set(np.linspace(0, count - 1, min(count, wanted)).round().astype(int).tolist()))


NAME = "view"
_SIZE, _WIDE = (640, 480), (960, 540)  # of one, and of two beside each other
_BESIDE = 40.0  # of the direction that the body faces, to its left [deg]
_FRAMES = 200  # that the camera is to hold


def pictured_scene(source: Scene | Run) -> Scene:
    """`as_scene`; where no camera saw the body, as seen by one from the front and a little from the side, without a
    picture.

    Raises InputError for a run without a single tracked frame.
    """
    scene = as_scene(source)
    if scene.cameras:
        return scene
    known = np.flatnonzero(np.isfinite(scene.q).all(axis=1))
    some = known[np.unique(np.linspace(0, len(known) - 1, _FRAMES).round().astype(int))]
    points = _seen(scene, some)
    size = _SIZE if scene.source is None else _WIDE
    settings = ViewSettings(azimuth=heading(scene.body, scene.q) + _BESIDE, image_size=size)
    (camera,) = framing_cameras(points, settings)
    shape = (len(scene), 1, len(scene.body.landmark_names))
    return replace(
        scene, cameras=(replace(camera, name=NAME, distortion=np.zeros(5)),), frames=(None,), clip_frames=(None,),
        pixels=np.full((*shape, 2), np.nan), confidence=np.zeros(shape),
    )  # fmt: skip


def _seen(scene: Scene, rows: np.ndarray) -> np.ndarray:
    """Points (T, N, 3) [m] that are to be in the picture at instants `rows` (T,): the body's landmarks; where it stands
    beside its source, the source's too, and the body's joints, as not all robots have a landmark on their heads."""
    placed = scene.body.placed(scene.q[rows])
    landmarks = scene.body.landmarks_of(placed)
    if scene.source is None:
        return landmarks
    beside = scene.source.points[rows]
    joints = placed.placements[:, 1:, 9:]
    beside = np.where(np.isfinite(beside), beside, joints[:, :1])  # what is missing widens nothing
    return np.concatenate([landmarks, joints, beside], axis=1)
