"""What a film or a picture says of the lens that took it: the focal length of the same view on 35 mm film."""

from __future__ import annotations

import subprocess
from pathlib import Path

from estimator.data.media.film import ffmpeg_command

FILM_DIAGONAL = 43.27  # mm, of 24 x 36
_EQUIVALENT = "focal_length.35mm_equivalent"  # how the tag ends that phones write into films (QuickTime metadata)
_RANGE = (5.0, 2000.0)  # mm


def film_equivalent(path: Path) -> float | None:
    """Focal length [mm] that gives the same view on 35 mm film, None where nothing is said of it.

    Read are QuickTime's tag of films and Exif's FocalLengthIn35mmFilm of pictures, of a folder that of the first.
    """
    if path.is_dir():
        first = next((p for p in sorted(path.iterdir()) if p.suffix.lower() in (".jpg", ".jpeg")), None)
        return None if first is None else _checked(_of_picture(first))
    return _checked(_of_film(path))


def _of_picture(path: Path) -> str | None:
    from PIL import ExifTags, Image, UnidentifiedImageError

    try:
        with Image.open(path) as picture:
            said = picture.getexif().get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.FocalLengthIn35mmFilm)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError):  # damaged tags say nothing
        return None
    return None if said is None else str(said)


def _of_film(path: Path) -> str | None:
    command = [*ffmpeg_command(), "-i", f"file:{path}", "-f", "ffmetadata", "-"]
    try:
        said = subprocess.run(command, capture_output=True, timeout=60, check=False).stdout.decode(errors="replace")
    except subprocess.TimeoutExpired:
        return None
    tags = (line.partition("=") for line in said.splitlines())
    return next((value for name, _, value in tags if name.strip().endswith(_EQUIVALENT)), None)


def _checked(said: str | None) -> float | None:
    try:
        length = float(said or "nan")
    except ValueError:
        return None
    return length if _RANGE[0] <= length <= _RANGE[1] else None
