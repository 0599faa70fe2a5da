"""`Tracker`: a body tracked frame by frame, as keypoints or pictures come."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from humanoid.support.errors import InputError
from kinemode.inputs.files import BACKGROUND, check_exists
from kinemode.inputs.named import Named, PathLike, chosen_names, matched, named_paths
from kinemode.public.arguments import check_arguments, whole
from kinemode.public.tracking import loaded_subject

if TYPE_CHECKING:
    import numpy as np

    from estimator.data.cameras.camera import Camera
    from humanoid.kinematics.body import Body
    from kinemode.inputs.files import Cameras
    from kinemode.public.tracking import SubjectLike
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

    What comes out is what `kinemode.track` has in its run before smoothing (`run.mode_q`, `run.mode_weight`), to the
    last bit, if the subject, the settings, the seed and `jitter` are the same and the run measured no noise of its
    cameras, as fits to several cameras do (`run.observation(0).noise`): both treat a frame by
    `estimator.tracking.frame_by_frame`. The subject is taken as it is: `kinemode.fit` fits it to a person beforehand.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF.
    camera: the one camera, a `kinemode.Camera`. cameras: instead, several by name or the path of a camera file. Without
        either one is guessed from image_size, the width and height [px] of the pictures that keypoints are seen in.
    layout: what the keypoints are called: "mediapipe33", "coco17", ... or a name for each; "auto" uses their number.
    cues: what is taken from the pictures, such as "edges,flow"; "off" looks at none. The silhouette needs `background`,
        a picture of the empty scene, or a mapping by camera.
    tracker, modes, settings, seed, index: as `kinemode.track` has them.
    lag: so many frames later a frame is given out, smoothed with those that came since.
    floor: its height in the cameras' world, along the axis that points up [m], which nothing of what is smoothed goes
        below; "auto" takes the camera file's word, "off" does not. In a stream none is found.
    jitter: how much the keypoints tremble [px], a number or a mapping by camera; `run.observation(0).jitter` has what
        `kinemode.track` told from its whole clip. Unless given it is told from the last frames, 150 at most.

    Raises
    ------
    InputError: anything that is wrong with the input, a changed setting without effect included.
    """

    def __init__(
        self,
        subject: SubjectLike,
        camera: Camera | None = None,
        *,
        cameras: Cameras = None,
        image_size: tuple[int, int] | None = None,
        layout: str | Sequence[str] = "auto",
        cues: str | Iterable[str] = "off",
        background: Named = None,
        tracker: str = "css",
        modes: int | None = None,
        settings: Mapping[str, Any] | PathLike | None = None,
        seed: int = 0,
        lag: int = 0,
        jitter: float | Mapping[str, float] | None = None,
        index: PathLike | None = None,
        floor: float | str = "auto",
    ) -> None:
        check_arguments(
            subject=subject, cameras=cameras, layout=layout, cues=cues, background=background, tracker=tracker,
            modes=modes, settings=settings, jitter=jitter, index=index, image_size=image_size, floor=floor,
        )  # fmt: skip
        seed, lag = whole("seed", seed, 0), whole("lag", lag, 0)
        for path in (cameras, settings, index):
            if isinstance(path, (str, Path)):
                check_exists(path)
        plates = named_paths(background, BACKGROUND)
        loaded = loaded_subject(subject)
        from kinemode.streams.known_floor import stream_floor
        from kinemode.streams.stepper import StepOptions, Stepper

        chosen = _cameras(camera, cameras, image_size)
        names, written = [c.name for c in chosen], chosen_names(background, BACKGROUND)
        matching = matched(names, plates, BACKGROUND, "camera", chosen=written, every=False)
        placed = camera is not None or cameras is not None
        known = stream_floor(floor, cameras, lag, placed)
        wanted = StepOptions(layout, cues, matching, tracker, modes, settings, seed, lag, jitter, index, known)
        self._stepper = Stepper(loaded, chosen, wanted)

    @property
    def body(self) -> Body:
        """What is tracked."""
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
            A mapping by camera where there are several. None where nobody was seen.
        picture: (H, W, 3) uint8, BGR, as OpenCV reads it, where cues are looked at; a mapping by camera where there
            are several.
        time: when the frame was taken [s], later than the one before.

        Returns
        -------
        This frame; with a lag, or a tracker that looks ahead, one before it, and None while there is none yet.

        Raises
        ------
        InputError: an array of another shape, a time that does not follow, a camera that is unknown. The frame then
            does not count.
        """
        check_arguments(time=time)
        return self._stepper.step(keypoints, picture, time)

    def finish(self) -> list[Step]:
        """The frames that are still held back, at the end of a stream; none without a lag."""
        return self._stepper.finish()


def _cameras(camera: Camera | None, cameras: Cameras, image_size: tuple[int, int] | None) -> tuple[Camera, ...]:
    from estimator.data.cameras.camera import Camera, guessed_camera
    from estimator.data.formats.cameras import load_cameras
    from kinemode.inputs.lens import PHONES, PHONES_STD

    given = [name for name, value in (("camera", camera), ("cameras", cameras)) if value is not None]
    if len(given) > 1 or (given and image_size is not None):
        given += ["image_size"] if image_size is not None else []
        raise InputError(" and ".join(given), "exclude each other", remedy="give one of camera, cameras, image_size")
    if camera is not None:
        if not isinstance(camera, Camera):
            raise InputError("camera", "is no kinemode.Camera", remedy="cameras takes the path of a camera file")
        return (camera,)
    if cameras is not None:
        return tuple((cameras if isinstance(cameras, Mapping) else load_cameras(cameras)).values())
    if image_size is None:
        raise InputError("camera", "is needed", remedy="or image_size=(WIDTH, HEIGHT), from which one is guessed")
    return (guessed_camera(ALONE, image_size, focal=PHONES, focal_std=PHONES_STD),)
