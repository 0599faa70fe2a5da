"""The commands that track."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from kinemode.flags import flags_of
from kinemode.request import USUAL_SUBJECT, CompareRequest, LiveRequest, RetargetRequest, TrackRequest


@flags_of(TrackRequest, needed=("out",), subject=USUAL_SUBJECT)
def track(**given: Any) -> None:
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

    Examples:

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

    Examples:

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

    Without a source it begins a correspondence: --match names the subject, --out the TOML file.

    Examples:

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
                "retarget", "nothing to retarget", remedy="name a run or a file; --match SUBJECT begins"
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
