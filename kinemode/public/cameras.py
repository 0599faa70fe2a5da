"""`calibrate`: cameras from pictures of a board. `calibrate_from_person` and `check_cameras`: from a person who
moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode.making_requests import BoardRequest
from kinemode.named import Named, chosen_names, kept, named_paths
from kinemode.option import takes
from kinemode.public.tracking import noted_subject, reading
from kinemode.request import AUTO, CheckRequest, RigRequest
from kinemode.target import check_folder

if TYPE_CHECKING:
    from estimator.data.boards.calibrate import BoardCalibration
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck


PICTURES = "pictures of a board"
_IMAGES = (".jpg", ".jpeg", ".png", ".bmp")


@takes(BoardRequest)
def calibrate(request: BoardRequest) -> BoardCalibration:
    """Calibrate cameras from pictures of a board: their lenses, and of several where they stand.

    Picture number i of every camera has to be of the same instant where there are several cameras. Up to 120 pictures
    of each, evenly spaced, are used.

    Parameters
    ----------
    OPTIONS

    Returns the cameras, the errors of every view, and notes (`estimator.data.boards.calibrate.BoardCalibration`).

    Raises
    ------
    InputError: no board or another one, too few or too similar views, cameras that share none, files that are missing
        or cannot be written.
    """
    sources = _sources(kept(request.pictures))
    out, picture = (None if file is None else Path(file) for file in (request.out, request.picture))
    if out is not None:
        check_folder(out)
    if picture is not None:
        check_png(picture)
    board = {
        "kind": request.board, "size": _columns_and_rows(request.size), "square": float(request.square),
        "marker": request.marker, "dictionary": request.dictionary,
    }  # fmt: skip
    from kinemode.calibrating import calibrated

    return calibrated(
        sources, board, lens=request.lens, origin=request.origin, out=out, picture=picture, progress=request.reporter
    )


def check_png(picture: Path) -> None:
    """Raise InputError unless a picture of a calibration can be written there."""
    check_folder(picture)
    if picture.suffix.lower() != ".png":
        raise InputError(picture, "is not a .png file", remedy="as cameras.png")


def _sources(pictures: Named) -> dict[str, list[Path]]:
    """Files of each camera by its name."""
    several: Iterable[Named] = [pictures] if isinstance(pictures, (str, Path, Mapping)) else list(pictures or [])
    sources: dict[str, list[Path]] = {}
    for given in several:
        chosen = chosen_names(given, PICTURES)
        for name, path in named_paths(given, PICTURES).items():
            single = name not in chosen and path.is_file() and path.suffix.lower() in _IMAGES
            sources.setdefault(path.absolute().parent.name if single else name, []).append(path)
    if not sources:
        raise InputError(
            "pictures", "are needed", remedy="a video, a folder or picture files of a board; NAME=PATH each"
        )
    return sources


def _columns_and_rows(size: str | tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of a text like 9x6 or of a pair."""
    try:
        columns, rows = (int(n) for n in (size.lower().split("x") if isinstance(size, str) else size))
    except (ValueError, TypeError):
        raise InputError("size", f"{str(size)[:40]!r} cannot be used", remedy="columns by rows, as 9x6") from None
    return columns, rows


@takes(RigRequest)
def calibrate_from_person(request: RigRequest) -> PersonCalibration:
    """Find two or more cameras from a moving person: where they stand, when they started, how long their
    lenses are.

    The cameras stand still. Their joints are found in each; what places the cameras is that the rays to a joint meet,
    and that the person's limbs keep their lengths. Twenty seconds of a person who walks to and fro, turns and lifts the
    arms place them to about a degree. The height makes the metres right; without it an average person is assumed.
    Without a focal length, a phone or lenses these are found from the person as well, around those of most phones.
    Clocks are found as well unless all cameras but one have an offset.

    Returns the cameras, clocks, deviations, and notes (`estimator.data.rigs.calibrate.PersonCalibration`).

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: as `kinemode.track`; fewer than two cameras; too little that two cameras see at once; motion that does
    not show where they stand, or when they started.
    """
    out, picture = (None if file is None else Path(file) for file in (request.out, request.picture))
    if out is not None:
        check_folder(out)
    if picture is not None:
        check_png(picture)
    with reading(request, out, cameras=AUTO) as (files, _):
        loaded = noted_subject(request.subject)
        from kinemode.calibrating import calibrated_by_person

        return calibrated_by_person(loaded, files, out, picture)


@takes(CheckRequest)
def check_cameras(request: CheckRequest) -> RigCheck:
    """Check two or more calibrated cameras with a moving person: whether any was moved since.

    Rays of right cameras meet about as well as those of cameras that `calibrate_from_person` places; where they meet
    much worse, the camera is named that lets them meet when it alone is placed again. Of two cameras both are named. A
    degree shows in seconds of film, since it is enough that rays meet. Wrong clocks look like wrong cameras.

    Returns for each camera how far keypoints are off, and by how much the person places it otherwise; which camera
    disagrees; notes (`estimator.data.rigs.check.RigCheck`).

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: as `kinemode.track`; fewer than two cameras; too little that two cameras see at once.
    """
    if request.cameras is None or request.cameras == AUTO:
        raise InputError("cameras", "to be checked are needed", remedy="a camera file, or cameras by name")
    with reading(request, None) as (files, _):
        loaded = noted_subject(request.subject)
        from humanoid.kinematics.body import Body
        from kinemode.inputs.load import checked_cameras

        return checked_cameras(Body(loaded), files)
