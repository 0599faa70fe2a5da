"""`retarget`: a person's motion on a robot, or on any other body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode import kinds
from kinemode.checks import check_exists, check_together
from kinemode.named import PathLike
from kinemode.option import options_of, takes
from kinemode.public.tracking import noted_subject
from kinemode.request import RetargetRequest
from kinemode.target import check_new

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from estimator.retargeting.streaming import LiveFrame
    from estimator.runs.run_reader import Run
    from kinemode.request import SubjectLike


@takes(RetargetRequest)
def retarget(request: RetargetRequest) -> Run:
    """Make a motion another body's: within its limits, its parts apart, its feet on the ground.

    Limbs keep the source's directions, the hips its path, scaled by the length of the legs. Joints stay within their
    limits and, from frame to frame, their velocities; parts that the URDF gives collision shapes, or flesh, stay
    apart; a foot that stands in the source has one place for as long as it does, and nothing is below the floor, which
    becomes z = 0. What of this cannot be had in a frame makes it "hard". example-robot-data:g1 and :talos have
    landmarks.

    Parameters
    ----------
    OPTIONS

    Returns
    -------
    The run: drawn, exported and shown as a tracked one. Its `extra` arrays have the source's landmarks.

    Raises
    ------
    InputError: a file that cannot be read, or has too little; nothing that corresponds; an invalid argument.
    """
    check_together(request)
    if isinstance(request.source, (str, Path)):
        check_exists(request.source)
    from kinemode.retargeting import retarget_to

    return retarget_to(noted_subject(request.subject), request)


def match_start(subject: SubjectLike, *, out: PathLike | None = None) -> str:
    """The template of a correspondence, to be checked and completed.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF, with landmarks.
    out: a file to write it to.

    Raises
    ------
    InputError: no such subject; a file that is there already or cannot be written.
    """
    kinds.check(subject=(subject, kinds.SUBJECT), out=(out, kinds.NEW_FILE))
    from kinemode.retargeting import write_match_template

    if out is not None:
        check_new(Path(out))
    return write_match_template(noted_subject(subject), out)


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
    floor are respected as well. Contacts are found from the frames of the last 0.4 s and of those that have come since;
    a foot that stands is held where the body has it.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF. names: of the landmarks (L) that come, as
        subjects have them (left_hip, left_big_toe, ...).
    match: a TOML file of which limbs and landmarks correspond; by default those with matching names.
    look_ahead: seconds that each frame is given out after it came.
    floor: its height [m]; that on which the first frames stand unless given.
    velocity, clearance, seed: as `retarget` has them.

    Raises
    ------
    InputError: nothing that corresponds; an invalid argument.
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
        kinds.check(look_ahead=(look_ahead, kinds.NUMBER), floor=(floor, kinds.MAYBE_NUMBER))
        given = {"subject": subject, "match": match, "velocity": velocity, "clearance": clearance, "seed": seed}
        for name, value in given.items():
            options_of(RetargetRequest)[name].check(value)
        if look_ahead < 0.0:
            raise InputError("look_ahead", f"is {look_ahead:g}", remedy="0 seconds or more")
        from estimator.retargeting.correspondence import check_correspondence, common_correspondence, load_match
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
            body, own, chosen, settings, look_ahead=float(look_ahead), floor=floor, seed=int(seed)
        )

    def step(self, points: np.ndarray, *, time: float) -> LiveFrame | None:
        """Take the landmarks (L, 3) [m] of a time [s], NaN where missing; the frame that is due now, None before the
        first.

        Raises InputError for other shapes, for infinite numbers, and for a time that is not after the one before.
        """
        import numpy as np

        kinds.check(time=(time, kinds.NUMBER))
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
