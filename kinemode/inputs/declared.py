"""What a user says of files that do not say it themselves: sizes, rates, offsets, and which part is meant."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from estimator.data.floor import OFF, KnownFloor
from humanoid.support.errors import InputError, shown
from kinemode.inputs.named import by_name, named_values, value_of, words_of
from kinemode.inputs.phones import checked_phone

if TYPE_CHECKING:
    from estimator.vision.resolution import Size

Sizes = str | tuple[int, int] | Iterable[str] | Mapping[str, str | tuple[int, int]] | None
Rates = float | str | Iterable[str] | Mapping[str, float] | None
Offsets = str | Iterable[str] | Mapping[str, float] | None
BY_INDEX, ALL = "index", "all"
AUTO = SYNC = "auto"
SYNC_CHOICES = (OFF, SYNC)
_HIGHEST = 1000.0  # m
_FLOORS = "a height in the cameras' world in metres, off or auto"
_SECONDS = "a number of seconds"
_SIZE = re.compile(r"([0-9]{1,5})x([0-9]{1,5})")


@dataclass(frozen=True)
class Declared:
    """What the user says of the files of `track`, `fit` and `compare`, as it is written.

    keypoint_size: width and height [px] of the pictures that the detector saw, as (540, 960) or "540x960".
    fps: frames per second of the pictures of a folder, of a film that was taken at another rate than it declares, and
    of keypoint files that declare none.
    offset: by camera, seconds that its first frame was taken after the moment 0 of the common clock.
    keypoint_size and fps hold for all cameras, or by name as a mapping or as "NAME=VALUE" texts; offset always by name.
    start, end: of the part that is tracked, on the common clock [s].
    sync: "auto" finds the offsets of cameras that none is given for, and their rates where these differ from what is
        declared; "off" takes them for 0.
    up: the axis of the cameras' world that points up, one of `estimator.data.cameras.camera.UPS`, or a direction as
        three numbers; None where it is to be found.
    layout: what the keypoints of files are, a key of `humanoid.subject.landmarks.FORMATS`; "auto" takes the file's
        word.
    focal: length of the one camera that no file describes, see `kinemode.inputs.lens.lens_of`; None where the clip
        tells it, or nobody. phone: the model that took it, in place of focal, see `kinemode.inputs.phones.phone`.
    floor: its height in the cameras' world, along the axis that points up [m]; "off" where there is none; "auto" takes
        the camera file's word, or finds it from the feet.
    height: of the person [m], None where it is not known.
    keypoint_noise: standard deviation of a keypoint about its place on the body [px], where the person is as large as
        in the middle of the clip; one for all cameras, or by name as keypoint_size; None where it is to be measured.
    """

    keypoint_size: Sizes = None
    fps: Rates = None
    offset: Offsets = None
    start: float | str | None = None
    end: float | None = None
    sync: str = OFF
    up: str | None = None
    layout: str = "auto"
    focal: str | None = None
    phone: str | None = None
    floor: float | str = AUTO
    height: float | None = None
    keypoint_noise: Rates = None

    def words(self) -> dict[str, tuple[str, ...]]:
        """What was given, as words of the command line by option."""
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        usual = {field.name: field.default for field in fields(self)}
        return {n.replace("_", "-"): words_of(value) for n, value in given.items() if value != usual[n]}

    def sizes(self, names: Iterable[str]) -> dict[str, Size]:
        """Size of the pictures that each camera's detector saw, where it is given."""
        return named_values(
            self.keypoint_size, names, "--keypoint-size", _size, "width and height in whole pixels, as 1920x1080"
        )

    def rates(self, names: Iterable[str]) -> dict[str, float]:
        """Frames per second, of the cameras for which they are given."""
        return named_values(self.fps, names, "--fps", _rate, "frames per second, 0.5 to 2000")

    def noises(self, names: Iterable[str]) -> dict[str, float]:
        """Standard deviation of keypoints [px], of the cameras for which it is given."""
        return named_values(self.keypoint_noise, names, "--keypoint-noise", _noise, "pixels, 0.1 to 1000")

    def offsets(self, names: Iterable[str]) -> dict[str, float]:
        """Seconds of each camera, 0 for those that are not given."""
        names = list(names)
        given = named_values(self.offset, names, "--offset", _seconds, _SECONDS)
        if given and not by_name(self.offset):
            raise InputError("--offset", "is for no camera", remedy=f"NAME=SECONDS; cameras: {', '.join(names)}")
        return dict.fromkeys(names, 0.0) | given

    def check_lens(self) -> None:
        """Raise InputError for both a focal length and a phone, and for a phone that is not known."""
        if self.phone is None:
            return
        if self.focal is not None:
            raise InputError("--phone", "gives the focal length, as --focal does", remedy="leave one of them out")
        checked_phone(self.phone)

    def known_floor(self) -> KnownFloor:
        """`floor`, checked; None for "auto"."""
        if isinstance(self.floor, str):
            if self.floor not in (AUTO, OFF):
                raise InputError("--floor", f"{shown(self.floor)} is no height", remedy=_FLOORS)
            return OFF if self.floor == OFF else None
        if not abs(self.floor) <= _HIGHEST:
            raise InputError("--floor", f"{self.floor:g} m is out of reach", remedy=_FLOORS)
        return float(self.floor)

    def part(self) -> tuple[float | None, float | None]:
        """`start` and `end`, checked."""
        start, end = (
            None if value is None else value_of(value, option, _seconds, _SECONDS)
            for option, value in (("--start", self.start), ("--end", self.end))
        )
        if start is not None and end is not None and start > end:
            raise InputError("--start", f"{start:g} s is after --end {end:g} s")
        return start, end


def moment(start: float | str | None) -> tuple[float | None, str | None]:
    """What `start` is: when a track begins [s], or what its first pose comes from ("index")."""
    return (None, BY_INDEX) if isinstance(start, str) and start == BY_INDEX else (start, None)  # type: ignore[return-value]


def wants_all(person: Any) -> bool:
    """Whether `--person` means everybody."""
    return person == ALL or (isinstance(person, (list, tuple)) and list(person) == [ALL])


def _size(value: Any) -> Size:
    if isinstance(value, str):
        written = _SIZE.fullmatch(value)
        value = written.groups() if written else ()
    width, height = value
    if not all(1 <= int(side) < 100_000 and int(side) == float(side) for side in (width, height)):
        raise ValueError
    return int(width), int(height)


def _rate(value: Any) -> float:
    rate = float(value)
    if not 0.5 <= rate <= 2000.0:
        raise ValueError
    return rate


def _noise(value: Any) -> float:
    pixels = float(value)
    if not 0.1 <= pixels <= 1000.0:
        raise ValueError
    return pixels


def _seconds(value: Any) -> float:
    seconds = float(value)
    if not math.isfinite(seconds):
        raise ValueError
    return seconds
