"""Lens data in the tags of a film or a picture."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import NamedTuple

from estimator.data.media.film import ffmpeg_command

FILM_DIAGONAL = 43.27  # mm, of 24 x 36
_EQUIVALENT = "focal_length.35mm_equivalent"  # how the tag ends that phones write into films (QuickTime metadata)
_MODEL = "quicktime.model"
_RANGE = (5.0, 2000.0)  # mm


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
    return _of_film(path)


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


def _of_film(path: Path) -> LensTags:
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
