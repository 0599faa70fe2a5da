"""The commands that prepare a track: a body that fits the person, settings, and what there is to choose from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from kinemode.flags import Flag, flags_of
from kinemode.making_requests import BoardRequest, IndexRequest, TemplatesRequest
from kinemode.option import again, options_of
from kinemode.request import USUAL_SUBJECT, CheckRequest, FitRequest, RigRequest, SyncOptions

if TYPE_CHECKING:
    from kinemode.making_requests import BoardSize


@flags_of(FitRequest, needed=("out",), subject=USUAL_SUBJECT)
def fit(**given: Any) -> None:
    """Fit a subject's proportions, and with images its flesh, to the first frames of a clip; write it as a URDF.

    With --points lengths and the places of the markers are fitted, which the URDF has for other trials.

    For example:

    kinemode fit cam01.mp4 --cameras calibration.json --keypoints cam01.json --out me.urdf

    kinemode fit walk.mp4 --keypoints clicks.json --background empty.png --out me.urdf

    kinemode fit walk.mp4 --detect --out me.urdf

    kinemode fit --points static.trc --out me.urdf
    """
    import kinemode as km

    fitted = km.fit(**given, progress=km.reported)
    from kinemode.terminal import report

    report.print_fit(fitted, given["out"])


@dataclass(frozen=True, kw_only=True)
class _Calibration(SyncOptions, RigRequest):
    """Options of cameras that are found by a board or from a person, or checked by one."""

    board: Literal["chessboard", "charuco"] = again(BoardRequest, "board")
    size: BoardSize = again(BoardRequest, "size")
    square: float | None = again(BoardRequest, "square", default=None)
    marker: float | None = again(BoardRequest, "marker")
    dictionary: str = again(BoardRequest, "dictionary")
    lens: Literal["brown", "rational", "fisheye"] = again(BoardRequest, "lens")
    origin: int | None = again(BoardRequest, "origin")


@flags_of(
    _Calibration,
    clips=("pictures", "[NAME=]PATH: a video or a folder of each camera; or picture files, all of one camera."),
)
def calibrate(*, from_person: Flag = False, check: Path | None = None, **given: Any) -> None:
    """Calibrate cameras from pictures of a board: their lenses, and of several that see it at once where they stand.
    Or find several cameras from a moving person, without a board; or check a calibration with a person.

    For example:

    kinemode calibrate board.mp4 --size 9x6 --square 0.025 --out cameras.json

    kinemode calibrate left=left/ right=right/ --square 0.04 --origin 0 --out cameras.json --picture board.png

    kinemode calibrate a=a.mp4 b=b.mp4 --board charuco --size 8x6 --square 0.03 --marker 0.022 --out cameras.json

    kinemode calibrate a.mp4 b.mp4 --from-person --detect --height 1.78 --out cameras.json

    kinemode calibrate a.mp4 b.mp4 --check cameras.json --detect

    Parameters
    ----------
    from_person
        Find the cameras from a person visible in all; the arguments are the cameras' clips. Places, clocks, focal
        lengths and their uncertainty, in a world with z up and the floor about 0. The cameras stand still.
    check
        A camera file to check with a person visible in all: whether rays meet, and which camera stands otherwise. The
        arguments are the cameras' clips.
    """
    import kinemode as km

    pictures, out, picture = given.pop("clips"), given.pop("out"), given.pop("picture")
    board = {name: given.pop(name) for name in options_of(BoardRequest) if name in given}
    by_person = {name: value for name, value in given.items() if value != options_of(_Calibration)[name].default}
    if check is not None:
        for name, value in (("--out", out), ("--picture", picture), ("--from-person", from_person)):
            if value:
                raise km.InputError(name, "is for a calibration that is made", remedy="leave it out with --check")
        _refuse_others(by_person, CheckRequest, "is for cameras that are found")
        checked = km.check_cameras(check, pictures, **by_person, progress=km.reported)
        from kinemode.terminal import report

        report.print_check(checked, check)
        return
    if out is None:
        raise km.InputError("--out", "is needed: the camera file to write", remedy="or --check FILE")
    if from_person:
        _refuse_others(by_person, RigRequest, "is for --check: clocks are found, or given with --offset")
        rig = km.calibrate_from_person(pictures, **by_person, out=out, picture=picture, progress=km.reported)
        from kinemode.terminal import report

        report.print_rig(rig, out, picture)
        return
    if by_person:
        flags = ", ".join(f"--{options_of(_Calibration)[name].flag}" for name in by_person)
        raise km.InputError(flags, "are for --from-person and --check", remedy="add one of them")
    if board["square"] is None:
        raise km.InputError("--square", "is needed: the side of a square in metres", remedy="or --from-person")
    calibration = km.calibrate(pictures, **board, out=out, picture=picture, progress=km.reported)
    from kinemode.terminal import report

    report.print_calibration(calibration, out, picture)


def _refuse_others(given: Mapping[str, Any], request: type, problem: str) -> None:
    """Raise InputError for an option that is not one of a request."""
    import kinemode as km

    for name in given:
        if name not in options_of(request):
            raise km.InputError(f"--{options_of(_Calibration)[name].flag}", problem, remedy="leave it out")


@flags_of(IndexRequest, arguments=("subject",))
def train_index(**given: Any) -> None:
    """Paint examples of a subject's poses into an index, for `track --tracker elmo --index FILE`.

    The same command resumes after an interruption.

    Example: kinemode train-index human34 --legs --workers 2 --out human34-legs.npz
    """
    import kinemode as km

    print(km.train_index(**given, progress=km.reported))


@flags_of(TemplatesRequest, arguments=("cameras",))
def train_templates(**given: Any) -> None:
    """Paint a subject as a rig's cameras see it, into templates that its limbs are detected by, without keypoints.

    Example: kinemode train-templates cameras.json --subject me.urdf --out rig.npz
    """
    import kinemode as km

    print(km.train_templates(**given, progress=km.reported))


def settings(*, tracker: str = "css", out: Path | None = None) -> None:
    """Print all settings of a tracker as a TOML file, each with its meaning, to be edited and passed to `track`.

    Example: kinemode settings --out slow.toml

    Parameters
    ----------
    tracker
        Its name, see `kinemode trackers`.
    out
        Write the file here.
    """
    from kinemode.settings import describe_settings, write_settings

    if out is None:
        print(describe_settings(tracker), end="")
    else:
        print(write_settings(out, tracker))


def subjects(
    *,
    landmarks: str | None = None,
    markers: Path | None = None,
    set_: Annotated[str | None, Parameter(name="--set")] = None,
    out: Path | None = None,
) -> None:
    """List the built-in subjects, or write a landmark template for a URDF, or a marker set template for a laboratory.

    Any other URDF is loaded by its path; its landmarks are in NAME.landmarks.toml next to NAME.urdf. The file that is
    written loads unchanged: a landmark at every joint, under COCO's names where the links' names identify a person's
    joints, the tips of the last links, and everything else as comments.

    For example:

    kinemode subjects

    kinemode subjects --landmarks robot.urdf --out robot.landmarks.toml

    kinemode subjects --markers walk.trc --out markers.toml

    Parameters
    ----------
    landmarks
        A URDF, by path or by name: print the beginning of its landmark file.
    markers
        A file of points (.trc, .c3d, .npz, .npy, .csv): print the beginning of a set of markers with its names. Those
        known to a built-in set have their places, the others are comments to be completed.
    set_
        The set whose places go before those of the others: a built-in one, or a file.
    out
        Write it here instead; a file that is there is left alone.
    """
    if landmarks is not None or markers is not None:
        import kinemode as km

        if landmarks is not None and markers is not None:
            raise km.InputError("--markers", "writes another file than --landmarks", remedy="give one of them")
        begun = km.landmark_start(landmarks, out=out) if landmarks is not None else None
        text = begun if begun is not None else km.marker_start(markers or "", begin=set_, out=out)
        print(out if out is not None else text, end="\n" if out is not None else "")
        return
    from kinemode.terminal import report

    report.print_subjects()


def cues() -> None:
    """List the image cues, see `track --cues`."""
    from kinemode.terminal import report

    report.print_cues()


def trackers() -> None:
    """List the trackers that `track` and `compare` can use."""
    from kinemode.terminal import report

    report.print_trackers()
