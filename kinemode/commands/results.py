"""The commands that show a run, measure it and export it."""

from __future__ import annotations

from pathlib import Path

from kinemode.flags import Flag


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
    import kinemode as km

    page = km.view(run, html=html)
    if page is not None:
        print(page)


def overlay(run: Path, /, *, out: Path, camera: str | None = None, limbs: Flag = False) -> None:
    """Write the video with the body drawn over it.

    Examples:

    kinemode overlay walk.run --out walk-overlay.mp4

    kinemode overlay loose.run --limbs --out loose-limbs.mp4

    Parameters
    ----------
    run
        A run file.
    out
        A file ending in .mp4 (H.264), .webm (VP9) or .gif (smaller, 12.5 frames per second).
    camera
        Name of one camera; all of them side by side unless given.
    limbs
        In place of the body draw what the loose-limbed tracker believes of each limb: samples as outlines, stronger the
        more they weigh, and their means as cones.
    """
    import kinemode as km

    print(km.overlay(run, out, camera=camera, limbs=limbs, progress=km.reported))


def samples(
    run: Path, /, *, out: Path, frames: int = 6, count: int = 40, seed: int = 0, camera: str | None = None
) -> None:
    """Draw poses of the posterior over pictures of a run, and from the side.

    Example: kinemode samples walk.run --out walk.png

    Parameters
    ----------
    run
        A run file.
    out
        A file ending in .png.
    frames
        Instants, evenly spaced.
    count
        Poses of each instant, drawn from its calibrated posterior, all hypotheses together.
    seed
        Of what is drawn.
    camera
        Name of the camera to look through; the first unless given.
    """
    import kinemode as km

    print(km.samples(run, out, frames=frames, count=count, seed=seed, camera=camera))


def report(run: Path, /, *, out: Path) -> None:
    """Write a page about a run to read, print and send on: film, joint angles, ranges of motion, doubts, settings.

    It is one file that needs no network.

    Example: kinemode report walk.run --out walk.html

    Parameters
    ----------
    run
        A run file.
    out
        A file ending in .html.
    """
    import kinemode as km

    print(km.report(run, out, progress=km.reported))


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


def plot(run: Path, /, *, out: Path, joints: str | None = None, filter: float | None = None) -> None:
    """Draw joint angles over time in degrees, with 90 % bands, other hypotheses, and the frames not to be trusted.

    Examples:

    kinemode plot walk.run --out walk.png

    kinemode plot walk.run --joints knee,left_hip --filter 6 --out knees.pdf

    Parameters
    ----------
    run
        A run file.
    out
        A file ending in .png, .svg or .pdf.
    joints
        Names of joints, parts of them, or left and right, with commas between; hips, knees, ankles, shoulders and
        elbows unless given, or all joints of a body with few.
    filter
        Cut-off in Hz of a Butterworth filter (fourth order, without lag); off unless given.
    """
    import kinemode as km

    print(km.plot(run, out, joints=joints, filter=filter))


def export(
    run: Path, file: Path, /, *, format: str | None = None, degrees: bool = False, filter: float | None = None
) -> None:
    """Write a run for other programs.

    npz has everything; csv the joint angles; trc the landmarks; mot the joint angles for OpenSim, and osim the model
    that they drive; gait2392-mot and rajagopal-mot the joint angles of a whole person as those gait models of OpenSim
    name and measure them; c3d landmarks and joint angles; bvh a skeleton in centimetres and its turns; motion-npz
    and motion-csv root and joints at one rate, in the order of the URDF, as trainers of policies read motions; glb
    the moving body; rrd all of it for rerun, with hypotheses, cameras and keypoints. npz and rrd have all hypotheses,
    the others the best path.

    Examples:

    kinemode export walk.run walk.csv --degrees --filter 6

    kinemode export walk.run walk.osim

    kinemode export walk.run walk-gait.mot --format rajagopal-mot

    kinemode export g1.run g1-motion.npz --format motion-npz

    Parameters
    ----------
    run
        A run file.
    file
        Where to write.
    format
        npz, csv, trc, mot, osim, gait2392-mot, rajagopal-mot, c3d, bvh, motion-npz, motion-csv, glb, rrd, or that of a
        plug-in; the file's ending unless given.
    degrees
        Of csv: joint angles in degrees, with their standard deviations beside them.
    filter
        Cut-off in Hz of a Butterworth filter (fourth order, without lag) of the best path; off unless given.
    """
    import kinemode as km

    print(km.export(run, file, format=format, degrees=degrees, filter=filter))


def contact(run: Path, /, *, hands: Flag = False, out: Path | None = None, plot: Path | None = None) -> None:
    """Report when the feet are on the ground, on what floor, and how far they slide meanwhile.

    By how fast and how high heels and toes are; z points up. What rests on a box or a stair stands, too.

    Example: kinemode contact walk.run --out contact.csv --plot contact.png

    Parameters
    ----------
    run
        A run file.
    hands
        Also when hands stand on the floor.
    out
        Write a csv there, one row a frame: of each point the probability that it stands, and its height.
    plot
        Draw them over time, a PNG.
    """
    import kinemode as km

    stands = km.contact(run, hands=hands, plot=plot)
    from kinemode.terminal import report

    report.print_contact(stands)
    if out is not None:
        print(stands.write(out))
    if plot is not None:
        print(plot)


def gait(run: Path, /, *, out: Path | None = None) -> None:
    """Tell heel strikes, toe-offs and strides of a person who walks or runs.

    By when the feet stand and, for toe-offs in walking, where they are relative to the hips (Zeni et al. 2008); by the
    hips alone where keypoints have no feet; of the best hypothesis. Where nobody walks, or the clip is too short for a
    stride, that is printed.

    Example: kinemode gait walk.run --out strides.csv

    Parameters
    ----------
    run
        A run file.
    out
        Write the strides as csv there.
    """
    import kinemode as km

    walked = km.gait(run)
    from kinemode.terminal import report

    report.print_gait(walked)
    if out is not None:
        print(walked.write(out))


def evaluate(run: Path, /, *, reference: Path, up: str | None = None, offset: float = 0.0) -> None:
    """Compare a run with known landmarks and joint angles: MPJPE, PA-MPJPE, best of K, angles, limits, overlaps.

    Of landmarks the twelve limb joints are compared, or all that both sides have where fewer than three are limb
    joints; of joint angles [deg] all that both sides have by name, that of our joint or of OpenSim's gait models: mean
    absolute error and RMSE, as they are and without the bias, the mean error over the clip. Differences are taken the
    shorter way round. Best of K counts the K hypotheses of each frame.

    Example: kinemode evaluate cam01.run --reference reference3d.npz

    Parameters
    ----------
    run
        A run file.
    reference
        npz of `kinemode export`, truth.npz of `kinemode render`, npz with points (T, L, 3) in metres, names and fps,
        trc or c3d (markers, of which joint centres are compared), or joint angles: mot, sto or csv.
    up
        The axis of the world of a trc or c3d that points up: x, y, z, -x, -y or -z; unless given y of trc, and of c3d
        the file's.
    offset
        Seconds that the reference's first moment is after the clip's.
    """
    import kinemode as km

    opened = km.open_run(run)
    result = km.evaluate(opened, reference, up=up, offset=offset)
    from kinemode.terminal import report

    report.print_evaluation(result)
    report.print_notes(result.notes)
    report.print_statuses(opened.status.tolist())
    report.print_notes(opened.header.notes)
