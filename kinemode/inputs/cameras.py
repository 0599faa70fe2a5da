"""The cameras of tracks: those of a file or a program, found from a person (`--cameras auto`), or guessed; at the
sizes of images.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.formats.cameras import declared_floor, declared_up, load_cameras
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.timing import CameraClock
from estimator.vision.resolution import Size, declared_size, fitted_camera, fitted_track, resized_camera
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode.inputs.declared import sizes
from kinemode.inputs.lens import described, lens_of
from kinemode.named import named_pairs
from kinemode.request import AUTO, FileOptions

if TYPE_CHECKING:
    from estimator.data.rigs.calibrate import PersonCalibration
    from estimator.data.rigs.check import RigCheck
    from kinemode.request import Cameras


BY_PERSON = AUTO
"""In place of a camera file: the cameras are found from the person."""


def rig_by_person(
    body: Body,
    people: Mapping[str, PeopleFile],
    persons: Mapping[str, str],
    lenses: Mapping[str, Camera],
    clocks: Mapping[str, CameraClock],
    files: FileOptions,
) -> PersonCalibration:
    """The cameras, of pictures of the size that the detectors saw, and how much later each clock began.

    persons: the followed person in each camera. lenses: of the cameras, of that size. Clocks are found unless every
    camera but one has an offset.

    Raises InputError: as `estimator.data.rigs.calibrate.calibrate_by_person`; no keypoint files.
    """
    from estimator.data.rigs.calibrate import calibrate_by_person
    from estimator.fitting.fit import stature

    if not people:
        raise InputError("--cameras auto", "is found from keypoints", remedy="--detect, or --keypoints FILE for each")
    given = {name for name, _ in named_pairs(files.offset)}
    size = 1.0 if files.height is None else files.height / stature(body.subject)
    return calibrate_by_person(
        body,
        {name: file.one(persons[name]) for name, file in people.items()},
        lenses,
        {name: clocks[name].offset + clocks[name].keypoints for name in people},
        clocks_known=len(given & set(people)) >= len(people) - 1,
        size=size,
    )


def check_by_cameras(
    body: Body,
    people: Mapping[str, PeopleFile],
    persons: Mapping[str, str],
    cameras: Mapping[str, Camera],
    times: Mapping[str, np.ndarray],
) -> RigCheck:
    """Whether a person's motion agrees with given cameras, of pictures of the size that the detectors saw; times [s]:
    of the frames, on one clock.

    Raises InputError: as `estimator.data.rigs.check.check_by_person`.
    """
    from estimator.data.rigs.check import check_by_person
    from estimator.fitting.fit import stature

    check = check_by_person(body, {name: file.one(persons[name]) for name, file in people.items()}, cameras, times)
    tall = f"by these cameras the person is {check.size * stature(body.subject):.2f} m tall, to about 3 %"
    return replace(check, notes=(tall,))


def with_offsets(clocks: Mapping[str, CameraClock], rig: PersonCalibration) -> dict[str, CameraClock]:
    """The clocks with the offsets found."""
    return {
        name: replace(clock, offset=round(clock.offset + rig.offsets.get(name, 0.0), 4))
        for name, clock in clocks.items()
    }


def rig_notes(rig: PersonCalibration) -> list[str]:
    """Notes for the user."""
    first, *others = rig.cameras
    places = ", ".join(
        f"{name} to {rig.turn_stds[name]:.1f} degrees and {100.0 * rig.shift_stds[name]:.0f} cm" for name in others
    )
    notes = [f"cameras are found from the person, beside {first}: {places}; they fit by {_errors(rig)}"]
    if any(rig.offset_stds[name] > 0.0 for name in others):
        late = ", ".join(f"{name}={rig.offsets[name]:.3f}" for name in others)
        notes.append(f"clocks from the person, seconds after {first}: {late}; give another with --offset")
    return [*notes, *rig.notes]


def _errors(rig: PersonCalibration) -> str:
    errors = np.array(list(rig.errors.values()))
    return f"{errors.min():.1f} to {errors.max():.1f} px"


def camera_for(name: str, size: Size, given: Cameras, *, chosen: bool) -> tuple[Camera, tuple[str, ...]]:
    """The camera of pictures of a size, by name, and notes, as `load_inputs` has it for a single clip.

    chosen: the user wrote the name. Raises InputError as `load_inputs` does.
    """
    outline = {name: KeypointTrack("none", (), np.zeros((0, 0, 2)), np.zeros((0, 0)), size)}
    named = frozenset(outline) if chosen else frozenset()
    _, used, *notes = in_one_size(outline, {name: size}, KnownCameras.of(given), named, FileOptions())
    return used[name], tuple(chain(*notes))


class KnownCameras(NamedTuple):
    """The cameras that are given, by name, None for none; source: the file they are from, for errors. aspects: of the
    clips' pixels, by name, where they are known. up, floor: the file's axis that points up, and how high along
    it the floor is [m]; None where it has none. clips: by name, whose tags may have the lens. focal, phone: the
    user's. by_person: whether they are found from the person: then their lenses are given."""

    cameras: Mapping[str, Camera] | None
    source: str = "cameras"
    aspects: Mapping[str, float] = MappingProxyType({})
    up: str | None = None
    floor: float | None = None
    clips: Mapping[str, Path] = MappingProxyType({})
    focal: str | None = None
    phone: str | None = None
    by_person: bool = False

    @staticmethod
    def of(given: Cameras, lenses: Cameras = None) -> KnownCameras:
        """Those that are given; where cameras are found from a person, their lenses."""
        if given == BY_PERSON:  # in a world of their own, not that of the lenses' file
            return KnownCameras.read(lenses, "lenses")._replace(up=None, floor=None, by_person=True)
        return KnownCameras.read(given, "cameras")

    @staticmethod
    def read(given: Cameras, what: str) -> KnownCameras:
        """The cameras of a file, or by name; what: their label without a file."""
        if given is None or isinstance(given, Mapping):
            return KnownCameras(given, what)
        return KnownCameras(load_cameras(given), str(given), up=declared_up(given), floor=declared_floor(given))

    def placed(self, cameras: Mapping[str, Camera]) -> KnownCameras:
        """The cameras that were found from a person, in a world whose z points up."""
        return self._replace(cameras=cameras, source="the person", up="z", focal=None, phone=None, by_person=False)


