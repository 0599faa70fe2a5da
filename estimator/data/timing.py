"""When pictures and keypoints were taken: several cameras and files on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.clip import ClipReport
from humanoid.support.errors import InputError

SAME_RATE = 0.01  # rates this close are one rate: 29.97 is written as 30, 59.94 as 60
_SNAP = 0.02  # of a frame: an instant this close to a frame is that frame's
_ORDINALS = {2: "2nd", 3: "3rd", 4: "4th", 5: "5th"}


@dataclass(frozen=True)
class CameraClock:
    """When a camera's pictures and keypoints were taken, in seconds since its own first frame.

    pictures (M,): of its clip, None without one. keypoints (N,): of its keypoint file. Both strictly increase.
    rate: frames per second of the clip, or of the keypoints where there is none.
    offset: when its first frame was taken on the common clock [s]: above 0 for a camera that started late.
    frame_by_frame: whether keypoint i is that of picture i; always so without a clip.
    """

    pictures: np.ndarray | None
    keypoints: np.ndarray
    rate: float
    offset: float = 0.0
    frame_by_frame: bool = True

    @property
    def frames(self) -> np.ndarray:
        """Times of the pictures, or of the keypoints where there are none."""
        return self.keypoints if self.pictures is None else self.pictures


@dataclass(frozen=True)
class Timeline:
    """The instants that are observed, and what each camera has of them.

    times (T,): on the common clock [s].
    places: by camera, where the instants lie among its keypoint frames (T,): whole numbers are frames, between two
    frames both count, NaN means none. frames: by camera, number of the clip's frame at each instant (T,).
    """

    times: np.ndarray
    places: Mapping[str, np.ndarray]
    frames: Mapping[str, np.ndarray]

    def cut(self, start: float | None, end: float | None) -> Timeline:
        """The instants from `start` to `end` [s], both included; raises InputError where none is left."""
        low, high = (-np.inf if start is None else start), (np.inf if end is None else end)
        rows = (self.times >= low - 1e-6) & (self.times <= high + 1e-6)
        if not rows.any():
            given = " ".join(f"--{name} {at:g}" for name, at in (("start", start), ("end", end)) if at is not None)
            remedy = f"frames lie between {self.times[0]:.3f} and {self.times[-1]:.3f} s"
            raise InputError(given, "leaves no frame", remedy=remedy)
        return Timeline(self.times[rows], _each(self.places, rows), _each(self.frames, rows))


def _each(of: Mapping[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[rows] for name, values in of.items()}


def keypoint_clock(frame_count: int, rate: float, offset: float = 0.0) -> CameraClock:
    """The clock of a camera without a clip."""
    return CameraClock(None, np.arange(frame_count) / rate, rate, offset)


def clip_clock(
    name: str, track: KeypointTrack, report: ClipReport, rate: float | None, offset: float = 0.0, remedy: str = ""
) -> tuple[CameraClock, tuple[str, ...]]:
    """The clock of a camera with a clip, and notes.

    rate: of the keypoints, None where unknown. remedy: what to do if they are of some of the frames only.

    A detector reads a clip frame by frame: keypoint i is that of frame i, unless the rates differ. Where they differ
    and there are as many keypoints as frames, one of the rates must be wrong, and keypoint i is that of frame i still.
    """
    count, frames = track.frame_count, report.read
    own_rate = None if rate is None or abs(rate / report.fps - 1.0) <= SAME_RATE else rate
    if own_rate is not None and count != frames:
        note = f"{name}: keypoints at {rate:g} frames per second, the clip at {report.fps:g}: matched by time"
        return CameraClock(report.times, np.arange(count) / own_rate, report.fps, offset, False), (note,)
    notes = length_notes({name: track}, frames, remedy)
    if own_rate is not None:
        declared = f"keypoints declare {rate:g} frames per second, the clip {report.fps:g}"
        notes = (f"{name}: {declared}, but both have {count} frames: frame by frame, at the clip's rate",)
    return CameraClock(report.times, report.times[:count], report.fps, offset), notes


def length_notes(tracks: Mapping[str, KeypointTrack], frame_count: int, remedy: str = "") -> tuple[str, ...]:
    """Notes for the user on tracks that are matched frame by frame and differ from the clip's length."""
    notes = []
    for name, track in tracks.items():
        note, ratio = "", _ratio(track.frame_count, frame_count)
        if track.frame_count < frame_count:
            note = f"{name}: keypoints end after {track.frame_count} of {frame_count} frames"
            doubt = "if they are of every {} frame, they are matched wrongly"
        elif track.frame_count > frame_count:
            note = f"{name}: keypoints of {track.frame_count} frames, only the first {frame_count} are used"
            doubt = "if the clip has every {} of these frames, they are matched wrongly"
        if note and ratio is not None:
            warning = f"{note}; {doubt.format(_ORDINALS[ratio])}"
            note = f"{warning} ({remedy})" if remedy else warning
        notes += [note] if note else []
    return tuple(notes)


