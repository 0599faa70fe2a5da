"""The commands that show a run, measure it and export it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from kinemode.flags import flags_of
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

_RUN = ("run",)
_STRIDES = "Write the strides as csv there."
_TABLE = "Write a csv there, one row a frame: of each point the probability that it stands, and its height."


@flags_of(ViewRequest, arguments=_RUN)
def view(**given: Any) -> None:
    """Look at a run in the browser: bodies, hypotheses, the video behind.

    For example:

    kinemode view walk.run

    kinemode view walk.run --html walk.html
    """
    import kinemode as km

    page = km.view(**given)
    if page is not None:
        print(page)


@flags_of(OverlayRequest, arguments=_RUN)
def overlay(**given: Any) -> None:
    """Write the video with the body drawn over it.

    For example:

    kinemode overlay walk.run --out walk-overlay.mp4

    kinemode overlay loose.run --limbs --out loose-limbs.mp4
    """
    import kinemode as km

    print(km.overlay(**given, progress=km.reported))


@flags_of(SamplesRequest, arguments=_RUN)
def samples(**given: Any) -> None:
    """Draw poses of the posterior over pictures of a run, and from the side.

    Example: kinemode samples walk.run --out walk.png
    """
    import kinemode as km

    print(km.samples(**given))


@flags_of(ReportRequest, arguments=_RUN)
def report(**given: Any) -> None:
    """Write a page about a run to read, print and send on: film, joint angles, ranges of motion, doubts, settings.

    It is one file that needs no network.

    Example: kinemode report walk.run --out walk.html
    """
    import kinemode as km

    print(km.report(**given, progress=km.reported))


def explain(run: Path, /, *, frame: int, out: Path | None = None, hypothesis: int | None = None) -> None:
    """Show the parts of a frame's energy, term by term and camera by camera.

    For example:

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
    import kinemode as km

    opened = km.open_run(run)
    from kinemode.explain import explain as explain_frame
    from kinemode.findings import diagnosed, status_meanings
    from kinemode.terminal import report
    from viz.cue_pictures import write_cue_pictures

    explanation = explain_frame(opened, frame, hypothesis)
    report.print_explanation(explanation)
    report.print_lines([*status_meanings([explanation.status]), *diagnosed(opened, frame).sentences])
    for path in write_cue_pictures(explanation.views, out) if out is not None else ():
        print(path)


@flags_of(PlotRequest, arguments=_RUN)
def plot(**given: Any) -> None:
    """Draw joint angles over time in degrees, with 90 % bands, other hypotheses, and the frames not to be trusted.

    For example:

    kinemode plot walk.run --out walk.png

    kinemode plot walk.run --joints knee,left_hip --filter 6 --out knees.pdf
    """
    import kinemode as km

    print(km.plot(**given))


@flags_of(ExportRequest, arguments=("run", "file"))
def export(**given: Any) -> None:
    """Write a run for other programs.

    npz has everything; csv the joint angles; trc the landmarks; mot the joint angles for OpenSim, and osim the model
    that they drive; gait2392-mot and rajagopal-mot the joint angles of a whole person as those gait models of OpenSim
    name and measure them; c3d landmarks and joint angles; bvh a skeleton in centimetres and its turns; motion-npz
    and motion-csv root and joints at one rate, in the order of the URDF, as trainers of policies read motions; glb
    the moving body; rrd all of it for rerun, with hypotheses, cameras and keypoints. npz and rrd have all hypotheses,
    the others the best path.

    For example:

    kinemode export walk.run walk.csv --degrees --filter 6

    kinemode export walk.run walk.osim

    kinemode export walk.run walk-gait.mot --format rajagopal-mot

    kinemode export g1.run g1-motion.npz --format motion-npz
    """
    import kinemode as km

    print(km.export(**given))


@flags_of(ContactRequest, arguments=_RUN)
def contact(*, out: Annotated[Path | None, Parameter(help=_TABLE)] = None, **given: Any) -> None:
    """Report when the feet are on the ground, on what floor, and how far they slide meanwhile.

    By how fast and how high heels and toes are; z points up. What rests on a box or a stair stands, too.

    Example: kinemode contact walk.run --out contact.csv --plot contact.png
    """
    import kinemode as km

    stands = km.contact(**given)
    from kinemode.terminal import report

    report.print_contact(stands)
    if out is not None:
        print(stands.write(out))
    if given["plot"] is not None:
        print(given["plot"])


@flags_of(GaitRequest, arguments=_RUN)
def gait(
    *, out: Annotated[Path | None, Parameter(help="Write the strides as csv there.")] = None, **given: Any
) -> None:
    """Report heel strikes, toe-offs and strides of a person who walks or runs.

    By when the feet stand and, for toe-offs in walking, where they are relative to the hips (Zeni et al. 2008); by the
    hips alone where keypoints have no feet; of the best hypothesis. Without walking, or where the clip is too short for
    a stride, that is printed.

    Example: kinemode gait walk.run --out strides.csv
    """
    import kinemode as km

    walked = km.gait(**given)
    from kinemode.terminal import report

    report.print_gait(walked)
    if out is not None:
        print(walked.write(out))


@flags_of(ForcesRequest, arguments=_RUN)
def forces(**given: Any) -> None:
    """Estimate ground reaction forces, joint moments and powers, with 50 and 90 % bands.

    By inverse dynamics with contact of the soles; bands come from samples of poses, contacts and mass. Of who stands on
    both feet only the sum is determined by motion, and the split between the feet in part.

    For example:

    kinemode forces walk.run --mass 72 --out forces.csv --plot forces.png

    kinemode forces walk.run --out loads.mot
    """
    import kinemode as km

    result = km.forces(**given, progress=km.reported)
    from kinemode.terminal import report

    report.print_forces(result)
    for path in (given["out"], given["plot"]):
        if path is not None:
            print(path)


@flags_of(EvaluateRequest, arguments=_RUN)
def evaluate(**given: Any) -> None:
    """Compare a run with known landmarks and joint angles: MPJPE, PA-MPJPE, best of K, angles, limits, overlaps.

    Of landmarks the twelve limb joints are compared, or all that both sides have where fewer than three are limb
    joints; of joint angles [deg] all that both sides have by name, that of our joint or of OpenSim's gait models: mean
    absolute error and RMSE, with and without the bias, the mean error over the clip. Differences are taken the
    shorter way round. Best of K counts the K hypotheses of each frame.

    Example: kinemode evaluate cam01.run --reference reference3d.npz
    """
    import kinemode as km

    opened = km.open_run(given.pop("run"))
    result = km.evaluate(opened, **given)
    from kinemode.terminal import report

    report.print_evaluation(result)
    report.print_notes(result.notes)
    report.print_statuses(opened.status.tolist())
    report.print_notes(opened.header.notes)
