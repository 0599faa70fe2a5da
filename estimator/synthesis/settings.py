"""Settings of a rendered scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from humanoid.support.errors import InputError

BACKGROUNDS = ("room", "textured", "pillar", "black", "moving")
OCCLUDERS = ("none", "post", "box")
SLEEVES = ("short", "long")

_MEMORY = -1.0 / (30.0 * math.log(0.6))  # of a detector [s]: 0.6 from frame to frame at 30 frames/s

_RANGES = {
    "light_azimuth": (-360.0, 360.0), "light_elevation": (5.0, 90.0), "ambient": (0.0, 2.0), "diffuse": (0.0, 2.0),
    "shadow": (0.0, 1.0), "shutter": (0.0, 1.0), "sub_frames": (1, 32), "lens_blur": (0.0, 20.0),
    "noise": (0.0, 100.0), "boards": (0, 20), "swinging": (0, 20), "pan": (0.0, 1000.0), "shake": (0.0, 100.0),
}  # fmt: skip


@dataclass(frozen=True)
class SceneSettings:
    """Background, light, lens and sensor of a rendered clip.

    background: "room" is cluttered; "textured" the same with speckled floor, walls and furniture, in which stereo finds
        depth everywhere; "pillar" a dark wall with a bright pillar and strong horizontal edges (as in CSS
        section 6.1); "black" is empty; "moving" is the room as a panning, shaking camera would show it, behind a
        person who stays in the frame; None takes the one that suits the motion, a room where there is no motion.
    light_azimuth, light_elevation [deg]: where the light comes from, seen from the world's x axis to the left, and
        above the horizon. ambient, diffuse: brightness of surfaces turned away from it, and what is added facing it.
    shadow: share of the light that the body takes from the floor; 0 casts none.
    shutter: share of the time between frames for which the shutter is open; 0 freezes the motion. sub_frames: pictures
        averaged over that time.
    lens_blur [px]: standard deviation of the lens's blur. noise: of the sensor, in grey values.
    occluder: what stands between the first camera and the person. hidden [s]: interval (end not included) in which a
        screen before every camera hides the person completely, as ((1.0, 2.0),) or ("1.0:2.0",).
    sleeves: how far the shirt's go; long ones leave only hands and head bare. boards: number of wooden boards in the
        colour of skin, on the wall and beside the person; swinging: number of boards that swing behind the person, and
        are on no picture of the empty scene.
    pan, shake [px]: how far the moving background swings slowly, and shakes.

    Raises
    ------
    InputError: a value outside its range.
    """

    background: str | None = None
    light_azimuth: float = -29.0
    light_elevation: float = 59.0
    ambient: float = 0.5
    diffuse: float = 0.6
    shadow: float = 0.45
    shutter: float = 0.0
    sub_frames: int = 4
    lens_blur: float = 0.0
    noise: float = 2.5
    occluder: str = "none"
    hidden: Sequence[tuple[float, float] | str] = ()
    sleeves: str = "short"
    boards: int = 0
    swinging: int = 0
    pan: float = 40.0
    shake: float = 1.5

    def __post_init__(self) -> None:
        if self.background is not None:
            _chosen("background", self.background, BACKGROUNDS)
        _chosen("occluder", self.occluder, OCCLUDERS)
        _chosen("sleeves", self.sleeves, SLEEVES)
        for name, (low, high) in _RANGES.items():
            in_range(name, getattr(self, name), low, high)
        _ = self.spans

    @property
    def spans(self) -> tuple[tuple[float, float], ...]:
        """From when until when [s] the person is hidden, as numbers."""
        return tuple(map(_span, self.hidden))

    def hides(self, time: float) -> bool:
        """Whether the person is hidden at a time [s]."""
        return any(begin <= time < end for begin, end in self.spans)


@dataclass(frozen=True)
class DetectorSettings:
    """Errors of the keypoints; raises InputError outside their ranges.

    noise_px: standard deviation [px] of each coordinate, averaged over the keypoints; it is greater at the hips than
        at the eyes, as COCO's annotators are.
    outlier_fraction: share of the keypoints that are 25 to 80 px off, with little less confidence.
    missing_fraction: share that is missing, beside those outside the image.
    bias: standard deviation [m] of how far from a landmark the detector marks this person, averaged over the keypoints.
    correlation: time [s] in which the noise forgets itself, by a factor of e.
    reach: distance [m] between two points at which their noises are still alike, by the same factor; 0 for noise that
        is independent from point to point.
    """

    noise_px: float = 2.5
    outlier_fraction: float = 0.01
    missing_fraction: float = 0.02
    bias: float = 0.0
    correlation: float = _MEMORY
    reach: float = 0.0

    def __post_init__(self) -> None:
        in_range("noise_px", self.noise_px, 0.0, 1000.0)
        in_range("outlier_fraction", self.outlier_fraction, 0.0, 1.0)
        in_range("missing_fraction", self.missing_fraction, 0.0, 1.0)
        in_range("bias", self.bias, 0.0, 1.0)
        in_range("correlation", self.correlation, 0.0, 60.0)
        in_range("reach", self.reach, 0.0, 10.0)

    def persistence(self, fps: float) -> float:
        """Correlation of the noise from frame to frame."""
        return math.exp(-1.0 / (fps * self.correlation)) if self.correlation else 0.0


@dataclass(frozen=True)
class ViewSettings:
    """Where the cameras stand, see `estimator.synthesis.views.framing_cameras`; raises InputError outside its ranges.

    count: of cameras. azimuth [deg]: of the first, from the world's x axis, which a person faces at first, to the left;
    None takes the one that suits the motion. elevation [deg]: of all. fill: share of the picture's height that the
    person takes up. image_size: width, height [px]. baseline [m]: every camera has another one beside it, this far to
    its right and parallel to it, NAME_right; 0 for none. parallel: whether the cameras are parallel (orthographic), for
    which a baseline gives no depth.
    """

    count: int = 1
    azimuth: float | None = None
    elevation: float = 8.0
    fill: float = 0.7
    image_size: tuple[int, int] = (640, 480)
    baseline: float = 0.0
    parallel: bool = False

    def __post_init__(self) -> None:
        if self.parallel and self.baseline:
            raise InputError(
                "parallel", "parallel cameras measure no depth by a baseline", remedy="leave out one of both"
            )
        in_range("cameras", self.count, 1, 16)
        in_range("azimuth", self.azimuth or 0.0, -360.0, 360.0)
        in_range("elevation", self.elevation, -10.0, 60.0)
        in_range("fill", self.fill, 0.1, 0.9)
        in_range("baseline", self.baseline, 0.0, 1.0)
        for side in self.image_size:
            in_range("image_size", side, 16, 8192)
            if side % 2:
                raise InputError("image_size", f"is {side}", remedy="even numbers of pixels, as video needs them")


def in_range(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError unless low <= value <= high."""
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(name, f"is {value:g}", remedy=f"{low:g} to {high:g}")


def _span(given: Sequence[float] | str) -> tuple[float, float]:
    """First and last time [s]; raises InputError for an impossible range."""
    parts = given.split(":") if isinstance(given, str) else list(given)
    try:
        begin, end = map(float, parts)
    except (TypeError, ValueError):
        begin = end = math.nan
    if not (math.isfinite(end) and 0.0 <= begin < end):
        raise InputError("hidden", f"is {':'.join(map(str, parts))}", remedy="seconds FROM:TO, 0 <= FROM < TO")
    return begin, end


def _chosen(name: str, value: str, valid: tuple[str, ...]) -> None:
    if value not in valid:
        raise InputError(name, f"there is no {value!r}", remedy="one of " + ", ".join(valid))
