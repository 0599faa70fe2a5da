"""`calibrate_from_person` and `check_cameras`: cameras and a person who moves before them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.data.floor import OFF
from humanoid.support.errors import InputError
from kinemode.inputs.arrays import Spool
from kinemode.inputs.declared import AUTO, SYNC_CHOICES, Declared, Offsets, Rates, Sizes
from kinemode.inputs.files import InputFiles
from kinemode.inputs.named import PathLike
from kinemode.public.arguments import check_arguments, check_as, choice
from kinemode.public.cameras import check_png
from kinemode.public.detection import with_detected
from kinemode.public.tracking import noted_subject
from kinemode.target import check_folder
from kinemode.terminal.progress import Reporter

if TYPE_CHECKING:
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck
    from kinemode.inputs.arrays import Clips, Keypoints
    from kinemode.inputs.files import Cameras
    from kinemode.inputs.persons import Persons
    from kinemode.public.detection import Detect
    from kinemode.public.tracking import SubjectLike


def calibrate_from_person(
    clips: Clips = None,
    *,
    keypoints: Keypoints = None,
    detect: Detect = False,
    height: float | None = None,
    focal: str | None = None,
    phone: str | None = None,
    lenses: Cameras = None,
    offset: Offsets = None,
    layout: str | Sequence[str] = "auto",
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    fps: Rates = None,
    subject: SubjectLike = "human34",
    out: PathLike | None = None,
    picture: PathLike | None = None,
    progress: Reporter | None = None,
) -> PersonCalibration:
    """Find two or more cameras from a person who moves before them: where they stand, when they began, how long their
    lenses are.

    The cameras stand still. Their joints are found in each; what places the cameras is that the rays to a joint meet,
    and that the person's limbs keep their lengths. Twenty seconds of somebody who walks to and fro, turns and lifts the
    arms place them to about a degree.

    Parameters
    ----------
    clips, keypoints, detect, layout, person, keypoint_size, fps: as of `kinemode.track`.
    height: of the person [m], which makes the metres right; without it an average person is taken.
    focal, phone: of the lenses, see `kinemode.track`; without them they are found from the person as well, around those
        of most phones. lenses: in their place a camera file, or cameras by name, see `kinemode.track`.
    offset: when each camera began, by name [s]. Clocks are found as well unless all but one are said.
    subject: whose landmarks and lengths the person has.
    out: camera file to write; its world has z up and the floor about 0.
    picture: PNG to write: the cameras from above and from the side, with the person, and how far keypoints are from
        where the points of all cameras are seen.
    progress: of the detection, see `kinemode.reported`; none by default.

    Returns the cameras, clocks, deviations, and notes (`estimator.data.rigs.calibrate.PersonCalibration`).

    Raises
    ------
    InputError: as `kinemode.track`; fewer than two cameras; too little that two cameras see at once; motion that does
    not tell where they stand, or when they began.
    """
    check_arguments(
        subject=subject, clips=clips, keypoints=keypoints, layout=layout, person=person, out=out, detect=detect,
        height=height, focal=focal, phone=phone, lenses=lenses, progress=progress,
    )  # fmt: skip
    check_as("out", picture=picture)
    spool = Spool(clips, keypoints, layout)
    told = Declared(
        keypoint_size, fps, offset, layout=spool.file_layout, focal=focal, phone=phone, height=height
    )  # fmt: skip
    told.check_lens()
    files = InputFiles(spool.clips, spool.keypoints, AUTO, person=person, declared=told, lenses=lenses).checked()
    if out is not None:
        check_folder(Path(out))
    if picture is not None:
        check_png(Path(picture))
    loaded = noted_subject(subject)
    from kinemode.calibrating import calibrated_by_person

    with spool.telling(), with_detected(files, detect, out, progress) as seen:
        return calibrated_by_person(loaded, seen, *(None if f is None else Path(f) for f in (out, picture)))


def check_cameras(
    cameras: Cameras,
    clips: Clips = None,
    *,
    keypoints: Keypoints = None,
    detect: Detect = False,
    offset: Offsets = None,
    sync: str = OFF,
    layout: str | Sequence[str] = "auto",
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    fps: Rates = None,
    subject: SubjectLike = "human34",
    progress: Reporter | None = None,
) -> RigCheck:
    """Check two or more calibrated cameras by a person who moves before them: whether any was moved since.

    Rays of right cameras meet about as well as those of cameras that `calibrate_from_person` places; where they meet
    much worse, the camera is named that, placed anew alone, lets them meet. Of two cameras both are named. A degree
    shows in seconds of film, for it needs no more than that rays meet.

    Parameters
    ----------
    cameras: a camera file, or cameras by name.
    clips, keypoints, detect, offset, sync, layout, person, keypoint_size, fps: as of `kinemode.track`. Clocks that are
        wrong look as cameras that are.
    subject: whose landmarks the person has; how tall the person is the cameras tell.
    progress: of the detection, see `kinemode.reported`; none by default.

    Returns for each camera how far keypoints are off, and by how much the person places it otherwise; which camera
    disagrees; notes (`estimator.data.rigs.check.RigCheck`).

    Raises
    ------
    InputError: as `kinemode.track`; fewer than two cameras; too little that two cameras see at once.
    """
    check_arguments(
        subject=subject, clips=clips, cameras=cameras, keypoints=keypoints, layout=layout, person=person, detect=detect,
        progress=progress,
    )  # fmt: skip
    if cameras is None or cameras == AUTO:
        raise InputError("cameras", "to be checked are needed", remedy="a camera file, or cameras by name")
    choice("sync", sync, SYNC_CHOICES)
    spool = Spool(clips, keypoints, layout)
    told = Declared(keypoint_size, fps, offset, sync=sync, layout=spool.file_layout)
    files = InputFiles(spool.clips, spool.keypoints, cameras, person=person, declared=told).checked()
    loaded = noted_subject(subject)
    from humanoid.kinematics.body import Body
    from kinemode.inputs.load import checked_cameras

    with spool.telling(), with_detected(files, detect, None, progress) as seen:
        return checked_cameras(Body(loaded), seen)
