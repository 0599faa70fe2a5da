"""`retarget`: a person's motion on a robot, or on any other body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode.inputs.files import check_exists
from kinemode.inputs.named import PathLike
from kinemode.public.arguments import check_arguments, check_as, choice, whole
from kinemode.public.tracking import noted_subject
from kinemode.target import check_new
from kinemode.terminal.progress import Reporter, unreported

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from estimator.retargeting.source import SourceMotion
    from estimator.retargeting.streaming import LiveFrame
    from estimator.runs.run_file import Run
    from kinemode.public.tracking import SubjectLike

METHODS = _, FRAMES = ("windows", "frames")
"""All frames in windows, after they were followed; or followed alone, each from the one before."""


def retarget(
    source: Run | SourceMotion | PathLike,
    subject: SubjectLike,
    *,
    match: PathLike | None = None,
    contacts: PathLike | None = None,
    method: str = "windows",
    velocity: float = 1.0,
    clearance: float = 0.002,
    fps: float | None = None,
    up: str | None = None,
    unit: str | None = None,
    layout: str | None = None,
    modes: int = 0,
    seed: int = 0,
    out: PathLike | None = None,
    overwrite: bool = False,
    progress: Reporter | None = None,
) -> Run:
    """Make a motion another body's: within its limits, its parts apart, its feet on the ground.

    Limbs keep the source's directions, the hips its path, scaled by the length of the legs. Joints stay within their
    limits and, from frame to frame, their velocities; parts that the URDF gives collision shapes, or flesh, stay
    apart; a foot that stands in the source has one place for as long as it does, and nothing is below the floor, which
    becomes z = 0. What of this cannot be had in a frame makes it "hard".

    Parameters
    ----------
    source: a run, landmarks that a program has (`SourceMotion`), or a file: a run, BVH, points with landmarks' names
        (TRC, C3D, npz, csv), or an npz of joints in the order of SMPL or of another program.
    subject: a loaded subject, a built-in name, or the path of a URDF; example-robot-data:g1 and :talos have landmarks.
    match: a TOML file that says which limbs and landmarks correspond; those whose names are alike unless given.
        `match_start` begins one.
    contacts: a csv of when points of the source's feet stand, as `kinemode.contact` writes one; told from how fast and
        how high they are unless given.
    method: "windows", or "frames" for each frame from the one before alone, which is some four times as fast
        and shakes more.
    velocity: share of the URDF's velocity limits that may be used. clearance [m]: that parts keep from each other.
    fps, up, unit: frame rate, axis that points up and unit of length of a file that does not say them. layout: the
        order of joints that have no names, such as "smpl", "lafan1" or "kinect25"; found by the limbs' lengths unless
        given.
    modes: how many of a run's other hypotheses in each frame are carried through, the heaviest; each is searched from
        the motion, frame by frame.
    seed: of the random ones among the configurations that the first frame is searched from; equal seeds give
        motions that are equal to some 1e-4 rad, as the solver's last digits depend on the memory.
    out: the run file. Without it a temporary one, which is gone when no `Run` of it is left. overwrite: replace it.
    progress: a reporter such as `kinemode.reported`.

    Returns
    -------
    The run: drawn, exported and shown as a tracked one. Its `extra` arrays have the source's landmarks.

    Raises
    ------
    InputError: a file that cannot be read, or says too little; nothing that corresponds; an argument that cannot be.
    """
    check_as("motion to follow", source=source)
    check_arguments(subject=subject, seed=seed, out=out, overwrite=overwrite, progress=progress)
    check_as("time", velocity=velocity, clearance=clearance)
    check_as("one file", match=match, contacts=contacts)
    check_as("unit of length", unit=unit, up=up, layout=layout)
    choice("format", method, METHODS)
    if fps is not None:
        check_as("time", fps=fps)
    for path in (match, contacts, source):
        if isinstance(path, (str, Path)):
            check_exists(path)
    from estimator.retargeting.problem import RetargetSettings
    from kinemode.retargeting import MotionWanted, retarget_to

    settings = RetargetSettings(velocity=float(velocity), clearance=float(clearance))
    if method == FRAMES:
        settings = settings.frame_by_frame
    wanted = MotionWanted(
        fps,
        up,
        unit,
        match,
        contacts,
        settings,
        whole("modes", modes, 0),
        whole("seed", seed, 0),
        out,
        overwrite,
        layout,
    )
    return retarget_to(noted_subject(subject), source, wanted, progress or unreported)


def match_start(subject: SubjectLike, *, out: PathLike | None = None) -> str:
    """The text of a correspondence to begin with, to be looked through and completed.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF, with landmarks.
    out: a file to write it to.

    Raises
    ------
    InputError: no such subject; a file that is there already or cannot be written.
    """
    check_arguments(subject=subject, out=out)
    from kinemode.retargeting import begun_match

    if out is not None:
        check_new(Path(out))
    return begun_match(noted_subject(subject), out)


class Retargeter:
    """Makes a motion another body's while it comes in, a short while behind.

    >>> live = km.Retargeter("example-robot-data:g1", names)
    >>> for time, points in capture:  # points (L, 3) [m], z up
    ...     frame = live.step(points, time=time)
    ...     if frame is not None:
    ...         robot.send(frame.q)
    >>> for frame in live.rest():
    ...     robot.send(frame.q)

    Each frame is followed from the one before, as `retarget` does by the method "frames": limits, velocities, parts and
    floor are kept to alike. Contacts are told from the frames of the last 0.4 s and of those that have come since; a
    foot that stands is held where the body has it.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF. names: of the landmarks (L) that come, as
        subjects have them (left_hip, left_big_toe, ...).
    match: a TOML file that says which limbs and landmarks correspond; those whose names are alike unless given.
    look_ahead: seconds that each frame is given out after it came.
    floor: its height [m]; what the first frames stand on unless given.
    velocity, clearance, seed: as `retarget` has them.

    Raises
    ------
    InputError: nothing that corresponds; an argument that cannot be.
    """

    def __init__(
        self,
        subject: SubjectLike,
        names: Sequence[str],
        *,
        match: PathLike | None = None,
        look_ahead: float = 0.2,
        floor: float | None = None,
        velocity: float = 1.0,
        clearance: float = 0.002,
        seed: int = 0,
    ) -> None:
        check_arguments(subject=subject, seed=seed)
        check_as("time", look_ahead=look_ahead, velocity=velocity, clearance=clearance)
        check_as("one file", match=match)
        if floor is not None:
            check_as("time", floor=floor)
        if look_ahead < 0.0:
            raise InputError("look_ahead", f"is {look_ahead:g}", remedy="0 seconds or more")
        from estimator.retargeting.correspondence import check_correspondence, common_correspondence
        from estimator.retargeting.match_file import load_match
        from estimator.retargeting.problem import RetargetSettings
        from estimator.retargeting.streaming import MotionStream
        from humanoid.kinematics.body import Body

        self.subject = noted_subject(subject)
        body, own = Body(self.subject), tuple(str(name) for name in names)
        chosen = common_correspondence(body.landmark_names, own) if match is None else load_match(match)
        check_correspondence(chosen, body.landmark_names, own)
        settings = RetargetSettings(velocity=float(velocity), clearance=float(clearance))
        self._names, self._time = own, float("-inf")
        self._stream = MotionStream(
            body, own, chosen, settings, look_ahead=float(look_ahead), floor=floor, seed=whole("seed", seed, 0)
        )

    def step(self, points: np.ndarray, *, time: float) -> LiveFrame | None:
        """Take the landmarks (L, 3) [m] of a time [s], NaN where missing; the frame that is due now, None before the
        first.

        Raises InputError for other shapes, for infinite numbers, and for a time that is not after the one before.
        """
        import numpy as np

        check_as("time", time=time)
        given = np.array(points, dtype=float)
        if given.shape != (len(self._names), 3) or np.isinf(given).any():
            problem = "has infinite numbers" if np.isinf(given).any() else f"has the shape {given.shape}"
            raise InputError("points", problem, remedy=f"({len(self._names)}, 3) metres, NaN where missing")
        if not float(time) > self._time:
            raise InputError("time", f"{time:g} s does not come after {self._time:g} s", remedy="frames in order")
        self._time = float(time)
        return self._stream.step(self._time, given)

    def rest(self) -> list[LiveFrame]:
        """The frames that are left when nothing more comes."""
        return self._stream.rest()
