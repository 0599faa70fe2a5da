"""The work behind `kinemode.Tracker`: frames as they come -> observations -> results."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from estimator.data.cameras.camera import Camera
from estimator.data.floor import OFF, KnownFloor
from estimator.data.formats.cameras import declared_floor
from estimator.data.media.clip import DEFAULT_FPS, Clip, ClipReport
from estimator.data.observation import Observation
from estimator.trackers.base import energy_of
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import FrameByFrame
from estimator.tracking.smoothing import FixedLag
from estimator.vision.cues.learned import with_learned
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import CUES, CueSettings
from humanoid.kinematics.body import ROOT_PLACE_Q, Body
from humanoid.subject.keypoint_places import with_layout_places
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.indexing import with_index
from kinemode.initialisation import check_cue
from kinemode.inputs.declared import known_floor as given_floor
from kinemode.notices import warn
from kinemode.pictures import cue_choice
from kinemode.progress import unreported
from kinemode.request import StreamOptions
from kinemode.settings import Chosen, choose
from kinemode.streams.observing import Observer
from kinemode.streams.step import Delay, Step

_AHEAD, _WARM_UP, _RATE = 4.0, 3, 30.0  # m from the camera, frames, frames per second
Watcher = Callable[[Observation, FrameResult], None]
_KEPT = 2  # a cue reads a picture and the one before


@dataclass(frozen=True)
class Streamed:
    """The parts of a request by camera. backgrounds: images of the empty scene. floor: see `known_floor`. jitter:
    see `kinemode.Tracker`."""

    backgrounds: Mapping[str, Path]
    floor: KnownFloor = None
    jitter: float | Mapping[str, float] | None = None


def known_floor(request: StreamOptions, *, placed: bool) -> KnownFloor:
    """The floor that is given, or a camera file's; none is found in a stream. placed: whether a camera is given, which
    places the world.

    Raises
    ------
    InputError: a height without a camera, or without a lag.
    """
    given = given_floor(request.floor)
    if given is None:
        in_file = request.lag and isinstance(request.cameras, (str, Path))
        return declared_floor(request.cameras) if in_file else None  # type: ignore[arg-type] # it is a path
    if given != OFF and not placed:
        raise InputError("floor", "is of the cameras' world, and none is given", remedy="leave it out, or off")
    if given != OFF and not request.lag:
        raise InputError("floor", "needs smoothing, which is off", remedy="give a lag, as 8 frames")
    return given


class Stepper:
    """Tracks one body through frames that come one by one.

    watcher: is called with every frame as the tracker left it, before any lag.

    Attributes
    ----------
    body, cameras (C): what is tracked, and from where. chosen: the tracker with its settings; cues: the names of those
    that are used. frames: the tracker on its way.
    """

    def __init__(
        self,
        subject: Subject,
        cameras: tuple[Camera, ...],
        wanted: StreamOptions,
        streamed: Streamed,
        watcher: Watcher | None = None,
    ) -> None:
        subject = with_layout_places(subject, wanted.layout if isinstance(wanted.layout, str) else "")
        self.body, self.cameras = Body(subject), cameras
        chosen = choose(wanted.tracker, wanted.settings, wanted.modes)
        chosen.check(False)
        cues = _chosen_cues(wanted.cues, chosen)
        self.chosen, self.cues = with_index(chosen, subject, wanted.index, unreported), cues.used if cues else ()
        settings = self.chosen.settings if cues is None else replace(self.chosen.settings, cues=cues)
        tracker = make_tracker(wanted.tracker, self.body, settings)
        check_cue(tracker, wanted.tracker, self.cues)
        self.settings = settings
        self.notes = (*subject.notes, *chosen.notes(cues=cues, cameras=len(cameras), fits=False))
        for note in self.notes:
            warn(note)
        self.frames = FrameByFrame(tracker, wanted.seed)
        smoother = None
        if wanted.lag:
            search = energy_of(tracker, wanted.tracker)
            smoother = FixedLag(search, replace(settings.smooth, lag=wanted.lag), streamed.floor)
        self._delay = Delay(self.body, smoother, wanted.lag)
        self._observer = Observer(self.body, cameras, wanted.layout, streamed.jitter)
        self._streams = tuple(PictureStream(f"pictures of {c.name}", c.image_size) for c in cameras)
        self._reader = None if cues is None else self._opened(cues, streamed.backgrounds)
        self._threads = ThreadpoolController()
        self._shown: deque[Observation] = deque()
        self._watcher = watcher

    def warm_up(self) -> None:
        """Track three frames of the body standing before the camera, by a tracker that is then gone: the first frames
        of a process load compiled code, which takes a second."""
        q, (camera, *_) = self.body.neutral.copy(), self.cameras
        if self.body.has_free_root:
            q[ROOT_PLACE_Q] = camera.origin_world + _AHEAD * camera.R_camera_world[2]
        points = camera.project(self.body.landmarks(self.body.at(q)))
        pixels = np.full((len(self.cameras), *points.shape), np.nan)
        pixels[0] = points
        confidence = np.where(np.isfinite(pixels).all(axis=-1), 1.0, 0.0)
        frames = FrameByFrame(make_tracker(self.chosen.tracker, self.body, self.settings), 0)
        with self._threads.limit(limits=1):
            for i in range(_WARM_UP):
                frames.push(Observation(i, i / _RATE, self.cameras, pixels, confidence))

    def step(self, keypoints: Any, picture: Any, time: float) -> Step | None:
        """See `kinemode.Tracker.step`."""
        observation = self._observer.at(keypoints, time)
        if self._reader is not None:
            for stream, image in zip(self._streams, self._observer.pictures(picture), strict=True):
                stream.put(observation.index, image)
        elif picture is not None:
            raise InputError("picture", "is not used", remedy='leave it out, or name cues, as cues="edges,flow"')
        self._observer.accept()
        # the matrices are small: more threads only wait for each other
        with self._threads.limit(limits=1):
            if self._reader is not None:
                observation = replace(observation, cues=self._reader.at(observation.index))
            self._shown.append(observation)
            result = self.frames.push(observation)
            return None if result is None else self._done(result)

    def finish(self) -> list[Step]:
        """See `kinemode.Tracker.finish`."""
        with self._threads.limit(limits=1):
            steps = [self._done(result) for result in self.frames.rest()]
            return [step for step in (*steps, *self._delay.rest()) if step is not None]

    def _done(self, result: FrameResult) -> Step | None:
        observation = with_learned(self._shown.popleft(), result.extra)
        if self._watcher is not None:
            self._watcher(observation, result)
        return self._delay.push(observation, result)

    def _opened(self, cues: CueSettings, backgrounds: Mapping[str, Path]) -> CueReader:
        plates = [backgrounds.get(camera.name) for camera in self.cameras]
        return CueReader(self._streams, self.cameras, cues, plates=plates)


def _chosen_cues(given: str | Iterable[str], chosen: Chosen) -> CueSettings | None:
    """Settings of the cues to use, None for keypoints alone; raises InputError for invalid ones."""
    choice = cue_choice(given)
    if choice is None:
        raise InputError("cues", "auto needs a whole clip", remedy=f"off, or some of {', '.join(CUES)}")
    for name in choice:
        if CUES[name].needs_depth:
            raise InputError("cues", f"{name} needs depth, which a stream does not have", remedy="leave it out")
        if name not in chosen.settings.cues.used:
            raise InputError("cues", f"the settings switch {name} off", remedy=f"leave out cues.use_{name}")
    return chosen.settings.cues.using(choice) if choice else None


class PictureStream(Clip):
    """A clip that has no end: pictures are put in, the last two can be read.

    name: what errors call it.
    """

    def __init__(self, name: str, image_size: tuple[int, int]) -> None:
        self.path, self.image_size = Path(name), image_size
        self.fps, self.frame_count, self.rate_known = DEFAULT_FPS, None, False
        self._latest: dict[int, np.ndarray] = {}

    def put(self, index: int, picture: np.ndarray) -> None:
        """Take the picture (H, W, 3) uint8 BGR of a frame, the one after the frame that was put in before."""
        self._latest = {**{i: p for i, p in self._latest.items() if i > index - _KEPT}, index: picture}

    def frame(self, index: int) -> np.ndarray:
        """See `Clip.frame`; IndexError also for a picture that is not kept any more."""
        if index not in self._latest:
            raise IndexError(f"{self.path} has no frame {index}")
        return self._latest[index]

    def frames(self, start: int = 0) -> Iterator[np.ndarray]:
        """The available ones, see `Clip.frames`."""
        return (picture for index, picture in sorted(self._latest.items()) if index >= start)

    @cached_property
    def report(self) -> ClipReport:
        """There is none: raises InputError."""
        problem = "pictures that come one by one show no whole clip to learn a background or a floor from"
        raise InputError(str(self.path), problem, remedy="give a picture of the empty scene, or leave out that cue")
