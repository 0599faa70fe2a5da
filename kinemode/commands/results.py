"""The commands that look at a run, measure it and hand it on."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from estimator.results.run_file import Run

Format = Literal["npz", "csv", "trc", "mot"]


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

    opened = open_run(run)
    _say_how_it_is_drawn(opened)
    if html is None:
        from viz.preview.live import serve

        serve(opened)
    else:
        from viz.preview.page import write_html

        print(write_html(opened, html))


def _say_how_it_is_drawn(run: Run) -> None:
    from kinemode.api import InputWarning
    from viz.solids.body_solids import drawing_notes

    for note in drawing_notes(run.body):
        warnings.warn(note, InputWarning, stacklevel=2)


def overlay(run: Path, /, *, out: Path, camera: str | None = None) -> None:
    """Write the video with the body drawn over it.

    Example: kinemode overlay walk.run --out walk-overlay.mp4

    Parameters
    ----------
    run
        A run file.
    out
        A file ending in .mp4 (H.264), .webm (VP9) or .gif (smaller, 12.5 frames per second).
    camera
        Name of one camera; all of them side by side unless given.
    """
    from kinemode.api import open_run
    from kinemode.terminal.progress import reported
    from viz.pictures.overlay import write_overlay

    opened = open_run(run)
    _say_how_it_is_drawn(opened)
    with reported("overlay") as progress:
        written = write_overlay(opened, out, camera=camera, progress=progress)
    print(written)


def explain(run: Path, /, *, frame: int, out: Path | None = None, hypothesis: int | None = None) -> None:
    """Show what a frame's energy is made of, term by term and camera by camera.

    Examples:

    kinemode explain walk.run --frame 12

    kinemode explain walk.run --frame 12 --hypothesis 1 --out frame12

    Parameters
    ----------
    run
        A run file.
    frame
        Number of the frame in the run, as the overlay shows it.
    out
        Folder for pictures of each camera's cues with the body on them.
    hypothesis
        Its place in the frame, 0 for the heaviest; the one on the best path unless given.
    """
    from kinemode.api import open_run
    from kinemode.explain import explain as explain_frame
    from kinemode.findings import findings, status_meanings
    from kinemode.terminal import report
    from viz.cue_pictures import write_cue_pictures

    opened = open_run(run)
    explanation = explain_frame(opened, frame, hypothesis)
    report.print_explanation(explanation)
    report.print_lines([*status_meanings([explanation.status]), *findings(opened, frame)])
    for path in write_cue_pictures(explanation.views, out) if out is not None else ():
        print(path)


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
    from estimator.results import export as formats
    from kinemode.api import open_run

    formats.export(open_run(run), file, format)
    print(file)


def evaluate(run: Path, /, *, reference: Path) -> None:
    """Compare a run with known landmarks and joint angles: MPJPE, PA-MPJPE, best of K, angles, limits, overlaps.

    Of landmarks the twelve limb joints are compared, or all that both sides have where fewer than three are limb
    joints; of joint angles all that both sides have by name. Best of K counts the K hypotheses of each frame.

    Example: kinemode evaluate cam01.run --reference reference3d.npz

    Parameters
    ----------
    run
        A run file.
    reference
        npz of `kinemode export`, truth.npz of `kinemode render`, npz with points (T, L, 3) in metres, names and fps,
        trc (landmarks) or mot (joint angles).
    """
    from estimator.results.evaluation import Reference
    from estimator.results.evaluation import evaluate as evaluate_run
    from kinemode.api import open_run
    from kinemode.terminal import report

    opened = open_run(run)
    report.print_evaluation(evaluate_run(opened, Reference.load(reference)))
    report.print_statuses(opened.status.tolist())
    report.print_notes(opened.header.notes)
