"""The commands that track: one clip, several trackers, a camera, many clips, another body."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from kinemode.flags import Flag, flags_of
from kinemode.making_requests import BatchRequest
from kinemode.request import USUAL_SUBJECT, CompareRequest, LiveRequest, RetargetRequest, TrackRequest


@flags_of(TrackRequest, needed=("out",), subject=USUAL_SUBJECT)
def track(**given: Any) -> None:
    """Track a subject through one clip, or several synchronised ones.

    Clips, keypoint files, masks and backgrounds are [NAME=]PATH; NAME picks the camera and is the file's stem by
    default. Keypoints of the first frame alone will do where there are clips: the pictures carry on.

    For example:

    kinemode track walk.mp4 --keypoints walk.json --out walk.run

    kinemode track cam01.mp4 cam02.mp4 --cameras calibration.json --keypoints cam01=a.json cam02=b.json --out both.run

    kinemode track walk.mp4 --keypoints clicks.json --cues edges,flow --out clicked.run

    kinemode track walk.mp4 --detect --out walk.run

    kinemode track --cameras calibration.json --keypoints cam01.json cam02.json --person all --out them.run

    kinemode track --points walk.trc --out walk.run
    """
    import kinemode as km

    warnings.simplefilter("ignore", km.FindingWarning)  # `print_run` has them
    run = km.track(**given, progress=km.reported)
    from kinemode.terminal import report

    for tracked in run.values() if isinstance(run, dict) else [run]:
        report.print_run(tracked)


@flags_of(CompareRequest, subject=USUAL_SUBJECT)
def compare(**given: Any) -> None:
    """Track one clip with several trackers, and write a table and a plot of how they did.

    The subject is fitted once. What was tracked before an interruption is kept: --resume continues it. OUT is a folder
    for the runs (NAME.run), compare.csv, compare.json and compare.png.

    For example:

    kinemode compare walk.mp4 --keypoints walk.json --trackers css,single-mode,condensation --out walk-compared

    kinemode compare walk.mp4 --keypoints walk.json --trackers css,css-paper --reference truth.npz --out walk-compared

    kinemode compare walk.mp4 --detect --trackers css,single-mode --out walk-compared
    """
    import kinemode as km

    compared = km.compare(**given, progress=km.reported)
    from kinemode.comparison import print_comparison

    print_comparison(compared)


@flags_of(LiveRequest, arguments=("source",))
def live(**given: Any) -> None:
    """Track a camera, or a file as if it were one, with a preview that moves; Ctrl-C ends it.

    The subject is used as measured: fit it beforehand, with `kinemode fit`. Images that come while another is tracked
    are dropped, all but the newest.

    For example:

    kinemode live 0 --subject me.urdf

    kinemode live walk.mp4 --keypoints walk.json --subject me.urdf

    kinemode live walk.mp4 --keypoints walk.json --no-realtime --no-show --out walk.run
    """
    import kinemode as km

    session = km.live(**given)
    print(session.summary())
    if given.get("out") is not None:
        print(f"run file: {given['out']}")


@flags_of(RetargetRequest, needed=("out",), arguments=("source",), source=None, subject="example-robot-data:g1")
def retarget(*, metrics: Path | None = None, **given: Any) -> None:
    """Make a person's motion a robot's, or any other body's: within its limits, feet on the ground.

    Without a source it writes a correspondence template: --match names the subject, --out the TOML file.

    For example:

    kinemode retarget walk.run --subject example-robot-data:g1 --out g1.run

    kinemode retarget walk.bvh --subject robot.urdf --match match.toml --out robot.run --metrics robot.csv

    kinemode retarget --match robot.urdf --out match.toml

    Parameters
    ----------
    metrics
        Also write the figures that are printed to this csv file.
    """
    import kinemode as km

    if given.get("source") is None:
        if given.get("match") is None:
            raise km.InputError(
                "retarget", "nothing to retarget", remedy="name a run or a file; --match SUBJECT writes a template"
            )
        km.match_start(given["match"], out=given["out"])
        print(given["out"])
        return
    run = km.retarget(**given, progress=km.reported)
    from kinemode.reporting import motion_figures, write_figures
    from kinemode.terminal import report

    figures = motion_figures(run)
    report.print_lines([f"{name}: {value}" for name, value in figures.rows()])
    if metrics is not None:
        print(write_figures(figures, metrics))
    print(run.file)


_SHOWN = 10  # clips that failed


@flags_of(BatchRequest, arguments=("manifest",), manifest=None)
def batch(*, make: Path | None = None, overwrite: Flag = False, **given: Any) -> None:
    """Track many clips: one row of a manifest each, several at a time, into one folder with a table and a page.

    The same command resumes a batch that was interrupted; clips that are finished are not done again unless their files
    or options have changed. --make FOLDER writes a manifest of the clips in a folder instead.

    For example:

    kinemode batch --make recordings --out clips.csv

    kinemode batch clips.csv --out tracked --export csv,mot,trc --report

    kinemode batch clips.csv --out tracked --engine dask --scheduler tcp://192.168.0.5:8786

    Parameters
    ----------
    make
        A folder of videos, of which --out MANIFEST is made: one or several cameras a folder, sessions of Pose2Sim or
        OpenCap.
    overwrite
        With --make: replace the manifest if there is one.
    """
    manifest = given["manifest"]
    import kinemode as km

    if make is not None:
        _make(manifest, make, given["out"], overwrite)
        return
    if manifest is None:
        raise km.InputError("manifest", "is missing", remedy="name a CSV or TOML file, or --make FOLDER writes one")
    if overwrite:
        raise km.InputError("--overwrite", "is for --make", remedy="leave it out: what has changed is done again")
    done = km.batch(**given, progress=km.reported)
    failed = done.failed
    page = "" if done.page is None else f": {done.page}"
    print(f"{len(done.outcomes) - len(failed)} of {len(done.outcomes)} clips tracked{page}")
    for name, why in list(failed.items())[:_SHOWN]:
        print(f"  {name}: {why}")
    if failed:
        remedy = "the table could not be written" if done.table is None else f"all of them are in {done.table}"
        raise km.InputError(manifest, f"{_counted(len(failed))} failed", remedy=remedy)


def _make(manifest: Path | None, folder: Path, out: Path, overwrite: bool) -> None:
    import kinemode as km

    if manifest is not None:
        raise km.InputError(manifest, "is not needed to make one", remedy="--make FOLDER --out MANIFEST")
    clips = km.make_manifest(folder, out, overwrite=overwrite)
    print(f"{_counted(len(clips))}: {out}")


def _counted(count: int) -> str:
    return "1 clip" if count == 1 else f"{count} clips"
