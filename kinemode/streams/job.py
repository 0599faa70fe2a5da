"""The work behind `kinemode.live`: what the user names, made into a session, its preview and its run."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.data.observation import Observation
from estimator.trackers.frame_result import FrameResult
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.detection.detectors import DetectorChoice
from kinemode.inputs.load import camera_for
from kinemode.notices import InputWarning
from kinemode.streams.capture import CaptureDevice, CapturedPicture, DeviceCamera, FileCamera
from kinemode.streams.recording import Recording, live_header, recording
from kinemode.streams.session import Session, Show, run_session
from kinemode.streams.sources import Detecting, KeypointSource, PlayedBack
from kinemode.streams.step import Step
from kinemode.streams.stepper import StepOptions, Stepper
from viz.preview.moving import Moment, MovingPreview

if TYPE_CHECKING:
    from kinemode.inputs.files import Cameras

Ready = Callable[[str], None]


@dataclass(frozen=True)
class LiveOptions:
    """Arguments of `kinemode.live`, of the same names, which have been checked; of `detect` what it names."""

    keypoints: Path | KeypointSource | DetectorChoice
    cameras: Cameras
    camera: str | None
    background: Path | None
    realtime: bool
    out: Path | None
    show: bool
    port: int
    open_browser: bool
    ready: Ready


def track_live(subject: Subject, device: int | Path, wanted: LiveOptions, how: StepOptions) -> Session:
    """What `kinemode.live` does once its arguments are known to be of the right kinds."""
    taking: CaptureDevice = (
        DeviceCamera(device) if isinstance(device, int) else FileCamera(device, paced=wanted.realtime)
    )
    name = wanted.camera or taking.name
    camera, notes = camera_for(name, taking.image_size, wanted.cameras, chosen=wanted.camera is not None)
    kept: list[Recording] = []

    def watch(observation: Observation, result: FrameResult) -> None:
        for each in kept:
            each.keep(stepper, observation, result)

    with ExitStack() as stack:
        source, how, more = _keypoints(wanted.keypoints, name, taking, how, stack)
        for note in (*notes, *more):
            warnings.warn(note, InputWarning, stacklevel=3)
        if wanted.background is not None:
            how = replace(how, backgrounds={camera.name: wanted.background})
        stepper = Stepper(subject, (camera,), how, watch)
        header = live_header(stepper, how.seed, None if isinstance(device, int) else device)
        if wanted.out is not None:
            kept.append(stack.enter_context(recording(wanted.out, replace(header, notes=(*header.notes, *notes)))))
        show = stack.enter_context(_preview(stepper, wanted)) if wanted.show else _unseen
        every = isinstance(device, Path) and not wanted.realtime
        if not every:
            stepper.warm_up()
        session = run_session(taking.shots(), source, stepper, show, every=every)
        for each in kept:
            each.finish(header, session.pictures)
    return session


def _keypoints(
    given: Path | KeypointSource | DetectorChoice, name: str, taking: CaptureDevice, how: StepOptions, stack: ExitStack
) -> tuple[KeypointSource, StepOptions, tuple[str, ...]]:
    """Where the keypoints come from, ended with the stack; the options with what they are called, and notes."""
    if isinstance(given, DetectorChoice):
        detecting = stack.enter_context(Detecting(given))
        return detecting, replace(how, layout=detecting.layout), ()
    if not isinstance(given, Path):
        return given, how, ()
    if isinstance(taking, DeviceCamera):
        raise InputError(given, "is of pictures that were taken before", remedy="name the clip that it is of")
    played = PlayedBack(given, name, taking.image_size, taking.rate)
    return played, replace(how, layout=tuple(n or f"keypoint_{i}" for i, n in enumerate(played.names))), played.notes


def _unseen(step: Step, shot: CapturedPicture, dropped: int) -> None:
    """Nobody looks."""


@contextmanager
def _preview(stepper: Stepper, wanted: LiveOptions) -> Iterator[Show]:
    most = getattr(stepper.settings.own, "modes", 1)
    with MovingPreview(stepper.body, stepper.cameras, most, port=wanted.port) as preview:
        wanted.ready(preview.address)
        if wanted.open_browser:
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
