"""The focal length of a camera without a calibration: as the user, the file or the phone's model says it, else that of
most phones."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from estimator.data.media.lens_tags import FILM_DIAGONAL, LensTags, lens_tags
from humanoid.support.errors import InputError, shown
from kinemode.inputs.phones import checked_phone, phone

PHONES = 0.74
"""Of the longer side: what calibrations of phones and tablets have in the middle, two from 0.67 to 0.91 (the lenses
that OpenCap's calibrations list; Uhlrich et al. 2023). Web cameras of 60 to 78 degrees have 0.7 to 0.9."""
PHONES_STD = 0.09
"""Standard deviation of its logarithm over these."""
_MODEL_STD = 0.03  # between calibrations of one kind of lens
_FILM_STD = 0.06  # a stated length on film is rounded, and is the photograph's: video is cropped
_SENSOR = 1.2  # diagonal over longer side: between the sensor's 4:3 (1.25) and the film's 16:9 (1.15), which crops it
_WRITTEN = re.compile(r"\s*([0-9]*\.?[0-9]+)\s*(mm|px)?\s*")
_TABLE = "OpenCap's calibration of video that is neither zoomed nor stabilised"
_SHARES, _PIXELS = (0.2, 20.0), (10.0, 1e6)


class Lens(NamedTuple):
    """focal: length over the picture's longer side. std: relative standard deviation of it. source: who says so, for a
    note; empty where it is a guess."""

    focal: float
    std: float
    source: str = ""


def lens_of(said: str | None, path: Path | None, longer_side: float, model: str | None = None) -> Lens:
    """The lens of a clip: what the user says, else its tags, else the lens of the phone that its tags name.

    said: by the user, as "26mm" (on 35 mm film), "1400px" or "0.72" (of the longer side). path: of the clip.
    longer_side: of the picture [px]. model: of the phone, by the user, see `kinemode.inputs.phones.phone` for what its
    focal length is of.

    Raises InputError: said is none of these; the phone is not known.
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
        problem = f"{shown(said)} is no focal length"
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
