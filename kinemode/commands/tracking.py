"""The commands that track."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from kinemode.commands.options import NO_INPUT, ClipArgument, Flag, InputOptions, SubjectOption


def track(
    *clips: ClipArgument,
    files: InputOptions = NO_INPUT,
    subject: SubjectOption = "human34",
    cues: str = "auto",
    settings: Path | None = None,
    tracker: str = "css",
    modes: int | None = None,
    seed: int = 0,
    fit: Literal["auto", "proportions", "off"] = "auto",
    workers: int = 1,
    index: Path | None = None,
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

    Parameters
    ----------
    cues
        What the pictures are looked at for: off, or some of what `kinemode cues` lists, with commas between them; auto
        takes all of them where less than half of the frames have keypoints.
    settings
        A TOML file of settings, see `kinemode settings`.
    tracker
        Its name, see `kinemode trackers`.
    modes
        How many hypotheses are kept; unless given the tracker's own number, see `kinemode settings --tracker NAME`.
    seed
        Seed of the tracker's random numbers; the same seed gives the same run.
    fit
        auto fits a built-in subject to the person in the first frames: the proportions, and the flesh where edges or
        silhouettes are looked at; a file is taken as measured. proportions leaves the flesh, off everything as it is.
    workers
        How many processes share the work of a tracker that searches many hypotheses; the run is the same with any
        number.
    index
        Index of examples in which elmo and psh look poses up, see `train-index`; that of the subject in the cache
        unless given, which is made when it is first needed.
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
        subject,
        clips,
        **files.arguments(),
        cues=cues,
        settings=settings,
        tracker=tracker,
        modes=modes,
        seed=seed,
        fit=fit,
        out=out,
        resume=resume,
        overwrite=overwrite,
        workers=workers,
        index=index,
        progress=km.reported,
    )
    from kinemode.terminal import report

    report.print_run(run)


def compare(
    *clips: ClipArgument,
    files: InputOptions = NO_INPUT,
    trackers: Annotated[list[str], Parameter(consume_multiple=True, negative="")],
    subject: SubjectOption = "human34",
    cues: str = "auto",
    settings: Path | None = None,
    modes: int | None = None,
    seed: int = 0,
    fit: Literal["auto", "proportions", "off"] = "auto",
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
    cues
        What the pictures are looked at for, see `track`.
    settings
        A TOML file of settings; each tracker takes those that are about it.
    modes
        How many hypotheses are kept, by those that keep several; each tracker's own number unless given.
    seed
        Seed of the trackers' random numbers.
    fit
        Whether the subject is fitted to the person, see `track`.
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
        subject,
        clips,
        trackers=trackers,
        **files.arguments(),
        cues=cues,
        settings=settings,
        modes=modes,
        seed=seed,
        fit=fit,
        reference=reference,
        out=out,
        resume=resume,
        overwrite=overwrite,
        progress=km.reported,
    )
    from kinemode.comparison.report import print_comparison

    print_comparison(compared)
