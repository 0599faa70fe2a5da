"""The work behind `kinemode.live`: what the user names, made into a session, its preview and its run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.data.formats.keypoints import load_keypoints
from estimator.data.observation import Observation
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import FrameResult
from estimator.vision.resolution import Size, fitted_track
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode import __version__
from kinemode.detection.detectors import DetectorChoice
from kinemode.detection.people import People, Seen
from kinemode.detection.process import DetectorProcess
from kinemode.findings import run_findings
from kinemode.inputs.cameras import camera_for
from kinemode.kinds import KeypointSource
from kinemode.named import PathLike
from kinemode.notices import warn
from kinemode.request import LiveRequest
from kinemode.streams.capture import CaptureDevice, CapturedPicture, DeviceCamera, FileCamera
from kinemode.streams.session import Session, Show, run_session
from kinemode.streams.step import Step
from kinemode.streams.stepper import Stepper, Streamed, known_floor
from viz.preview.moving import Moment, MovingPreview

if TYPE_CHECKING:
    from kinemode.request import Layout


def track_live(subject: Subject, device: int | Path, request: LiveRequest) -> Session:
    """The work of `kinemode.live` after its arguments are checked."""
    taking: CaptureDevice = (
        DeviceCamera(device) if isinstance(device, int) else FileCamera(device, paced=request.realtime)
    )
    name = request.camera or taking.name
    camera, notes = camera_for(name, taking.image_size, request.cameras, chosen=request.camera is not None)
    kept: list[Recording] = []

    def watch(observation: Observation, result: FrameResult) -> None:
        for each in kept:
            each.keep(stepper, observation, result)

    with ExitStack() as stack:
        source, layout, more = _keypoints(request, name, taking, stack)
        for note in (*notes, *more):
            warn(note)
        plates = {} if request.background is None else {camera.name: Path(request.background)}
        floor = known_floor(request, placed=request.cameras is not None)
        stepper = Stepper(subject, (camera,), replace(request, layout=layout), Streamed(plates, floor), watch)
        header = live_header(stepper, request.seed, None if isinstance(device, int) else device)
        noted = (*header.notes, *notes)
        if request.out is not None:
            kept.append(stack.enter_context(recording(Path(request.out), replace(header, notes=noted))))
        show = stack.enter_context(_preview(stepper, request)) if request.show else _unseen
        every = isinstance(device, Path) and not request.realtime
        if not every:
            stepper.warm_up()
        session = run_session(taking.shots(), source, stepper, show, every=every)
        for each in kept:
            each.finish(header, session.pictures)
    return session


def _keypoints(
    request: LiveRequest, name: str, taking: CaptureDevice, stack: ExitStack
) -> tuple[KeypointSource, Layout, tuple[str, ...]]:
    """Where the keypoints come from, ended with the stack; their layout, and notes."""
    if request.keypoints is None:
        detecting = stack.enter_context(Detecting(DetectorChoice.of(request)))
        return detecting, detecting.layout, ()
    if not isinstance(request.keypoints, (str, Path)):
        return request.keypoints, request.layout, ()
    path = Path(request.keypoints)
    if isinstance(taking, DeviceCamera):
        raise InputError(path, "is of images that were taken before", remedy="name the clip that it is of")
    played = PlayedBack(path, name, taking.image_size, taking.rate)
    return played, tuple(n or f"keypoint_{i}" for i, n in enumerate(played.names)), played.notes


def _unseen(step: Step, shot: CapturedPicture, dropped: int) -> None:
    """Nobody looks."""


@contextmanager
def _preview(stepper: Stepper, request: LiveRequest) -> Iterator[Show]:
    most = getattr(stepper.settings.own, "modes", 1)
    with MovingPreview(stepper.body, stepper.cameras, most, port=request.port) as preview:
        (request.ready or _print_address)(preview.address)
        if request.browser:
            preview.open_browser()

        def show(step: Step, shot: CapturedPicture, dropped: int) -> None:
            note = f"{dropped} dropped" if dropped else ""
            preview.show(
                Moment(step.index, shot.time, step.status, step.q, step.hypotheses, step.weights, (shot.picture,), note)
            )

        try:
            yield show
        finally:
            preview.end("ended")


def _print_address(address: str) -> None:
    print(f"{address} shows it; Ctrl-C ends it", flush=True)


class Recording:
    """Keeps every frame of a stepper that it is called with."""

    def __init__(self, writer: RunWriter) -> None:
        self._writer = writer
        self._seen: list[Observation] = []

    def keep(self, stepper: Stepper, observation: Observation, result: FrameResult) -> None:
        """One frame, with the tracker's state after it."""
        self._seen.append(replace(observation, cues=()))  # the pictures' cues would fill the memory
        self._writer.append(result, stepper.frames.stored())

    def finish(self, header: RunHeader, frames: list[int]) -> None:
        """Complete the run; frames: the number of the clip's frame of each that the stepper was given."""
        writer = self._writer
        seen = self._seen[: writer.settle()]  # observations are stored first
        kept = tuple(frames[o.index] for o in seen)
        own = kept != tuple(range(len(kept)))
        names = [camera.name for camera in header.cameras] if own else []
        times = np.array([o.time for o in seen], dtype=np.float64)
        writer.put_header(replace(header, times=times, clip_frames=dict.fromkeys(names, kept)))
        writer.put_observations(seen)
        writer.put_findings(*(run_findings(Run.open(writer.path)) if seen else ((), ())))
        writer.finish()


