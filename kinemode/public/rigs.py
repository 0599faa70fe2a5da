"""`calibrate_from_person` and `check_cameras`: cameras and a person who moves before them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode.option import takes
from kinemode.public.cameras import check_png
from kinemode.public.tracking import noted_subject, reading
from kinemode.request import AUTO, CheckRequest, RigRequest
from kinemode.target import check_folder

if TYPE_CHECKING:
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck


@takes(RigRequest)
def calibrate_from_person(request: RigRequest) -> PersonCalibration:
    """Find two or more cameras from a person who moves before them: where they stand, when they began, how long their
    lenses are.

    The cameras stand still. Their joints are found in each; what places the cameras is that the rays to a joint meet,
    and that the person's limbs keep their lengths. Twenty seconds of somebody who walks to and fro, turns and lifts the
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
    not show where they stand, or when they began.
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
    """Check two or more calibrated cameras by a person who moves before them: whether any was moved since.

    Rays of right cameras meet about as well as those of cameras that `calibrate_from_person` places; where they meet
    much worse, the camera is named that, placed anew alone, lets them meet. Of two cameras both are named. A degree
    shows in seconds of film, since it is enough that rays meet. Wrong clocks look like wrong cameras.

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
