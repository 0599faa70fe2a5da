"""The command line. Commands say what they take; the work is in `kinemode.api` and below.

Only light modules are imported here: `kinemode --help` must not wait for Pinocchio and numba.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

import kinemode

Files = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]
Flag = Annotated[bool, Parameter(negative="")]
Format = Literal["npz", "csv", "trc", "mot"]

app = App(
    name="kinemode",
    version=kinemode.__version__,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,  # `main` says how to go on
    help="""How a person, or any body with a URDF, moved in a clip: joint angles as several weighted hypotheses.

Start with `kinemode demo`. Errors are one line; `--debug` anywhere on the line shows where they come from.""",
)


def run_command(arguments: Sequence[str]) -> None:
    """Parse and run one command line; every exception reaches the caller, warnings become one line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = _note
        app(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")


def _note(message: Warning | str, *_: object, **__: object) -> None:
    print("note:", " ".join(str(message).split()), file=sys.stderr)


@app.command
def demo(*, out: Path = Path("demo-out"), seed: int = 0) -> None:
    """Render a short clip with known motion, track it from one camera, and show the errors.

    Writes overlay.mp4, preview.html and contact_sheet.png.

    Example: kinemode demo --out demo-out

    Parameters
    ----------
    out
        Folder for the clip, the run and the pictures.
    seed
        Seed of the tracker's random numbers.
    """
    from kinemode.demo import run_demo

    run_demo(out, seed=seed)


@app.command
def track(
    *clips: Annotated[str, Parameter(name="clip")],
    subject: str = "human34",
    cameras: Path | None = None,
    keypoints: Files = None,
    tracker: str = "css",
    modes: int = 7,
    seed: int = 0,
    fit: Literal["auto", "off"] = "auto",
    person: str = "auto",
    out: Path,
    resume: Flag = False,
    overwrite: Flag = False,
) -> None:
    """Track a subject through one clip, or several synchronised ones.

    Clips and keypoint files are [NAME=]PATH; NAME picks the camera and is the file's stem by default.

    Examples:

    kinemode track walk.mp4 --keypoints walk.json --out walk.run

    kinemode track cam01.mp4 cam02.mp4 --cameras calibration.json --keypoints cam01=a.json cam02=b.json --out both.run

    Parameters
    ----------
    clips
        Video files or folders of images; none where the keypoints are enough.
    subject
        A built-in name (see `kinemode subjects`) or a URDF file.
    cameras
        JSON with K, distortion, R, t of each camera; one camera without it is guessed.
    keypoints
        2D keypoint files or folders: MediaPipe 33, OpenPose BODY_25 or COCO 18, COCO 17, Halpe 26.
    tracker
        css (several hypotheses), css-paper (as printed) or single-mode.
    modes
        How many hypotheses are kept.
    seed
        Seed of the tracker's random numbers; the same seed gives the same run.
    fit
        auto fits the proportions of a built-in subject from the first frames; a file is taken as measured.
    person
        Which of several people: auto (largest, then continuity) or an id of the keypoint file.
    out
        The run file.
    resume
        Go on with an interrupted run.
    overwrite
        Replace the run file if there is one.
    """
    from kinemode import api, report
    from kinemode.progress import reported

    run = api.track(
        subject,
        clips,
        cameras=cameras,
        keypoints=keypoints,
        tracker=tracker,
        modes=modes,
        seed=seed,
        fit=fit,
        out=out,
        resume=resume,
        overwrite=overwrite,
        person=person,
        progress=reported,
    )
    report.print_run(run)


@app.command
def view(run: Path, /, *, html: Path | None = None) -> None:
    """Look at a run in the browser: bodies, hypotheses, the video behind.

    Examples:

    kinemode view walk.run

    kinemode view walk.run --html walk.html

    Parameters
    ----------
    run
        A run file.
    html
        Write a self-contained page here and start nothing.
    """
    from kinemode.api import open_run

    if html is None:
        from viz.live import serve

        serve(open_run(run))
    else:
        from viz.preview import write_html

        print(write_html(open_run(run), html))


@app.command
def overlay(run: Path, /, *, out: Path, camera: str | None = None) -> None:
    """Write the video with the body drawn over it.

    Example: kinemode overlay walk.run --out walk-overlay.mp4

    Parameters
    ----------
    run
        A run file.
    out
        An mp4 file.
    camera
        Name of one camera; all of them side by side unless given.
    """
    from kinemode.api import open_run
    from kinemode.progress import reported
    from viz.overlay import write_overlay

    with reported("overlay") as progress:
        written = write_overlay(open_run(run), out, camera=camera, progress=progress)
    print(written)


@app.command
def export(run: Path, file: Path, /, *, format: Format | None = None) -> None:
    """Write a run for other programs.

    npz has everything; csv the joint angles; trc the landmarks; mot the joint angles for OpenSim.

    Example: kinemode export walk.run --format csv walk.csv

    Parameters
    ----------
    run
        A run file.
    file
        Where to write.
    format
        npz, csv, trc or mot; the file's ending unless given.
    """
    from estimator.formats import export as formats
    from kinemode.api import open_run

    formats.export(open_run(run), file, format)
    print(file)


@app.command
def evaluate(run: Path, /, *, reference: Path) -> None:
    """Compare a run with known 3D landmarks: MPJPE, PA-MPJPE, best of K, limits, interpenetration.

    Example: kinemode evaluate cam01.run --reference reference3d.npz

    Parameters
    ----------
    run
        A run file.
    reference
        npz of `kinemode export`, npz with points (T, L, 3) in metres, names and fps, or trc.
    """
    from estimator.evaluation import Reference
    from estimator.evaluation import evaluate as evaluate_run
    from kinemode import report
    from kinemode.api import open_run

    opened = open_run(run)
    report.print_evaluation(evaluate_run(opened, Reference.load(reference)))
    report.print_notes(opened.header.notes)


@app.command
def subjects() -> None:
    """List the subjects that have a name.

    Any other URDF is loaded by its path.
    """
    from kinemode import report

    report.print_subjects()


@app.command
def fit(
    *clips: Annotated[str, Parameter(name="clip")],
    subject: str = "human34",
    cameras: Path | None = None,
    keypoints: Files = None,
    seed: int = 0,
    person: str = "auto",
    out: Path,
) -> None:
    """Fit a subject's proportions to the first frames of a clip and write the result as a URDF.

    Example: kinemode fit cam01.mp4 --cameras calibration.json --keypoints cam01.json --out me.urdf

    Parameters
    ----------
    clips
        Video files or folders of images; none where the keypoints are enough.
    subject
        A built-in name (see `kinemode subjects`) or a URDF file with proportions.
    cameras
        JSON with K, distortion, R, t of each camera; one camera without it is guessed.
    keypoints
        2D keypoint files or folders.
    seed
        Seed of the random numbers.
    person
        Which of several people: auto (largest, then continuity) or an id of the keypoint file.
    out
        The URDF file to write.
    """
    from kinemode import api, report

    fitted = api.fit(subject, clips, cameras=cameras, keypoints=keypoints, seed=seed, person=person, out=out)
    report.print_fit(fitted, out)


@app.command
def version() -> None:
    """Print the version."""
    print(kinemode.__version__)