@contextmanager
def recording(path: Path, header: RunHeader) -> Iterator[Recording]:
    """The file appears when the block ends well; raises InputError where it cannot be written."""
    with replacing(path) as temporary, RunWriter.create(temporary, header, overwrite=True) as writer:
        yield Recording(writer)


def live_header(stepper: Stepper, seed: int, clip: Path | None) -> RunHeader:
    """The inputs of a stepper's run without its times; clip: the file that the pictures are from."""
    subject, (camera,) = stepper.body.subject, stepper.cameras
    return RunHeader(
        subject_urdf=subject.urdf,
        subject_source=subject.source,
        subject_base=subject.base,
        cameras=stepper.cameras,
        clips={camera.name: None if clip is None else str(clip.absolute())},
        image_sizes={camera.name: camera.image_size},
        times=np.zeros(0),
        tracker=stepper.chosen.tracker,
        settings={**stepper.settings.to_dict(), "fit": "off", "person": "auto"},
        seed=seed,
        version=__version__,
        notes=stepper.notes,
        cues=stepper.cues,
    )


class PlayedBack:
    """The keypoints of a file, by time.

    path: of the file. picture: size [px] of the pictures that it is played beside. rate: frames per second of these,
    for a file that declares none.

    Attributes
    ----------
    names (K): landmark of each keypoint, None where none corresponds. notes: for the user.

    Raises
    ------
    InputError: as `estimator.data.formats.keypoints.load_keypoints`; keypoints of pictures of another aspect.
    """

    def __init__(self, path: PathLike, name: str, picture: Size, rate: float) -> None:
        track = load_keypoints(path, image_size=picture)
        fitted, notes = fitted_track(name, track, track.image_size, picture)
        self.names, self.notes = fitted.names, (*track.notes, *notes)
        self._rate = track.fps or rate
        self._points = np.concatenate([fitted.pixels, fitted.confidence[..., None]], axis=2)

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """See `KeypointSource`: those of the frame nearest in time, None after the last."""
        frame = round(time * self._rate)
        return self._points[frame] if frame < len(self._points) else None


class Detecting:
    """A running detector as a source of keypoints; a context manager, which ends it.

    It stays with the person who was largest at first, and takes the largest when that number no longer
    more.

    Raises
    ------
    InputError: a detector that cannot be had or fails.
    """

    def __init__(self, wanted: DetectorChoice) -> None:
        self._process = DetectorProcess(wanted)
        self._people = People(wanted.most)
        self._person: int | None = None

    @property
    def layout(self) -> str | tuple[str, ...]:
        """The keypoints' layout, as a name or a list of names; "auto": by their count."""
        names = self._process.names
        return self._process.layout or (tuple(names) if names else "auto")

    def __enter__(self) -> Detecting:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.close()

    def __call__(self, picture: np.ndarray, time: float, /) -> np.ndarray | None:
        """See `KeypointSource`."""
        seen = self._people.see(self._process, picture)
        if self._person not in self._people.lost and self._person not in seen:
            self._person = max(seen, key=lambda number: _size(seen[number]), default=None)
        return seen[self._person]["keypoints"] if self._person in seen else None


def _size(person: Seen) -> float:
    return float(np.hypot(*np.ptp(person["keypoints"][:, :2], axis=0)))
