"""`open_run`, and what is done with a run: shown, drawn over the video, plotted, reported, exported, measured."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode.checks import check_exists
from kinemode.named import PathLike
from kinemode.notices import InputWarning
from kinemode.progress import Reporter, unreported
from kinemode.public.arguments import check_arguments, check_as

if TYPE_CHECKING:
    from estimator.runs.contact import Contact
    from estimator.runs.evaluation import Evaluation
    from estimator.runs.gait import Gait
    from estimator.runs.reference_motion import Reference
    from estimator.runs.run_reader import Run

    RunLike = Run | PathLike


def open_run(path: PathLike) -> Run:
    """Open a run file, finished or still being written; raises InputError where it is none."""
    check_arguments(path=path)
    _check_run(path)
    from estimator.runs.run_reader import Run

    return Run.open(path)


def view(run: RunLike, *, html: PathLike | None = None, port: int = 0, browser: bool = True) -> Path | None:
    """Look at a run in the browser: bodies, hypotheses, cameras, the video behind.

    Parameters
    ----------
    run: a run, or the path of its file, finished or still being written: then reload the page to see more.
    html: write one self-contained page there, return its path and start nothing. Without it the page is served on this
        machine alone until Ctrl-C, and None is returned.
    port: on 127.0.0.1; 0 takes a free one. browser: whether the page is opened; its address is printed.

    Raises
    ------
    InputError: no run, one without a pose to show, a page that cannot be written, a port that cannot be used.
    """
    check_arguments(run=run, html=html, port=port, browser=browser)
    opened = _opened(run)
    _note_how_it_is_drawn(opened)
    if html is not None:
        from viz.preview.page import write_html

        return write_html(opened, Path(html))
    from viz.preview.live import serve

    serve(opened, port=port, open_browser=browser)
    return None


def overlay(
    run: RunLike,
    file: PathLike,
    *,
    camera: str | None = None,
    limbs: bool = False,
    progress: Reporter | None = None,
) -> Path:
    """Write the video with the body drawn over it, and return its path.

    Parameters
    ----------
    run: a run, or the path of its file.
    file: ending in .mp4 (H.264), .webm (VP9) or .gif (smaller, 12.5 frames per second).
    camera: the name of one; all of them side by side unless given.
    limbs: in place of the body draw what a run of the loose-limbed tracker believes of each limb: samples as outlines,
    stronger the more they weigh, and their means as cones.
    progress: opens a progress report, such as `kinemode.reported`; none by default.

    Raises
    ------
    InputError: no run, no such camera, a tracker that has no limb estimates, another ending, a file that cannot be
    written.
    """
    check_arguments(run=run, file=file, camera=camera, progress=progress)
    check_as("overwrite", limbs=limbs)
    opened = _opened(run)
    _note_how_it_is_drawn(opened)
    from viz.pictures.overlay import write_overlay

    with (progress or unreported)("overlay") as report:
        return write_overlay(opened, Path(file), camera=camera, limbs=limbs, progress=report)


def report(run: RunLike, file: PathLike, *, progress: Reporter | None = None) -> Path:
    """Write one self-contained page about a run, to read, print and send on, and return its path.

    It has the film with the body drawn over it, the joint angles with 90 % bands, a table of ranges of motion, the
    frames not to be trusted with their pictures, several cameras, what was assumed, and what repeats the run.

    Parameters
    ----------
    run: a run, or the path of its file, finished or still being written.
    file: ending in .html or .htm; one that is there is replaced.
    progress: opens a progress report, such as `kinemode.reported`; none by default.

    Raises
    ------
    InputError: no run, one without a tracked frame, another ending, a file that cannot be written.
    """
    check_arguments(run=run, file=file, progress=progress)
    if Path(file).suffix.lower() not in (".html", ".htm"):
        raise InputError(file, "is not an .html file", remedy="let it end in .html")
    opened = _opened(run)
    _note_how_it_is_drawn(opened)
    from kinemode.reporting import facts_of
    from viz.report.page import write_report

    with (progress or unreported)("report") as step:
        return write_report(opened, Path(file), facts_of(opened), progress=step)


def plot(
    run: RunLike, file: PathLike, *, joints: str | Iterable[str] | None = None, filter: float | None = None
) -> Path:
    """Draw joint angles over time, left and right together, and return the file's path.

    Each curve is the best hypothesis in degrees (metres where a joint slides) with the calibrated 90 % interval of all
    hypotheses together; the others are thin, frames that are hard or unobserved are marked, and limits that are near.

    Parameters
    ----------
    run: a run, or the path of its file; one that is not finished is drawn as far as it goes.
    file: ending in .png, .svg or .pdf.
    joints: names of joints, parts of them, or "left" and "right", in one text with commas ("knee,hip") or several; by
        default hips, knees, ankles, shoulders and elbows of a body with many joints, and all of another.
    filter: cut-off of a Butterworth filter [Hz], see `kinemode.Run.butterworth`; off unless given.

    Raises
    ------
    InputError: no run, one without a pose, no such joint (with the nearest names), another ending, a cut-off that is
        not below half the frame rate, a file that cannot be written.
    """
    check_arguments(run=run, file=file, filter=filter)
    check_as("joints of the body", joints=joints)
    opened = _filtered(_opened(run), filter)
    from viz.pictures.joint_plot import write_joint_plot

    return write_joint_plot(opened, Path(file), joints)


def samples(
    run: RunLike, file: PathLike, *, frames: int = 6, count: int = 40, seed: int = 0, camera: str | None = None
) -> Path:
    """Draw poses of the posterior over pictures of a run, and from the side, and return the file's path.

    Where a skeleton is bright many of them agree; what the image leaves open, as depth does, lies apart from the side.

    Parameters
    ----------
    run: a run, or the path of its file; one that is not finished is drawn as far as it goes.
    file: ending in .png.
    frames: instants, evenly spaced among those with a pose.
    count: poses of each instant, drawn from its calibrated posterior, all hypotheses together.
    seed: of what is drawn.
    camera: name of the camera to look through; the first unless given.

    Raises
    ------
    InputError: no run, one without a pose, no such camera, another ending, a file that cannot be written.
    """
    check_arguments(run=run, file=file, seed=seed)
    check_as("seed", frames=frames, count=count)
    for name, value in (("frames", frames), ("count", count)):
        if value < 1:
            raise InputError(name, f"{value} is too few", remedy="1 or more")
    if Path(file).suffix.lower() != ".png":
        raise InputError(file, "is no picture", remedy="let it end in .png")
    from viz.pictures.pose_samples import write_samples

    return write_samples(_opened(run), Path(file), frames=frames, count=count, seed=seed, camera=camera)


def export(
    run: RunLike,
    file: PathLike,
    *,
    format: str | None = None,
    degrees: bool = False,
    filter: float | None = None,
) -> Path:
    """Write a run for other programs, and return the file's path. The file is there whole or not at all.

    Parameters
    ----------
    run: a run, or the path of its file; one that is not finished is exported as far as it goes.
    format: "npz", everything (see `estimator.runs.export.export_arrays` for names, shapes and units); "csv", joint
        angles, landmarks, weight, energy and status; "trc", landmarks; "mot", joint angles for OpenSim; "osim", the
        subject as the OpenSim model that the mot drives; "gait2392-mot" and "rajagopal-mot", joint angles as those
        models name and measure them (docs/opensim.md); "c3d", landmarks and joint angles (ezc3d); "bvh", a skeleton
        [cm] and its turns; "motion-npz" and "motion-csv", root, joints and, in the npz, links at one rate, in the order
        of the URDF, for trainers of policies (`estimator.runs.trainer_motion.motion_arrays`); "glb", the moving body;
        "rrd", body, hypotheses, cameras, keypoints and angles for rerun. By default by the file's ending. npz
        and rrd have all hypotheses, the others the best path. Frames that nobody saw are marked, by their status, as
        missing points or in a line; bvh, glb and motions for trainers have no mark for them, with a warning.
    degrees: of csv, joint angles in degrees, their standard deviations beside them; otherwise these are its last
        columns, and both are in radians.
    filter: cut-off of a Butterworth filter of the best path [Hz], see `kinemode.Run.butterworth`; off unless given.

    Raises
    ------
    InputError: no run, an unknown format, degrees of another than csv, a cut-off that is not below half the frame rate,
        a library that is not installed, a file that cannot be written.
    """
    check_arguments(run=run, file=file, format=format, degrees=degrees, filter=filter)
    opened = _filtered(_opened(run), filter)
    import viz.exporters  # noqa: F401 - registers those that show the body
    from estimator.runs import export as formats
    from estimator.runs.filtering import evenly_spaced, frame_rate
    from estimator.runs.unobserved import unobserved_note

    chosen, known = formats.chosen_format(Path(file), format), formats.EXPORTERS
    if chosen in known and known[chosen].one_rate and len(opened.time) > 2 and not evenly_spaced(opened.time):
        rate = frame_rate(opened.time)
        said = f"frames are not evenly spaced: {chosen} has poses between them, at {rate:.4g} a second"
        warnings.warn(said, InputWarning, stacklevel=2)
    unseen = unobserved_note(opened.unobserved, opened.unseen_joints)
    if unseen and chosen in known and not known[chosen].marks:
        warnings.warn(f"{unseen}; {chosen} has no mark for that", InputWarning, stacklevel=2)
    return formats.export(opened, Path(file), format, degrees=degrees)


def contact(run: RunLike, *, hands: bool = False, plot: PathLike | None = None) -> Contact:
    """When the feet of a run's drawn trajectory stand, heels and toes apart, and on what floor.

    From how fast and how high they are in the world, z up; see `estimator.inference.contacts` for the method. A
    probability for each point and frame, the floor with its uncertainty, stances with how far the point slides, and
    when feet begin and cease to stand. Nothing is moved: a trajectory whose feet slide is reported as it is. On a
    treadmill, which is found by the velocity that both feet share, feet that move with the belt stand, and `belt` has
    its velocity.

    Parameters
    ----------
    run: a run, or the path of its file; of one that is not finished, the frames that are there are used. hands: also
    when hands stand on the floor; the setting `smooth.hands` holds them while smoothing. plot: draw probabilities and
    heights over time there, a PNG, with heel strikes and toe-offs where somebody walks.

    Raises
    ------
    InputError: no run, a subject without heels and toes, or a picture that cannot be written.
    """
    check_arguments(run=run, hands=hands, plot=plot)
    opened = _opened(run)
    from estimator.runs.contact import contact_of_run

    stands = contact_of_run(opened, hands=hands)
    if stands is None:
        remedy = "contact needs a person with feet, such as human34"
        raise InputError(opened.header.subject_source, "has no landmark left_heel", remedy=remedy)
    if plot is not None:
        from estimator.runs.gait import gait_if_whole
        from viz.pictures.contact_plot import write_contact_plot

        walked = gait_if_whole(opened, stands)
        write_contact_plot(stands, plot, walked.events if walked else ())
    return stands


def gait(run: RunLike) -> Gait:
    """When the feet of a run's best hypothesis touch and leave the ground, and the strides between.

    A foot strikes when it begins to stand, see `contact`. It leaves the ground when its toes are farthest behind the
    pelvis (Zeni et al., Gait & Posture 27(4), 2008) if the other foot stands, when it ceases to stand if not, as in
    running. Where keypoints have no feet, so that contact is not to be trusted, both events are by the pelvis, and
    `method` is "pelvis" rather than "contact". World z is up. See `estimator.runs.gait.Stride` for what a stride
    has. Where nobody walks there are no strides, and `remark` has the reason. On a treadmill lengths and speeds are
    along the belt, whose speed is `belt`.

    Parameters
    ----------
    run: a run, or the path of its file; of one that is not finished, the frames that are there are used.

    Raises
    ------
    InputError: no run, or a subject without heels, toes or hips.
    """
    check_arguments(run=run)
    opened = _opened(run)
    from estimator.runs.gait import gait_of_run

    return gait_of_run(opened)


def evaluate(
    run: RunLike,
    reference: Reference | PathLike,
    *,
    joints: Sequence[str] | None = None,
    up: str | None = None,
    offset: float = 0.0,
) -> Evaluation:
    """Compare a run with known landmarks [m] and joint angles: MPJPE, PA-MPJPE, best of K, angles, limits, overlaps.

    Parameters
    ----------
    run: a run, or the path of its file.
    reference: a `kinemode.Reference`, or a file: npz of `export`, truth.npz of `render`, npz with points (T, L, 3) in
        metres, names and fps, trc or c3d (markers, of which joint centres are compared), or joint angles: mot and sto
        (degrees or radians by the header), and csv (`estimator.data.formats.angle_files.read_angle_csv`).
    joints: the landmarks to compare; unless given the twelve limb joints, or all that both have where fewer than three
        are limb joints.
    up: the axis of the world of a trc or c3d that points up, x, y, z, -x, -y or -z; unless given y of trc, and of c3d
        the file's.
    offset: seconds that the file's first moment is after the clip's.

    Raises
    ------
    InputError: no run, no reference, nothing that both have, too few markers, no axis.
    """
    check_arguments(run=run, reference=reference, joints=joints, up=up, offset=offset)
    _check_run(run)
    if isinstance(reference, (str, Path)):
        check_exists(reference)
    opened = _opened(run)
    from estimator.runs import evaluation

    if isinstance(reference, (str, Path)):
        reference = evaluation.Reference.load(reference, up=up, offset=offset)
    elif up is not None or offset:
        raise InputError("reference", "is no file, for which up and offset are", remedy="leave them out")
    return evaluation.evaluate(opened, reference.in_world_of(opened.header.R_upright_given), joints=joints)


def _check_run(run: RunLike) -> None:
    """Raise InputError where a path is no run file's, before everything that reads runs is loaded."""
    if isinstance(run, (str, os.PathLike)):
        from estimator.runs.run_store import check

        check(Path(run))


def _opened(run: RunLike) -> Run:
    return open_run(run) if isinstance(run, (str, os.PathLike)) else run


def _filtered(run: Run, cutoff: float | None) -> Run:
    """The run, filtered where a cut-off [Hz] is given, with warnings about what was filtered."""
    if cutoff is None:
        return run
    filtered = run.butterworth(float(cutoff))
    for note in filtered.filtering.notes if filtered.filtering else ():
        warnings.warn(note, InputWarning, stacklevel=3)
    return filtered


def _note_how_it_is_drawn(run: Run) -> None:
    from viz.solids.body_solids import drawing_notes

    for note in drawing_notes(run.body):
        warnings.warn(note, InputWarning, stacklevel=3)
