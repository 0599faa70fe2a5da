"""The commands that track."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from kinemode.commands.options import (
    MEDIAPIPE,
    NO_INPUT,
    USUAL,
    ClipArgument,
    DetectorOptions,
    Flag,
    InputOptions,
    TrackerOptions,
)


def track(
    *clips: ClipArgument,
    files: InputOptions = NO_INPUT,
    how: TrackerOptions = USUAL,
    detect: Flag = False,
    by: DetectorOptions = MEDIAPIPE,
    tracker: str = "css",
    workers: int = 1,
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

    Parameters
    ----------
    detect
        Find the keypoints of clips without a keypoint file first, as `kinemode detect` does, into OUT.keypoints beside
        the run; they are taken from there as long as clip and detector are the same.
    tracker
        Its name, see `kinemode trackers`.
    workers
        How many processes share the work of a tracker that searches many hypotheses; the run is the same with any
        number.
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
        **how.arguments(),
        detect=by.arguments() if detect else False,
        tracker=tracker,
        out=out,
        resume=resume,
        overwrite=overwrite,
        workers=workers,
        progress=km.reported,
    )
    from kinemode.terminal import report

    report.print_run(run)


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
