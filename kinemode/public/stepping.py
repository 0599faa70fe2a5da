"""`Tracker`: a body tracked frame by frame, as keypoints or pictures come."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode import kinds
from kinemode.checks import check_exists, check_together
from kinemode.detection.detectors import DetectorChoice
from kinemode.kinds import is_path
from kinemode.named import chosen_names, matched, named_paths
from kinemode.option import MOST, constructed_by, takes, with_options
from kinemode.public.tracking import loaded_subject
from kinemode.request import BACKGROUND, LiveRequest, StepRequest
from kinemode.target import RunTarget

if TYPE_CHECKING:
    import numpy as np

    from estimator.data.cameras.camera import Camera
    from humanoid.kinematics.body import Body
    from kinemode.streams.session import Session
    from kinemode.streams.step import Step

    Keypoints = np.ndarray | Mapping[str, np.ndarray | None] | None
    Pictures = np.ndarray | Mapping[str, np.ndarray] | None

ALONE = "camera"  # the name of a camera that is guessed


class Tracker:
    """Tracks a subject frame by frame, as keypoints or pictures come.

    >>> person = km.fit("human34", None, keypoints="first_seconds.json", keypoint_size=(640, 480)).subject
    >>> tracker = km.Tracker(person, image_size=(640, 480), layout="mediapipe33")
    >>> for time, points in detector:  # points (33, 3): x, y [px], confidence
    ...     step = tracker.step(points, time=time)
    ...     print(step.status, step.angle("left_knee_flexion", degrees=True))

    The results are those of `kinemode.track` in its run before smoothing (`run.mode_q`, `run.mode_weight`), to the
    last bit, if the subject, the settings, the seed and `jitter` are the same and the run measured no noise of its
    cameras, as fits to several cameras do (`run.observation(0).noise`): both treat a frame by
    `estimator.tracking.runner`. The subject is taken as it is: `kinemode.fit` fits it to a person beforehand.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: anything that is wrong with the input, a changed setting without effect included.
    """

    @constructed_by(StepRequest)
    def __init__(self, request: StepRequest) -> None:
        check_together(request)
        plates = named_paths(request.background, BACKGROUND)
        loaded = loaded_subject(request.subject)
        from kinemode.streams.stepper import Stepper, Streamed, known_floor

        chosen = _cameras(request)
        names, written = [c.name for c in chosen], chosen_names(request.background, BACKGROUND)
        matching = matched(names, plates, BACKGROUND, "camera", chosen=written, every=False)
        floor = known_floor(request, placed=request.camera is not None or request.cameras is not None)
        self._stepper = Stepper(loaded, chosen, request, Streamed(matching, floor, request.jitter))

    @property
    def body(self) -> Body:
        """The tracked body."""
        return self._stepper.body

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """From where, in the order of names."""
        return self._stepper.cameras

    def step(self, keypoints: Keypoints = None, picture: Pictures = None, *, time: float) -> Step | None:
        """Take the next frame, and give the one whose turn it is.

        Parameters
        ----------
        keypoints: of one person, (K, 2) x, y [px], or (K, 3) with confidences from 0 to 1; NaN where one is missing.
            A mapping by camera where there are several. None where no person was seen.
        picture: (H, W, 3) uint8, BGR, as OpenCV reads it, where cues are used; a mapping by camera where there
            are several.
        time: when the frame was taken [s], later than the one before.

        Returns
        -------
        This frame; with a lag, or a tracker with lookahead, one before it, and None while there is none yet.

        Raises
        ------
        InputError: an array of another shape, a time that does not follow, a camera that is unknown. The frame then
            does not count.
        """
        kinds.check(time=(time, kinds.NUMBER))
        return self._stepper.step(keypoints, picture, time)

    def finish(self) -> list[Step]:
        """The frames that are still held back, at the end of a stream; none without a lag."""
        return self._stepper.finish()


def _cameras(request: StepRequest) -> tuple[Camera, ...]:
    from estimator.data.cameras.camera import guessed_camera
    from estimator.data.formats.cameras import load_cameras
    from kinemode.inputs.lens import PHONES, PHONES_STD

    camera, cameras, image_size = request.camera, request.cameras, request.image_size
    given = [name for name, value in (("camera", camera), ("cameras", cameras)) if value is not None]
    if len(given) > 1 or (given and image_size is not None):
        given += ["image_size"] if image_size is not None else []
        raise InputError(" and ".join(given), "exclude each other", remedy="give one of camera, cameras, image_size")
    if camera is not None:
        return (camera,)
    if cameras is not None:
        return tuple((cameras if isinstance(cameras, Mapping) else load_cameras(cameras)).values())
    if image_size is None:
        raise InputError("camera", "is needed", remedy="or image_size=(WIDTH, HEIGHT), from which one is guessed")
    return (guessed_camera(ALONE, image_size, focal=PHONES, focal_std=PHONES_STD),)


Tracker.__doc__ = with_options(Tracker.__doc__, StepRequest)


@takes(LiveRequest)
def live(request: LiveRequest) -> Session:
    """Track a camera, or a file as if it were one, with a preview that moves; until it ends, or Ctrl-C.

    An image that is overtaken by the next one while another is tracked is dropped.

    Parameters
    ----------
    OPTIONS

    Returns
    -------
    What became of it: images that were tracked and dropped, statuses, seconds.

    Raises
    ------
    InputError: no such camera or clip, a detector that cannot be had; and as `kinemode.Tracker`.
    """
    check_together(request)
    device = _device(request.source)
    if request.keypoints is None:
        DetectorChoice.of(request).check()
    elif is_path(request.keypoints):
        check_exists(str(request.keypoints))
    if request.out is not None:
        RunTarget(Path(request.out), False, request.overwrite).check()
    loaded = loaded_subject(request.subject)
    from kinemode.streams.job import track_live

    return track_live(loaded, device, request)


def _device(source: int | str | Path) -> int | Path:
    """The number of a camera, also as text, or the path of a clip that is there."""
    if not isinstance(source, (str, Path)):
        if not 0 <= source <= MOST:
            problem = f"{source} is {'negative' if source < 0 else 'too large'}"
            raise InputError("source", problem, remedy=f"0 or more, at most {MOST}")
        return int(source)
    if str(source).isdecimal():
        return int(str(source))
    check_exists(source)
    return Path(source)
