"""The focal length of a camera without a calibration: as the user, the file or the phone's model has it, else that of
most phones."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera, camera_before
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.film import ffmpeg_command
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import landmark_features
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, shown
from kinemode.inputs.phones import checked_phone, phone

PHONES = 0.74
"""Focal length over the longer side: the median of calibrations of phones and tablets, two from 0.67 to 0.91 (the
lenses that OpenCap's calibrations list; Uhlrich et al. 2023). Web cameras of 60 to 78 degrees have 0.7 to 0.9."""
PHONES_STD = 0.09
"""Standard deviation of its logarithm over these."""
_MODEL_STD = 0.03  # between calibrations of one kind of lens
_FILM_STD = 0.06  # a stated length on film is rounded, and is the photograph's: video is cropped
_SENSOR = 1.2  # diagonal over longer side: between the sensor's 4:3 (1.25) and the film's 16:9 (1.15), which crops it
_WRITTEN = re.compile(r"\s*([0-9]*\.?[0-9]+)\s*(mm|px)?\s*")
_TABLE = "OpenCap's calibration of video that is neither zoomed nor stabilised"
_SHARES, _PIXELS = (0.2, 20.0), (10.0, 1e6)
_FEWEST = 3
FILM_DIAGONAL = 43.27  # mm, of 24 x 36
_EQUIVALENT = "focal_length.35mm_equivalent"  # how the tag ends that phones write into films (QuickTime metadata)
_MODEL = "quicktime.model"
_RANGE = (5.0, 2000.0)  # mm


class Lens(NamedTuple):
    """focal: length over the picture's longer side. std: relative standard deviation of it. source: where it is from,
    for a note; empty where it is a guess."""

    focal: float
    std: float
    source: str = ""


def lens_of(said: str | None, path: Path | None, longer_side: float, model: str | None = None) -> Lens:
    """The lens of a clip: the user's, else its tags', else the lens of the phone that its tags name.

    said: given by the user, as "26mm" (on 35 mm film), "1400px" or "0.72" (of the longer side). path: of the clip.
    longer_side: of the picture [px]. model: of the phone, by the user, see `kinemode.inputs.phones.phone` for what its
    focal length is of.

    Raises InputError: it is none of these; the phone is unknown.
    """
    if model is not None:
        chosen = checked_phone(model)
        return Lens(chosen.focal, _MODEL_STD, f"--phone ({chosen.name}: {_TABLE})")
    if said is not None:
        return Lens(*_written(said, longer_side), "--focal")
    tags = LensTags() if path is None else lens_tags(path)
    if tags.equivalent is not None:
        return Lens(_of_film(tags.equivalent), _FILM_STD, f"the file ({tags.equivalent:g} mm on 35 mm film)")
    known = None if tags.model is None else phone(tags.model)
    if known is not None:
        return Lens(known.focal, _MODEL_STD, f"the phone that the file names ({known.name}: {_TABLE})")
    return Lens(PHONES, PHONES_STD)


def _of_film(millimetres: float) -> float:
    return millimetres / FILM_DIAGONAL * _SENSOR


def _written(said: str, longer_side: float) -> tuple[float, float]:
    """Focal length over the longer side, and its relative standard deviation."""
    match = _WRITTEN.fullmatch(str(said))
    value, unit = (float(match[1]), match[2]) if match else (0.0, None)
    low, high = _PIXELS if unit == "px" else _SHARES
    focal = _of_film(value) if unit == "mm" else value
    if not low <= focal <= high:
        problem = f"{shown(said)} is not a focal length"
        remedy = "as 26mm (on 35 mm film), 1400px, or 0.72 (of the picture's longer side)"
        raise InputError("--focal", problem, remedy=remedy)
    return focal / longer_side if unit == "px" else focal, _FILM_STD if unit == "mm" else 0.0


def described(lens: Lens, pixels: str, name: str) -> str:
    """The note on it; pixels: how long it is."""
    if lens.source:
        return f"the focal length of {name} is {pixels}, by {lens.source}"
    return (
        f"no camera given: a focal length of {pixels} (+-{lens.std:.0%}) is guessed for {name}, as most phones have;"
        " sizes and distances depend on it: give it with --focal or --phone"
    )


def before_subject(
    body: Body, tracks: Mapping[str, KeypointTrack], cameras: Mapping[str, Camera]
) -> tuple[dict[str, Camera], list[str]]:
    """The one camera of a clip, moved to where the subject at rest looks as large as its keypoints in the first frame
    that has enough of them, preferably those of head and trunk, which arms do not move; and a note on it. As it
    is where no frame has enough."""
    ((name, track),) = tracks.items()
    order = np.array(
        [track.names.index(mark) if mark in track.names else -1 for mark in body.landmark_names], dtype=int
    )
    rest = body.landmarks(body.at(body.neutral))
    still = landmark_features(body, anatomy_of(body)).of_trunk
    for pixels, confidence in zip(track.pixels, track.confidence, strict=True):
        seen = np.flatnonzero((order >= 0) & (np.append(confidence, 0.0)[order] > 0.0))
        chosen = np.intersect1d(seen, still)
        chosen = chosen if len(chosen) >= _FEWEST else seen
        if len(chosen) >= _FEWEST and np.ptp(pixels[order[chosen]], axis=0).max() > 0.0:
            camera = camera_before(cameras[name], rest[chosen], pixels[order[chosen]])
            away = camera.depths(rest[chosen]).mean()
            place = f"level before {body.subject.name}, {away:.2f} m away"
            return {name: camera}, [f"{name} is assumed to stand {place}: no camera file places it"]
    return dict(cameras), []


class LensTags(NamedTuple):
    """equivalent: focal length [mm] that gives the same view on 35 mm film. model: of the phone or camera, by its
    maker's name. None where missing."""

    equivalent: float | None = None
    model: str | None = None


def lens_tags(path: Path) -> LensTags:
    """QuickTime's tags of a film, Exif's FocalLengthIn35mmFilm and Model of a picture, of a folder's first."""
    if path.is_dir():
        first = next((p for p in sorted(path.iterdir()) if p.suffix.lower() in (".jpg", ".jpeg")), None)
        return LensTags() if first is None else _of_picture(first)
    return _focal_of_film(path)


def _of_picture(path: Path) -> LensTags:
    from PIL import ExifTags, Image, UnidentifiedImageError

    try:
        with Image.open(path) as picture:
            tags = picture.getexif()
            length = tags.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.FocalLengthIn35mmFilm)
            model = tags.get(ExifTags.Base.Model)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError):  # damaged tags are ignored
        return LensTags()
    return LensTags(_checked(length), None if model is None else str(model).strip(" \0"))


def _focal_of_film(path: Path) -> LensTags:
    command = [*ffmpeg_command(), "-i", f"file:{path}", "-f", "ffmetadata", "-"]
    try:
        said = subprocess.run(command, capture_output=True, timeout=60, check=False).stdout.decode(errors="replace")
    except subprocess.TimeoutExpired:
        return LensTags()
    tags = [(name.strip(), value.strip()) for name, _, value in (line.partition("=") for line in said.splitlines())]
    length, model = (next((value for name, value in tags if name.endswith(end)), None) for end in (_EQUIVALENT, _MODEL))
    return LensTags(_checked(length), model)


def _checked(said: object) -> float | None:
    try:
        length = float(str(said))
    except ValueError:
        return None
    return length if _RANGE[0] <= length <= _RANGE[1] else None
