"""The command that makes a motion another body's."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from kinemode.options import Flag, SubjectOption, UpOption


def retarget(
    source: Path | None = None,
    /,
    *,
    subject: SubjectOption = "example-robot-data:g1",
    match: str | None = None,
    contacts: str | None = None,
    method: Literal["windows", "frames"] = "windows",
    velocity: float = 1.0,
    clearance: float = 0.002,
    fps: float | None = None,
    up: UpOption = None,
    unit: str | None = None,
    layout: str | None = None,
    modes: int = 0,
    seed: int = 0,
    metrics: Path | None = None,
    out: Path,
    overwrite: Flag = False,
) -> None:
    """Make a person's motion a robot's, or any other body's: within its limits, feet on the ground.

    Without a source it begins a correspondence: --match names the subject, --out the TOML file.

    Examples:

    kinemode retarget walk.run --subject example-robot-data:g1 --out g1.run

    kinemode retarget walk.bvh --subject robot.urdf --match match.toml --out robot.run --metrics robot.csv

    kinemode retarget --match robot.urdf --out match.toml

    Parameters
    ----------
    source
        A run, BVH, points with landmarks' names (TRC, C3D, npz, csv), or an npz of joints in the order of SMPL or of
        another program.
    match
        A TOML file that says which limbs and landmarks correspond; those whose names are alike unless given.
    contacts
        A csv of when points of the source's feet stand, as `kinemode contact` writes it; found unless given.
    method
        All frames in windows; or each from the one before alone, which is faster and shakes more.
    velocity
        Share of the URDF's velocity limits that may be used.
    clearance
        Metres that the parts of the body keep from each other.
    fps
        Frames per second of the source, where its file does not say them.
    up
        The axis of the source that points up, where its file does not say it.
    unit
        Of length of points, m, cm or mm, where the file does not say it.
    layout
        The order of joints that have no names: smpl, lafan1, kinect25, h36m17, ...; found by the limbs' lengths unless
        given.
    modes
        How many of a run's other hypotheses in each frame are carried through, so that the motion has a spread.
    seed
        Of the configurations that the first frame is searched from.
    metrics
        Write the figures that are printed to this csv, too.
    out
        The run file.
    overwrite
        Replace the run file if it is there.
    """
    import kinemode as km

    if source is None:
        if match is None:
            raise km.InputError(
                "retarget", "nothing to retarget", remedy="name a run or a file; --match SUBJECT begins"
            )
        km.match_start(match, out=out)
        print(out)
        return
    run = km.retarget(
        source, subject, match=match, contacts=contacts, method=method, velocity=velocity, clearance=clearance,
        fps=fps, up=up, unit=unit, layout=layout, modes=modes, seed=seed, out=out, overwrite=overwrite,
        progress=km.reported,
    )  # fmt: skip
    from kinemode.motion_figures import motion_figures, write_figures
    from kinemode.terminal import report

    figures = motion_figures(run)
    report.print_lines([f"{name}: {value}" for name, value in figures.rows()])
    if metrics is not None:
        print(write_figures(figures, metrics))
    print(run.file)
