"""The work behind `kinemode.live`: what the user names, made into a session, its preview and its run."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.data.observation import Observation
from estimator.trackers.frame_result import FrameResult
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.detection.detectors import DetectorChoice
from kinemode.inputs.load import camera_for
from kinemode.kinds import KeypointSource
from kinemode.notices import InputWarning
from kinemode.request import LiveRequest
from kinemode.streams.capture import CaptureDevice, CapturedPicture, DeviceCamera, FileCamera
from kinemode.streams.recording import Recording, live_header, recording
from kinemode.streams.session import Session, Show, run_session
from kinemode.streams.sources import Detecting, PlayedBack
from kinemode.streams.step import Step
from kinemode.streams.stepper import Stepper, Streamed, known_floor
from viz.preview.moving import Moment, MovingPreview

if TYPE_CHECKING:
    from kinemode.request import Layout


Ready = Callable[[str], None]


def track_live(subject: Subject, device: int | Path, request: LiveRequest) -> Session:
    """What `kinemode.live` does once its arguments are checked."""
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
            warnings.warn(note, InputWarning, stacklevel=3)
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