def lens_note(source: str) -> str:
    """A note on where lenses are from."""
    return f"the lenses are those of {source}; where its cameras stand is not used"


def in_one_size(
    tracks: Mapping[str, KeypointTrack],
    pictures: Mapping[str, Size],
    known: KnownCameras,
    named: frozenset[str],
    files: FileOptions,
) -> tuple[dict[str, KeypointTrack], dict[str, Camera], list[str], list[str]]:
    """Tracks and cameras at the size of the clips, or of the cameras where there are none; notes on cameras, and on
    tracks."""
    seen = _detector_sizes(tracks, files)
    track_notes: list[str] = []
    cameras, notes = _cameras(tracks, {n: pictures.get(n) or seen[n] for n in tracks}, known, named)
    scaled = {}
    for name, track in tracks.items():
        picture = pictures.get(name) or cameras[name].image_size
        cameras[name], of_camera = fitted_camera(cameras[name], picture, known.source)
        scaled[name], of_track = fitted_track(name, track, seen[name], picture)
        notes += of_camera
        track_notes += of_track
    return scaled, cameras, notes, track_notes


def as_detected(
    tracks: Mapping[str, KeypointTrack], cameras: Mapping[str, Camera], files: FileOptions
) -> dict[str, Camera]:
    """The cameras of pictures of the size that the detectors saw."""
    seen = _detector_sizes(tracks, files)
    return {name: resized_camera(cameras[name], size or cameras[name].image_size) for name, size in seen.items()}


def _detector_sizes(tracks: Mapping[str, KeypointTrack], files: FileOptions) -> dict[str, Size | None]:
    """Size of the pictures that each detector saw, None where neither the file nor the user gives it."""
    given = sizes(files.keypoint_size, tracks)
    return {name: declared_size(track, given.get(name)) for name, track in tracks.items()}


def _cameras(
    tracks: Mapping[str, KeypointTrack], sizes: Mapping[str, Size | None], known: KnownCameras, named: frozenset[str]
) -> tuple[dict[str, Camera], list[str]]:
    """Camera of each track by the track's name; the one camera of a single clip is guessed where nothing is given."""
    if known.cameras is not None:
        if known.focal is not None or known.phone is not None:
            option = "--phone" if known.focal is None else "--focal"
            raise InputError(option, "is of a camera that no file describes", remedy="leave it out, or the cameras")
        # a camera that stands somewhere is for one clip, and a lens for all that were taken by one kind of camera
        serves = known.by_person or (len(tracks) == 1 and not named.intersection(tracks))
        chosen = {name: _choose(name, known, alone=serves and len(known.cameras) == 1) for name in tracks}
        served = ", ".join(repr(name) for name in tracks if name not in known.cameras)
        only = next(iter(known.cameras.values())).name
        note = f"the camera {only!r} of {known.source} is used for {served}, as the only one"
        return chosen, [note] if served else []
    if len(tracks) > 1 and not known.by_person:
        problem = f"several views ({', '.join(tracks)}) need their placements"
        remedy = "give a camera file (`kinemode calibrate` makes one), or --cameras auto to find them from the person"
        raise InputError("cameras", problem, remedy=remedy)
    guesses = [_guessed(track, name, sizes[name], known) for name, track in tracks.items()]
    return {guess.name: guess for guess, _ in guesses}, [note for _, note in guesses]


def _guessed(track: KeypointTrack, name: str, size: Size | None, known: KnownCameras) -> tuple[Camera, str]:
    """A camera that no file describes, and a note on its lens."""
    if size is None:
        remedy = "give the clip, a camera file or --keypoint-size WxH"
        raise InputError(track.source, "does not have the size of the image", remedy=remedy)
    aspect = known.aspects.get(name, 1.0)
    lens = lens_of(known.focal, known.clips.get(name), max(aspect * size[0], size[1]), known.phone)
    guess = guessed_camera(name, size, aspect, lens.focal, lens.std)
    wide, high = (f"{guess.K[k, k]:.0f}" for k in range(2))
    pixels = f"{wide} px" if wide == high else f"{wide} by {high} px (its pixels are not square)"
    return guess, described(lens, pixels, name)


def _choose(name: str, known: KnownCameras, *, alone: bool) -> Camera:
    cameras = known.cameras or {}
    if name in cameras:
        return cameras[name]
    if alone:
        camera = next(iter(cameras.values()))
        return replace(camera, name=name) if known.by_person else camera
    remedy = f"cameras: {', '.join(cameras)}; choose with NAME=PATH"
    raise InputError(known.source, f"there is no camera {name!r}", remedy=remedy)
