"""The commands that track."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from kinemode.options import (
    MEDIAPIPE,
    NO_INPUT,
    NO_POINTS,
    USUAL,
    ClipArgument,
    DetectorOptions,
    Flag,
    InputOptions,
    PointOptions,
    SubjectOption,
    TrackerOptions,
)


def track(
    *clips: ClipArgument,
    files: InputOptions = NO_INPUT,
    given: PointOptions = NO_POINTS,
    how: TrackerOptions = USUAL,
    tracker: str | None = None,
    out: Path,
    resume: Flag = False,
    overwrite: Flag = False,
) -> None:
    """Track a subject through one clip, or several synchronised ones.

    Clips, keypoint files, masks and backgrounds are [NAME=]PATH; NAME picks the camera and is the file's stem by
    default. Keypoints of the first frame alone will do where there are clips: the pictures carry on.

    Examples:

    kinemode track walk.mp4 --keypoints walk.json --out walk.run

    kinemode track cam01.mp4 cam02.mp4 --cameras calibration.json --keypoints cam01=a.json cam02=b.json --out both.run

    kinemode track walk.mp4 --keypoints clicks.json --cues edges,flow --out clicked.run

    kinemode track walk.mp4 --detect --out walk.run

    kinemode track --cameras calibration.json --keypoints cam01.json cam02.json --person all --out them.run

    kinemode track --points walk.trc --out walk.run

    Parameters
    ----------
    tracker
        Its name, see `kinemode trackers`; css unless given, markers with --points.
    out
        The run file.
    resume
        Go on with an interrupted run.
    overwrite
        Replace the run file if there is one.
    """
    import kinemode as km

    warnings.simplefilter("ignore", km.FindingWarning)  # `print_run` has them
    run = km.track(
        how.subject,
        clips,
        **files.arguments(),
        **given.arguments(),
        **how.arguments(),
        tracker=tracker,
        out=out,
        resume=resume,
        overwrite=overwrite,
        progress=km.reported,
    )
    from kinemode.terminal import report

    for tracked in run.values() if isinstance(run, dict) else [run]:
        report.print_run(tracked)


def compare(
    *clips: ClipArgument,
    files: InputOptions = NO_INPUT,
    trackers: Annotated[list[str], Parameter(consume_multiple=True, negative="")],
    how: TrackerOptions = USUAL,
    reference: Path | None = None,
    out: Path,
    resume: Flag = False,
    overwrite: Flag = False,
) -> None:
    """Track one clip with several trackers, and write a table and a plot of how they did.

    The subject is fitted once. What was tracked before an interruption is kept: --resume goes on.

    Examples:

    kinemode compare walk.mp4 --keypoints walk.json --trackers css,single-mode,condensation --out walk-compared

    kinemode compare walk.mp4 --keypoints walk.json --trackers css,css-paper --reference truth.npz --out walk-compared

    kinemode compare walk.mp4 --detect --trackers css,single-mode --out walk-compared

    Parameters
    ----------
    trackers
        Their names with commas between them, see `kinemode trackers`.
    reference
        Known 3D landmarks, see `evaluate`: the table then has errors, and where each tracker lost the person.
    out
        Folder for the runs (NAME.run), compare.csv, compare.json and compare.png.
    resume
        Go on with the runs that are there.
    overwrite
        Replace the runs that are there.
    """
    import kinemode as km

    compared = km.compare(
        how.subject,
        clips,
        trackers=trackers,
        **files.arguments(),
        **how.arguments(),
        reference=reference,
        out=out,
        resume=resume,
        overwrite=overwrite,
        progress=km.reported,
    )
    from kinemode.comparison.report import print_comparison

    print_comparison(compared)


def live(
    source: str = "0",
    /,
    *,
    keypoints: Path | None = None,
    finder: DetectorOptions = MEDIAPIPE,
    subject: SubjectOption = "human34",
    cameras: Path | None = None,
    camera: str | None = None,
    cues: str = "off",
    background: Path | None = None,
    tracker: str = "css",
    modes: int | None = None,
    settings: Path | None = None,
    seed: int = 0,
    lag: int = 0,
    index: Path | None = None,
    floor: float | str = "auto",
    realtime: bool = True,
    out: Path | None = None,
    overwrite: Flag = False,
    show: bool = True,
    port: int = 0,
    browser: bool = True,
) -> None:
    """Track a camera, or a file as if it were one, with a preview that moves; Ctrl-C ends it.

    The subject is taken as it is: fit it beforehand, with `kinemode fit`. Pictures that come while another is tracked
    are dropped, all but the newest.

    Examples:

    kinemode live 0 --subject me.urdf

    kinemode live walk.mp4 --keypoints walk.json --subject me.urdf

    kinemode live walk.mp4 --keypoints walk.json --no-realtime --no-show --out walk.run

    Parameters
    ----------
    source
        The number of a camera of this machine, or a clip, which is played at its own rate.
    keypoints
        A keypoint file of the clip, which is played back; a detector finds them unless given.
    cameras
        JSON with K, distortion, R, t; guessed without it.
    camera
        The name of the camera in it, where it is not the clip's.
    cues
        What the pictures are looked at for: off, or some of what `kinemode cues` lists, with commas between them.
    background
        A picture of the empty scene, for the silhouette.
    tracker
        Its name, see `kinemode trackers`.
    modes
        How many hypotheses are kept, by trackers that keep several.
    settings
        A TOML file of settings, see `kinemode settings`.
    seed
        Seed of the tracker's random numbers.
    lag
        Show every frame so many frames later, smoothed with those that came since.
    index
        Index of examples in which poses are looked up, see `train-index`.
    floor
        With a lag: its height in the cameras' world [m], which nothing goes below; off; auto takes the camera file's.
    realtime
        --no-realtime tracks every picture of a clip, however long that takes.
    out
        A run file, there when it is over.
    overwrite
        Replace the run file if there is one.
    show
        --no-show goes without a preview.
    port
        Of the preview, on this machine alone; 0 takes a free one.
    browser
        --no-browser prints the preview's address and opens nothing.
    """
    import kinemode as km

    session = km.live(
        source, keypoints=keypoints, detect=finder.arguments(), subject=subject, cameras=cameras, camera=camera,
        cues=cues, background=background, tracker=tracker, modes=modes, settings=settings, seed=seed, lag=lag,
        index=index, floor=floor, realtime=realtime, out=out, overwrite=overwrite, show=show, port=port,
        open_browser=browser,
    )  # fmt: skip
    print(session.summary())
    if out is not None:
        print(f"run file: {out}")
