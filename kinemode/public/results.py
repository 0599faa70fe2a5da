"""`open_run`, and the uses of a run: shown, drawn over the video, plotted, reported, exported, measured."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode import kinds
from kinemode.checks import check_exists
from kinemode.named import PathLike
from kinemode.notices import warn
from kinemode.option import takes
from kinemode.run_requests import (
    ContactRequest,
    EvaluateRequest,
    ExportRequest,
    ForcesRequest,
    GaitRequest,
    OverlayRequest,
    PlotRequest,
    ReportRequest,
    SamplesRequest,
    ViewRequest,
)

if TYPE_CHECKING:
    from estimator.runs.contact import Contact
    from estimator.runs.evaluation import Evaluation
    from estimator.runs.forces import Forces
    from estimator.runs.gait import Gait
    from estimator.runs.run_reader import Run
    from kinemode.run_requests import RunLike
    from viz.scene import Scene


def open_run(path: PathLike) -> Run:
    """Open a run file, finished or still being written; raises InputError where it is not one."""
    kinds.check(path=(path, kinds.RUN_FILE))
    _check_run(path)
    from estimator.runs.run_reader import Run

    return Run.open(path)


@takes(ViewRequest)
def view(request: ViewRequest) -> Path | None:
    """Look at a run in the browser: bodies, hypotheses, cameras, the video behind.

    Parameters
    ----------
    OPTIONS

    Returns the path of the page, None where it was served.

    Raises
    ------
    InputError: no run, one without a pose to show, a page that cannot be written, a port that cannot be used.
    """
    opened = _drawn(request.run)
    shown: Run | Scene = opened
    if request.mass is not None:
        from viz.scene import as_scene

        shown = replace(as_scene(opened), forces=_forces(opened, request.mass))
    if request.html is not None:
        from viz.preview.page import write_html

        return write_html(shown, Path(request.html))
    from viz.preview.live import serve

    serve(shown, port=request.port, open_browser=request.browser)
    return None


@takes(OverlayRequest)
def overlay(request: OverlayRequest) -> Path:
    """Write the video with the body drawn over it, and return its path.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, no such camera, a tracker that has no limb estimates, another ending, a file that cannot be
    written.
    """
    opened = _drawn(request.run)
    from viz.pictures.overlay import write_overlay

    with request.reporter("overlay") as report:
        return write_overlay(opened, Path(request.file), camera=request.camera, limbs=request.limbs, progress=report)


@takes(ReportRequest)
def report(request: ReportRequest) -> Path:
    """Write one self-contained page about a run, to read, print and send on, and return its path.

    It has the film with the body drawn over it, the joint angles with 90 % bands, a table of ranges of motion, the
    unreliable frames with their pictures, several cameras, assumptions, and the command that repeats the run.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, one without a tracked frame, another ending, a file that cannot be written.
    """
    if Path(request.file).suffix.lower() not in (".html", ".htm"):
        raise InputError(request.file, "is not an .html file", remedy="let it end in .html")
    opened = _drawn(request.run)
    from kinemode.reporting import facts_of
    from viz.report.page import write_report

    forces = None if request.mass is None else _forces(opened, request.mass)
    with request.reporter("report") as step:
        return write_report(opened, Path(request.file), facts_of(opened), forces=forces, progress=step)


@takes(PlotRequest)
def plot(request: PlotRequest) -> Path:
    """Draw joint angles over time, left and right together, and return the file's path.

    Each curve is the best hypothesis in degrees (metres where a joint slides) with the calibrated 90 % interval of all
    hypotheses together; the others are thin, frames that are hard or unobserved are marked, and limits that are near.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, one without a pose, no such joint (with the nearest names), another ending, a cut-off that is
        not below half the frame rate, a file that cannot be written.
    """
    opened = _filtered(_opened(request.run), request.filter)
    from viz.pictures.joint_plot import write_joint_plot

    return write_joint_plot(opened, Path(request.file), request.joints)


@takes(SamplesRequest)
def samples(request: SamplesRequest) -> Path:
    """Draw poses of the posterior over pictures of a run, and from the side, and return the file's path.

    Where a skeleton is bright many of them agree; what the image leaves undetermined, as depth, is spread in the side
    view.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, one without a pose, no such camera, another ending, a file that cannot be written.
    """
    if Path(request.file).suffix.lower() != ".png":
        raise InputError(request.file, "is not a .png file", remedy="let it end in .png")
    from viz.pictures.pose_samples import write_samples

    return write_samples(
        _opened(request.run), Path(request.file), frames=request.frames, count=request.count, seed=request.seed,
        camera=request.camera,
    )  # fmt: skip


@takes(ExportRequest)
def export(request: ExportRequest) -> Path:
    """Write a run for other programs, and return the file's path. The file is there whole or not at all.

    npz has everything (see `estimator.runs.export.export_arrays` for names, shapes and units); csv joint angles,
    landmarks, weight, energy and status; trc landmarks; mot joint angles for OpenSim, and osim the model that they
    drive; gait2392-mot and rajagopal-mot joint angles as those models name and measure them (docs/opensim.md); c3d
    landmarks and joint angles (ezc3d); bvh a skeleton [cm] and its turns; motion-npz and motion-csv root, joints and,
    in the npz, links at one rate, in the order of the URDF, for trainers of policies
    (`estimator.runs.trainer_motion.motion_arrays`); glb the moving body; rrd body, hypotheses, cameras, keypoints and
    angles for rerun. npz and rrd have all hypotheses, the others the best path. Unobserved frames are marked, by
    their status, as missing points or in a line; bvh, glb and motions for trainers have no mark for them, with a
    warning.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, an unknown format, degrees of another than csv, a cut-off that is not below half the frame rate,
        a library that is not installed, a file that cannot be written.
    """
    opened, file = _filtered(_opened(request.run), request.filter), Path(request.file)
    import viz.exporters  # noqa: F401 - registers those that show the body
    from estimator.runs import export as formats
    from estimator.runs.filtering import evenly_spaced, frame_rate
    from estimator.runs.unobserved import unobserved_note

    chosen, known = formats.chosen_format(file, request.format), formats.EXPORTERS
    if chosen in known and known[chosen].one_rate and len(opened.time) > 2 and not evenly_spaced(opened.time):
        rate = frame_rate(opened.time)
        said = f"frames are not evenly spaced: {chosen} has poses between them, at {rate:.4g} a second"
        warn(said)
    unseen = unobserved_note(opened.unobserved, opened.unseen_joints)
    if unseen and chosen in known and not known[chosen].marks:
        warn(f"{unseen}; {chosen} has no mark for that")
    return formats.export(opened, file, request.format, degrees=request.degrees)


@takes(ContactRequest)
def contact(request: ContactRequest) -> Contact:
    """When the feet of a run's drawn trajectory stand, heels and toes apart, and on what floor.

    From how fast and how high they are in the world, z up; see `estimator.inference.contacts` for the method. A
    probability for each point and frame, the floor with its uncertainty, stances with how far the point slides, and
    when feet start and stop standing. Nothing is moved: sliding feet are reported as they are. On a
    treadmill, which is found by the velocity that both feet share, feet that move with the belt stand, and `belt` has
    its velocity.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, a subject without heels and toes, or a picture that cannot be written.
    """
    opened = _opened(request.run)
    from estimator.runs.contact import contact_of_run

    stands = contact_of_run(opened, hands=request.hands)
    if stands is None:
        remedy = "contact needs a person with feet, such as human34"
        raise InputError(opened.header.subject_source, "has no landmark left_heel", remedy=remedy)
    if request.plot is not None:
        from estimator.runs.gait import gait_if_whole
        from viz.pictures.contact_plot import write_contact_plot

        walked = gait_if_whole(opened, stands)
        write_contact_plot(stands, request.plot, walked.events if walked else ())
    return stands


@takes(GaitRequest)
def gait(request: GaitRequest) -> Gait:
    """When the feet of a run's best hypothesis touch and leave the ground, and the strides between.

    A foot strikes when it starts to stand, see `contact`. It leaves the ground when its toes are farthest behind the
    pelvis (Zeni et al., Gait & Posture 27(4), 2008) if the other foot stands, when it ceases to stand if not, as in
    running. Where keypoints have no feet, so that contact is not to be trusted, both events are by the pelvis, and
    `method` is "pelvis" rather than "contact". World z is up. See `estimator.runs.gait.Stride` for what a stride
    has. Without walking there are no strides, and `remark` has the reason. On a treadmill lengths and speeds are
    along the belt, whose speed is `belt`.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, or a subject without heels, toes or hips.
    """
    opened = _opened(request.run)
    from estimator.runs.gait import gait_of_run

    return gait_of_run(opened)


@takes(ForcesRequest)
def forces(request: ForcesRequest) -> Forces:
    """Ground reaction forces, joint moments and powers of a run's best hypothesis, with bands.

    By inverse dynamics of the drawn trajectory, as smooth as the run is: forces under the soles push, stay within their
    friction cones and balance the body; where both feet stand, what motion does not determine is chosen (see
    `estimator.dynamics.contact_forces`). World z is up, and gravity along it. Bands come from samples of what the
    poses, the times of contact and the mass might be. Of a body with a fixed base there are moments alone. Where hips
    rest on a chair, `seat` is what the feet cannot carry.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, a body without masses that is not a person, or without feet, feet that never stand or stand on a
        treadmill of unknown speed, a person who does not stand along z, fewer than eight poses in a row, a cut-off that
        is not below half the frame rate, or a picture that cannot be written.
    """
    if request.out is not None:
        from estimator.runs.forces import check_ending

        check_ending(request.out)
    with request.reporter("forces") as report:
        result = _forces(_opened(request.run), request.mass, request.filter, request.seed, report)
    if request.out is not None:
        result.write(request.out)
    if request.plot is not None:
        from viz.pictures.forces_plot import write_forces_plot

        write_forces_plot(result, request.plot)
    return result


@takes(EvaluateRequest)
def evaluate(request: EvaluateRequest) -> Evaluation:
    """Compare a run with known landmarks [m] and joint angles: MPJPE, PA-MPJPE, best of K, angles, limits, overlaps.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: no run, no reference, nothing that both have, too few markers, no axis.
    """
    reference, up, offset = request.reference, request.up, request.offset
    _check_run(request.run)
    if isinstance(reference, (str, os.PathLike)):
        check_exists(reference)
    opened = _opened(request.run)
    from estimator.runs import evaluation

    if isinstance(reference, (str, os.PathLike)):
        reference = evaluation.Reference.load(reference, up=up, offset=offset)
    elif up is not None or offset:
        raise InputError("reference", "is not a file, and up and offset are for files", remedy="leave them out")
    return evaluation.evaluate(opened, reference.in_world_of(opened.header.R_upright_given), joints=request.joints)


def _check_run(run: RunLike) -> None:
    """Raise InputError where a path is not a run file, before everything that reads runs is loaded."""
    if isinstance(run, (str, os.PathLike)):
        from estimator.runs.run_store import check

        check(Path(run))


def _opened(run: RunLike) -> Run:
    return open_run(run) if isinstance(run, (str, os.PathLike)) else run


def _forces(
    run: Run,
    mass: float | None,
    cutoff: float | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Forces:
    """Forces of a run, with a warning where they are doubtful; cutoff [Hz]: None for the usual one."""
    from estimator.runs.inverse_dynamics import forces_of_run
    from estimator.runs.run_motion import usual_cutoff
    from kinemode.findings import upright_note

    if tilted := upright_note(run):
        raise InputError(run.file, tilted, remedy="forces need gravity along -z")
    chosen = usual_cutoff(run.time) if cutoff is None else cutoff
    result = forces_of_run(_filtered(run, chosen or None), mass, seed=seed, progress=progress)
    if result.remark:
        warn(result.remark)
    return result


def _filtered(run: Run, cutoff: float | None) -> Run:
    """The run, filtered where a cut-off [Hz] is given, with warnings about what was filtered."""
    if cutoff is None:
        return run
    filtered = run.butterworth(float(cutoff))
    for note in filtered.filtering.notes if filtered.filtering else ():
        warn(note)
    return filtered


def _drawn(run: RunLike) -> Run:
    """The run, with warnings about how its body is drawn."""
    opened = _opened(run)
    from viz.solids.body_solids import drawing_notes

    for note in drawing_notes(opened.body):
        warn(note)
    return opened
