"""`live`: a camera or a file tracked while somebody looks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinemode.inputs.files import check_exists
from kinemode.inputs.named import PathLike
from kinemode.public.arguments import check_arguments, check_as, whole
from kinemode.public.detection import wanted_detector
from kinemode.public.tracking import loaded_subject
from kinemode.target import RunTarget

if TYPE_CHECKING:
    from kinemode.inputs.files import Cameras
    from kinemode.public.tracking import SubjectLike
    from kinemode.streams.session import Session
    from kinemode.streams.sources import KeypointSource


def live(
    source: int | PathLike = 0,
    *,
    keypoints: PathLike | KeypointSource | None = None,
    detect: str | Mapping[str, Any] = "mediapipe",
    subject: SubjectLike = "human34",
    cameras: Cameras = None,
    camera: str | None = None,
    layout: str | Sequence[str] = "auto",
    cues: str | Iterable[str] = "off",
    background: PathLike | None = None,
    tracker: str = "css",
    modes: int | None = None,
    settings: Mapping[str, Any] | PathLike | None = None,
    seed: int = 0,
    lag: int = 0,
    index: PathLike | None = None,
    floor: float | str = "auto",
    realtime: bool = True,
    out: PathLike | None = None,
    overwrite: bool = False,
    show: bool = True,
    port: int = 0,
    open_browser: bool = True,
    ready: Callable[[str], None] | None = None,
) -> Session:
    """Track a camera, or a file as if it were one, with a preview that moves; until it ends, or Ctrl-C.

    A picture that is overtaken by the next one while another is tracked is dropped.

    Parameters
    ----------
    source: the number of a camera of this machine, or a clip, which is played at its own rate.
    keypoints: what finds the person: a function of a picture (H, W, 3) uint8 BGR and its time [s] that gives keypoints
        (K, 3), x, y [px] and confidence, or None; or a keypoint file of the clip, which is played back. Without them
        a detector finds the largest person. detect: its name, or a mapping of arguments of `kinemode.detect`.
    subject: who, taken as it is; `kinemode.fit` fits one to a person beforehand.
    cameras: a camera file, or cameras by name; guessed unless given. camera: the name of the one that is looked
        through, where it is not the clip's.
    layout, cues, tracker, modes, settings, seed, lag, index, floor: as `kinemode.Tracker` has them. background: a
        picture of the empty scene.
    realtime: False tracks every picture of a clip, however long that takes.
    out: the run file, there when it is over; its poses are those of the tracker, not smoothed. overwrite: replace it.
    show: whether there is a preview. port: of it, on this machine alone; 0 takes a free one. open_browser: whether it
        is opened. ready: called with its address, which is printed unless it is given.

    Returns
    -------
    What became of it: pictures that were tracked and dropped, statuses, seconds.

    Raises
    ------
    InputError: no such camera or clip, a detector that cannot be had; and as `kinemode.Tracker`.
    """
    check_arguments(
        subject=subject, cameras=cameras, camera=camera, layout=layout, cues=cues, tracker=tracker, modes=modes,
        settings=settings, index=index, floor=floor, realtime=realtime, out=out, overwrite=overwrite, show=show,
        open_browser=open_browser,
    )  # fmt: skip
    check_as("one file", background=background)
    seed, lag, port = whole("seed", seed, 0), whole("lag", lag, 0), whole("port", port, 0)
    device = _device(source)
    finder = wanted_detector(**_named(detect)) if keypoints is None else _finder(keypoints)
    for path in (cameras, settings, index, background):
        if isinstance(path, (str, Path)):
            check_exists(path)
    if out is not None:
        RunTarget(Path(out), False, overwrite).check()
    loaded = loaded_subject(subject)
    from kinemode.streams.job import LiveOptions, track_live
    from kinemode.streams.known_floor import stream_floor
    from kinemode.streams.stepper import StepOptions

    plate = None if background is None else Path(background)
    wanted = LiveOptions(
        finder, cameras, camera, plate, realtime, None if out is None else Path(out), show, port, open_browser,
        ready or _print_address,
    )  # fmt: skip
    known = stream_floor(floor, cameras, lag, cameras is not None)
    how = StepOptions(layout, cues, None, tracker, modes, settings, seed, lag, None, index, known)
    return track_live(loaded, device, wanted, how)


def _device(source: int | PathLike) -> int | Path:
    """The number of a camera, also as text, or the path of a clip that is there."""
    if not isinstance(source, (str, Path)):
        return whole("source", source, 0)
    if str(source).isdecimal():
        return whole("source", int(str(source)), 0)
    check_as("clip", source=source)
    check_exists(source)
    return Path(source)


def _named(detect: str | Mapping[str, Any]) -> dict[str, Any]:
    return {"detector": detect} if isinstance(detect, str) else dict(detect)


def _finder(keypoints: Any) -> Path | KeypointSource:
    if callable(keypoints):
        return keypoints
    check_as("one file", keypoints=keypoints)
    check_exists(keypoints)
    return Path(keypoints)


def _print_address(address: str) -> None:
    print(f"{address} shows it; Ctrl-C ends it", flush=True)
