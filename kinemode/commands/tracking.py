"""The commands that track."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from kinemode.commands.options import Files, Flag


def track(
    *clips: Annotated[str, Parameter(name="clip")],
    subject: str = "human34",
    cameras: Path | None = None,
    keypoints: Files = None,
    cues: str = "auto",
    mask: Files = None,
    background: Files = None,
    settings: Path | None = None,
    tracker: str = "css",
    modes: int | None = None,
    seed: int = 0,
    fit: Literal["auto", "proportions", "off"] = "auto",
    person: str = "auto",
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

    Parameters
    ----------
    clips
        Video files or folders of images; none where the keypoints are enough.
    subject
        A built-in name (see `kinemode subjects`) or a URDF file.
    cameras
        JSON with K, distortion, R, t of each camera; one camera without it is guessed.
    keypoints
        2D keypoint files or folders: MediaPipe 33, OpenPose BODY_25 or COCO 18, COCO 17, Halpe 26, `annotate`'s.
    cues
        What the pictures are looked at for: off, or some of edges,flow,silhouette; auto takes all of them where less
        than half of the frames have keypoints.
    mask
        Videos or folders of masks, white on the person; the background is then not needed.
    background
        Pictures of the empty scene; learned from the clip unless given.
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
    person
        Which of several people: auto (largest, then continuity) or an id of the keypoint file.
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
    from kinemode import api, report
    from kinemode.progress import reported

    warnings.simplefilter("ignore", api.FindingWarning)  # `print_run` has them
    run = api.track(
        subject,
        clips,
        cameras=cameras,
        keypoints=keypoints,
        cues=cues,
        masks=mask,
        background=background,
        settings=settings,
        tracker=tracker,
        modes=modes,
        seed=seed,
        fit=fit,
        out=out,
        resume=resume,
        overwrite=overwrite,
        person=person,
        workers=workers,
        progress=reported,
    )
    report.print_run(run)


def compare(
    *clips: Annotated[str, Parameter(name="clip")],
    trackers: Annotated[list[str], Parameter(consume_multiple=True, negative="")],
    subject: str = "human34",
    cameras: Path | None = None,
    keypoints: Files = None,
    cues: str = "auto",
    mask: Files = None,
    background: Files = None,
    settings: Path | None = None,
    modes: int | None = None,
    seed: int = 0,
    fit: Literal["auto", "proportions", "off"] = "auto",
    person: str = "auto",
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
    clips
        Video files or folders of images; none where the keypoints are enough.
    trackers
        Their names with commas between them, see `kinemode trackers`.
    subject
        A built-in name (see `kinemode subjects`) or a URDF file.
    cameras
        JSON with K, distortion, R, t of each camera; one camera without it is guessed.
    keypoints
        2D keypoint files or folders.
    cues
        What the pictures are looked at for, see `track`.
    mask
        Videos or folders of masks, white on the person.
    background
        Pictures of the empty scene.
    settings
        A TOML file of settings; each tracker takes those that are about it.
    modes
        How many hypotheses are kept, by those that keep several; each tracker's own number unless given.
    seed
        Seed of the trackers' random numbers.
    fit
        Whether the subject is fitted to the person, see `track`.
    person
        Which of several people: auto (largest, then continuity) or an id of the keypoint file.
    reference
        Known 3D landmarks, see `evaluate`: the table then has errors, and where each tracker lost the person.
    out
        Folder for the runs (NAME.run), compare.csv, compare.json and compare.png.
    resume
        Go on with the runs that are there.
    overwrite
        Replace the runs that are there.
    """
    from kinemode.comparison import compare as compare_trackers
    from kinemode.comparison_report import print_comparison
    from kinemode.progress import reported

    compared = compare_trackers(
        subject,
        clips,
        trackers=trackers,
        cameras=cameras,
        keypoints=keypoints,
        cues=cues,
        masks=mask,
        background=background,
        settings=settings,
        modes=modes,
        seed=seed,
        fit=fit,
        person=person,
        reference=reference,
        out=out,
        resume=resume,
        overwrite=overwrite,
        progress=reported,
    )
    print_comparison(compared)
