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
    cues: str = "auto",
    mask: Files = None,
    background: Files = None,
    settings: Path | None = None,
    tracker: str = "css",
    modes: int | None = None,
    seed: int = 0,
    fit: Literal["auto", "proportions", "off"] = "auto",
    person: str = "auto",
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
        css (several hypotheses), css-paper (as printed) or single-mode.
    modes
        How many hypotheses are kept; 7 unless the settings say otherwise.
    seed
        Seed of the tracker's random numbers; the same seed gives the same run.
    fit
        auto fits a built-in subject to the person in the first frames: the proportions, and the flesh where edges or
        silhouettes are looked at; a file is taken as measured. proportions leaves the flesh, off everything as it is.
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
        Number of the frame.
    out
        Folder for pictures of each camera's cues with the body on them.
    hypothesis
        Its place in the frame, 0 for the heaviest; the one on the best path unless given.
    """
    from kinemode import report
    from kinemode.api import open_run
    from kinemode.explain import explain as explain_frame
    from viz.cue_pictures import write_cue_pictures

    explanation = explain_frame(open_run(run), frame, hypothesis)
    report.print_explanation(explanation)
    for path in write_cue_pictures(explanation.views, out) if out is not None else ():
        print(path)


@app.command
def settings(*, tracker: str = "css", out: Path | None = None) -> None:
    """Print all settings of a tracker as a TOML file, each with what it means, to be edited and given to `track`.

    Example: kinemode settings --out slow.toml

    Parameters
    ----------
    tracker
        css, css-paper or single-mode.
    out
        Write the file here.
    """
    from kinemode.settings import describe_settings, write_settings

    if out is None:
        print(describe_settings(tracker), end="")
    else:
        print(write_settings(out, tracker))


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
    cues: str = "auto",
    mask: Files = None,
    background: Files = None,
    seed: int = 0,
    person: str = "auto",
    out: Path,
) -> None:
    """Fit a subject's proportions, and with pictures its flesh, to the first frames of a clip; write it as a URDF.

    Examples:

    kinemode fit cam01.mp4 --cameras calibration.json --keypoints cam01.json --out me.urdf

    kinemode fit walk.mp4 --keypoints clicks.json --background empty.png --out me.urdf

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
    cues
        What the flesh is fitted to, see `track`: off, or some of edges,silhouette.
    mask
        Videos or folders of masks, white on the person.
    background
        Pictures of the empty scene.
    seed
        Seed of the random numbers.
    person
        Which of several people: auto (largest, then continuity) or an id of the keypoint file.
    out
        The URDF file to write.
    """
    from kinemode import api, report

    fitted = api.fit(
        subject,
        clips,
        cameras=cameras,
        keypoints=keypoints,
        cues=cues,
        masks=mask,
        background=background,
        seed=seed,
        person=person,
        out=out,
    )
    report.print_fit(fitted, out)


@app.command
def annotate(
    clip: Path,
    /,
    *,
    frame: int = 0,
    subject: str = "human34",
    camera: str | None = None,
    keypoints: Path | None = None,
    out: Path = Path("clicks.json"),
    port: int = 0,
    no_browser: Flag = False,
) -> None:
    """Click a subject's landmarks on frames of a clip, in the browser, and save them as keypoints.

    The page is served on this machine only. Ctrl-C ends it; what was saved stays.

    Examples:

    kinemode annotate walk.mp4 --out clicks.json

    kinemode annotate walk.mp4 --keypoints walk.json --out corrected.json

    Parameters
    ----------
    clip
        A video file or a folder of images.
    frame
        The frame shown first; the page goes to the others.
    subject
        A built-in name (see `kinemode subjects`) or a URDF file: whose landmarks are clicked.
    camera
        Name of the view, where it is not the clip's stem.
    keypoints
        A detector's keypoint file or folder to correct: it fills the frames without a click.
    out
        The keypoint file to write; one saved earlier is edited further.
    port
        Port on 127.0.0.1; 0 takes a free one.
    no_browser
        Print the page's address and open nothing.
    """
    from kinemode.annotate import annotate as annotate_clip

    command = annotate_clip(
        clip,
        subject=subject,
        frame=frame,
        camera=camera,
        keypoints=keypoints,
        out=out,
        port=port,
        open_browser=not no_browser,
    )
    print(f"{out}\nnext: {command}")


@app.command
def render(
    *,
    motion: str = "reach",
    out: Path,
    subject: str | None = None,
    girth: float = 1.0,
    background: Literal["room", "pillar", "black", "moving"] | None = None,
    cameras: int = 1,
    azimuth: float | None = None,
    fps: float = 30.0,
    seconds: float | None = None,
    seed: int = 0,
    occluder: Literal["none", "post", "box"] = "none",
    noise: float = 2.5,
    shutter: float = 0.0,
    lens_blur: float = 0.0,
    keypoint_noise: float = 2.5,
    outliers: float = 0.01,
    missing: float = 0.02,
    unit: float | None = None,
    masks: Flag = False,
) -> None:
    """Render a clip whose motion is known: videos, cameras, keypoints, the exact first frame, the truth, the body.

    Examples:

    kinemode render --motion turn_reach --out turn

    kinemode render --motion walk.bvh --cameras 2 --shutter 0.5 --out walk

    Parameters
    ----------
    motion
        reach, arm, pivot, turn_reach, or a BVH file of a person.
    out
        Folder for the files.
    subject
        The body in the pictures: a built-in name or a URDF file; the one the motion is made for unless given.
    girth
        Factor on the cross-sections of its limbs.
    background
        What is behind the person; what suits the motion unless given.
    cameras
        How many.
    azimuth
        Of the first camera in degrees, from the person's front to the person's left.
    fps
        Frames per second.
    seconds
        Only so much of the motion.
    seed
        Of the scene, the clothes, the sensor's noise and the keypoints' errors.
    occluder
        What stands between the first camera and the person.
    noise
        Of the sensor, in grey values.
    shutter
        Share of the time between frames that the shutter is open: motion blur.
    lens_blur
        Standard deviation of the lens's blur in pixels.
    keypoint_noise
        Standard deviation of the keypoints in pixels.
    outliers
        Share of the keypoints that are far off.
    missing
        Share of the keypoints that are missing.
    unit
        Metres in one unit of the BVH file, where it is known.
    masks
        Also write the person's exact silhouettes.
    """
    from estimator.synthesis import DetectorSettings, SceneSettings, ViewSettings
    from kinemode.progress import reported
    from kinemode.render import background_of, render_clip

    scene = SceneSettings(
        background=background or background_of(motion),
        occluder=occluder,
        noise=noise,
        shutter=shutter,
        lens_blur=lens_blur,
    )
    render_clip(
        out,
        motion,
        subject=subject,
        girth=girth,
        scene=scene,
        view=ViewSettings(count=cameras, azimuth=azimuth),
        detector=DetectorSettings(keypoint_noise, outliers, missing),
        fps=fps,
        seconds=seconds,
        unit=unit,
        seed=seed,
        masks=masks,
        progress=reported,
    )
    print(out)


@app.command
def version() -> None:
    """Print the version."""
    print(kinemode.__version__)
