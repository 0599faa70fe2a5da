"""`render` and `annotate`: clips with known truth, and keypoints by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kinemode.checks import check_exists
from kinemode.named import PathLike
from kinemode.progress import Reporter, unreported
from kinemode.public.arguments import check_arguments, check_as, whole
from kinemode.target import check_folder

if TYPE_CHECKING:
    from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
    from humanoid.subject.subject import Subject
    from kinemode.shot import RenderedClip


def render(
    folder: PathLike,
    motion: PathLike = "reach",
    *,
    subject: Subject | PathLike | None = None,
    proportions: Mapping[str, float] | None = None,
    shape: Mapping[int | str, Sequence[float]] | None = None,
    girth: float = 1.0,
    scene: SceneSettings | None = None,
    view: ViewSettings | None = None,
    detector: DetectorSettings | None = None,
    fps: float = 30.0,
    seconds: float | None = None,
    unit: float | None = None,
    up: str | None = None,
    seed: int = 0,
    videos: bool = True,
    masks: bool = False,
    depths: bool = False,
    progress: Reporter | None = None,
) -> RenderedClip:
    """Render a motion into a folder, made if it is not there; files of an earlier clip are replaced.

    Parameters
    ----------
    motion: "reach", "arm", "pivot", "turn_reach", "reach_out", "cross_arms", "talk"; "random", smooth, within the
        limits of any subject and without overlaps; a BVH file; or a csv or npz of the subject's joints over time, as
        `export` and `render` write them or with columns time and JOINT_rad, JOINT_deg, JOINT_m (see
        `estimator.synthesis.motion_file.motion_of`).
    subject: the body in the pictures, a name, a path or a subject; unless given the one the motion is made for.
    proportions: scales of its lengths, see `Subject.scaled`. shape: its flesh then, see `Subject.reshaped`.
    girth: factor on the cross-sections of its limbs, after all that.
    scene, view, detector: looks, cameras and keypoint errors (`kinemode.SceneSettings`, `ViewSettings`,
        `DetectorSettings`); unless given those that suit the motion.
    fps: frames per second. seconds: only so much of the motion; of a random one 4 unless given.
    unit: metres in one unit of a BVH file, where it is known (see `estimator.synthesis.mocap.load_mocap`).
    up: the axis of a BVH file that points up ("x", "y", "z", "-x", "-y" or "-z"), where it is known; else it is found.
    seed: of a random motion, the scene, the clothes, the sensor's noise and the keypoints' errors.
    videos: False leaves the pictures out. masks: also write the body's exact silhouettes. depths: also write the exact
        depth of every pixel.
    progress: opens a progress report, such as `kinemode.reported`; none by default.

    Returns the paths of the files: videos, keypoints, cameras, the true motion, the body (see `RenderedClip`).

    Raises
    ------
    InputError: a choice that does not exist, a body that the motion does not suit, a folder that cannot be written.
    """
    check_arguments(
        folder=folder, motion=motion, proportions=proportions, shape=shape, girth=girth, scene=scene, view=view,
        detector=detector, fps=fps, seconds=seconds, unit=unit, up=up, videos=videos, progress=progress,
    )  # fmt: skip
    check_as("subject or none", subject=subject)
    check_as("videos", masks=masks, depths=depths)
    if Path(motion).suffix.lower() in (".bvh", ".csv", ".npz"):
        check_exists(motion)
    from kinemode.rendering import render_clip

    return render_clip(
        folder, motion, subject=subject, proportions=proportions, shape=shape, girth=girth, scene=scene, view=view,
        detector=detector, fps=fps, seconds=seconds, unit=unit, up=up, seed=whole("seed", seed, 0),
        videos=videos, masks=masks, depths=depths, progress=progress or unreported,
    )  # fmt: skip


def annotate(
    clip: PathLike,
    *,
    subject: Subject | PathLike = "human34",
    frame: int = 0,
    camera: str | None = None,
    keypoints: PathLike | None = None,
    out: PathLike = "clicks.json",
    port: int = 0,
    browser: bool = True,
) -> str:
    """Serve a page on which a person clicks the subject's landmarks, until the page is closed.

    Parameters
    ----------
    clip: a video or a folder of images.
    subject: a loaded subject, a built-in name, or the path of a URDF.
    frame: the frame shown first.
    camera: name of the view, for the command that comes next; the clip's stem unless given.
    keypoints: a detector's keypoint file, to be corrected: it fills the frames without a click.
    out: the file the page saves to, as often as asked; what it holds already is edited further.
    port: on 127.0.0.1; 0 takes a free one. browser: whether the page is opened; its address is printed.

    Returns the command that tracks from the clicks.

    Raises
    ------
    InputError: anything that is wrong with the input.
    KeyboardInterrupt: on Ctrl-C, saying what there is by then.
    """
    check_arguments(
        clip=clip, subject=subject, frame=frame, camera=camera, port=port, browser=browser
    )  # fmt: skip
    check_as("keypoint file", keypoints=keypoints)
    check_as("file", out=out)
    for path in (clip, *([] if keypoints is None else [keypoints])):
        check_exists(path)
    check_folder(Path(out))
    from kinemode.annotation.annotate import serve_annotation

    return serve_annotation(
        clip, subject=subject, frame=frame, camera=camera, keypoints=keypoints, out=out, port=port,
        open_browser=browser,
    )  # fmt: skip
