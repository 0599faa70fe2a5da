"""Values given by the user where files lack them: sizes, rates, offsets, the floor, which part of a clip, which
person.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from estimator.data.floor import OFF, KnownFloor
from humanoid.support.errors import InputError
from kinemode.named import by_name, named_pairs, named_values, value_of
from kinemode.option import options_of
from kinemode.request import ALL, AUTO, FileOptions

if TYPE_CHECKING:
    from estimator.vision.resolution import Size
    from kinemode.request import Offsets, Persons, Rates, Sizes


_SECONDS = "a number of seconds"
_SIZE = re.compile(r"([0-9]{1,5})x([0-9]{1,5})")


def sizes(given: Sizes, names: Iterable[str]) -> dict[str, Size]:
    """Size of the images [px] that each camera's detector saw, where it is given."""
    return named_values(given, names, "--keypoint-size", _size, "width and height in whole pixels, as 1920x1080")


def rates(given: Rates, names: Iterable[str]) -> dict[str, float]:
    """Frames per second, of the cameras for which they are given."""
    return _in_range("fps", given, names)


def noises(given: Rates, names: Iterable[str]) -> dict[str, float]:
    """Standard deviation of keypoints [px], of the cameras for which it is given."""
    return _in_range("keypoint_noise", given, names)


def offsets(given: Offsets, names: Iterable[str]) -> dict[str, float]:
    """Seconds of each camera, 0 for those that are not given."""
    names = list(names)
    values = named_values(given, names, "--offset", _seconds, _SECONDS)
    if values and not by_name(given):
        raise InputError("--offset", "is for no camera", remedy=f"NAME=SECONDS; cameras: {', '.join(names)}")
    return dict.fromkeys(names, 0.0) | values


def known_floor(floor: float | str) -> KnownFloor:
    """Height of the floor [m], or that there is none; None where it is to be found."""
    if isinstance(floor, str):
        return None if floor == AUTO else OFF
    return float(floor)


def part(files: FileOptions) -> tuple[float | None, float | None]:
    """Start and end of the tracked part [s], checked; None for those of the clip."""
    given = (("--start", None if files.begins_by_index else files.start), ("--end", files.end))
    start, end = (None if value is None else value_of(value, option, _seconds, _SECONDS) for option, value in given)
    if start is not None and end is not None and start > end:
        raise InputError("--start", f"{start:g} s is after --end {end:g} s")
    return start, end


def wants_all(person: Persons) -> bool:
    """Whether `--person` means all people."""
    return person == ALL or (isinstance(person, (list, tuple)) and list(person) == [ALL])


def _in_range(name: str, given: Any, names: Iterable[str]) -> dict[str, float]:
    """Numbers by camera, within the range of their option."""
    declared = options_of(FileOptions)[name]

    def read(value: Any) -> Any:
        return declared.in_range(float(value))

    return named_values(given, names, f"--{declared.flag}", read, declared.range)


def _size(value: Any) -> Size:
    if isinstance(value, str):
        written = _SIZE.fullmatch(value)
        value = written.groups() if written else ()
    width, height = value
    if not all(1 <= int(side) < 100_000 and int(side) == float(side) for side in (width, height)):
        raise ValueError
    return int(width), int(height)


def _seconds(value: Any) -> float:
    seconds = float(value)
    if not math.isfinite(seconds):
        raise ValueError
    return seconds


def persons_of(given: Persons, names: Iterable[str]) -> dict[str, str]:
    """The person of each camera, "auto" where none is given; see `named_values` for what may be given and raised."""
    names = list(names)
    if any(person == ALL for _, person in named_pairs(given)):
        problem = "all means everyone in all cameras, each tracked into a run of their own"
        raise InputError("--person", problem, remedy="of `kinemode track` only, and nothing beside it")
    needed = "auto, an id of the keypoint file, or CAMERA=ID"
    return dict.fromkeys(names, AUTO) | named_values(given, names, "--person", _person, needed)


def plain(given: Persons) -> str | int | dict[str, str]:
    """The same as a JSON value: one for all, or by camera."""
    if isinstance(given, (str, int)) and "=" not in str(given):
        return given
    pairs = named_pairs(given)
    if len(pairs) == 1 and pairs[0][0] is None:
        return str(pairs[0][1])
    return {name or "": str(person) for name, person in pairs}


def _person(value: str | int) -> str:
    if value == "":
        raise ValueError
    return str(value)