def _ratio(a: int, b: int) -> int | None:
    """Ratio of two counts, where that is a small whole number."""
    fewer, more = sorted((a, b))
    return next((r for r in _ORDINALS if fewer > 1 and fewer in (more // r, -(-more // r))), None)


def timeline(clocks: Mapping[str, CameraClock]) -> Timeline:
    """The instants of all cameras.

    Cameras that started together and whose frames stay within half a frame of each other are taken frame by frame: with
    clips until the first ends, without until the last. Else the instants are the frames of the fastest camera while all
    of them run: of the others the nearest picture counts, and keypoints are interpolated.

    Raises
    ------
    InputError: there is no time at which all cameras run.
    """
    return _together(clocks) if in_step(list(clocks.values())) else _by_time(clocks)


def in_step(clocks: Sequence[CameraClock]) -> bool:
    """Whether frame i of every camera was taken at about the same time."""
    first = clocks[0]
    for clock in clocks[1:]:
        count = min(len(first.frames), len(clock.frames))
        apart = np.abs(first.frames[:count] - clock.frames[:count])
        if clock.offset != first.offset or apart.max(initial=0.0) > 0.5 / max(first.rate, clock.rate):
            return False
    return True


def _together(clocks: Mapping[str, CameraClock]) -> Timeline:
    some = next(iter(clocks.values()))
    choose = max if some.pictures is None else min
    leading = choose(clocks.values(), key=lambda clock: len(clock.frames))
    numbers = np.arange(len(leading.frames))
    places = {}
    for name, clock in clocks.items():
        if clock.frame_by_frame:
            places[name] = np.where(numbers < len(clock.keypoints), numbers, np.nan)
        else:
            places[name] = _places(clock, clock.frames[: len(numbers)])
    times = leading.frames if some.offset == 0.0 else leading.frames + some.offset
    return Timeline(times, places, {} if some.pictures is None else dict.fromkeys(clocks, numbers))


def _by_time(clocks: Mapping[str, CameraClock]) -> Timeline:
    leading = max(clocks.values(), key=lambda clock: clock.rate)
    begin = max(c.offset + c.frames[0] - 0.5 / c.rate for c in clocks.values())
    end = min(c.offset + c.frames[-1] + 0.5 / c.rate for c in clocks.values())
    times = leading.frames + leading.offset
    times = times[(times >= begin) & (times <= end)]
    if len(times) == 0:
        each = ", ".join(f"{n} {c.offset:.3f} to {c.offset + c.frames[-1]:.3f} s" for n, c in clocks.items())
        raise InputError("offset", f"the cameras never run at the same time: {each}", remedy="--offset NAME=SECONDS")
    places = {name: _places(clock, times - clock.offset) for name, clock in clocks.items()}
    nearest = {
        name: _nearest(clock.pictures, times - clock.offset)
        for name, clock in clocks.items()
        if clock.pictures is not None
    }
    return Timeline(times, places, nearest)


def _places(clock: CameraClock, at: np.ndarray) -> np.ndarray:
    """Places of instants `at` (T,) on a camera's own clock among its keypoint frames."""
    known, count = clock.keypoints, len(clock.keypoints)
    step = (known[-1] - known[0]) / (count - 1) if count > 1 else 1.0 / clock.rate
    around = np.concatenate([[known[0] - step], known, [known[-1] + step]])
    place = np.interp(at, around, np.arange(-1.0, count + 1.0), left=np.nan, right=np.nan)
    nearest = np.round(place)
    place = np.where(np.abs(place - nearest) <= _SNAP, nearest, place)
    return np.where((place >= 0.0) & (place <= count - 1.0), place, np.nan)


def _nearest(times: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Index of the time nearest to each instant (T,), the earlier of two equally near."""
    after = np.clip(np.searchsorted(times, at), 1, max(1, len(times) - 1))
    before = after - 1
    after = np.minimum(after, len(times) - 1)
    return np.where(at - times[before] <= times[after] - at + 1e-6, before, after)


LONGEST_BRIDGE = 0.1  # frames further apart are not interpolated: what lies between is unknown [s]


def at_places(track: KeypointTrack, places: np.ndarray, times: np.ndarray) -> KeypointTrack:
    """The keypoints at `places` (T,) among the track's frames, see `Timeline`.

    times (N,): of the track's first N frames [s]; others do not count.
    Between two frames a point lies on the line from the one to the other and is as sure as the less sure of the two; it
    is missing where it is missing in either, or where the frames are more than `LONGEST_BRIDGE` apart. Of the world the
    nearer frame's is taken. A track whose first frames are the instants is returned unchanged.
    """
    count = len(times)
    if _follows(places, count):
        return track
    known = np.isfinite(places)
    place = np.where(known, places, 0.0)
    lower = np.floor(place).astype(np.int64)
    share = place - lower
    upper = np.minimum(lower + 1, count - 1)
    between = known & (share > 0.0)
    known &= ~between | (times[upper] - times[lower] <= LONGEST_BRIDGE + 1e-6)
    pixels, confidence = track.pixels[lower], track.confidence[lower]
    b, part = between, share[between, None, None]
    pixels[b] = (1.0 - part) * pixels[b] + part * track.pixels[upper[b]]
    confidence[b] = np.minimum(confidence[b], track.confidence[upper[b]])
    pixels[~known], confidence[~known] = np.nan, 0.0
    world = None if track.world is None else track.world[np.rint(place).astype(np.int64)]
    if world is not None:
        world[~known] = np.nan
    return replace(track, pixels=pixels, confidence=confidence, world=world)


def _follows(places: np.ndarray, count: int) -> bool:
    """Whether the instants are the track's frames from the first on, and none after its end."""
    first = places[:count]
    return bool((first == np.arange(len(first))).all() and np.isnan(places[count:]).all())
