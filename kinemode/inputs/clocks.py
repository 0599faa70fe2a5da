"""The clocks of the cameras that a user gives: frame rates from files and from the user, and what they leave
undetermined."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.clip import DEFAULT_FPS, Clip, ClipReport
from estimator.data.timing import CameraClock, Timeline, clip_clock, in_step, keypoint_clock, length_notes
from humanoid.support.errors import InputError
from kinemode.inputs.declared import offsets as offsets_of, rates as rates_of
from kinemode.named import by_name
from kinemode.request import OFF, FileOptions

_AS_WRITTEN = 2e-4  # rates this close are one rate, written with fewer digits: 23.98 for 24000/1001
_ABOUT = 0.05  # a film of uneven times has its given rate where it is this close to the usual one
_VARIES = 1.5  # longest interval over the shortest of a film of uneven times
_SHORT, _LONG = 0.5, 2.5  # of the usual interval: intervals between may be late, or follow a dropped frame
_FEW = 0.1  # share of the intervals that may be outside
_FRAMES, _SHARE = 2, 0.02  # by which a number of keypoints may differ from what their rate makes of the film's length


def clocks_of(
    tracks: Mapping[str, KeypointTrack], clips: Mapping[str, Clip], files: FileOptions
) -> tuple[dict[str, CameraClock], list[str]]:
    """The clock of each camera, in the order of the tracks, and notes on what had to be assumed.

    clips: opened; none where there are keypoints alone.

    Raises
    ------
    InputError: offsets or rates of unknown cameras; a rate for keypoint files that have one, without clips; one rate
    for a film whose frames' times have several.
    """
    offsets, rates = offsets_of(files.offset, tracks), rates_of(files.fps, tracks)
    if not clips:
        return _without_clips(tracks, offsets, rates, files)
    clocks: dict[str, CameraClock] = {}
    notes: list[str] = []
    for name, track in tracks.items():
        clocks[name], of_clip = _with_clip(name, track, clips[name], rates.get(name), offsets[name])
        notes += of_clip
    return clocks, notes


def _with_clip(
    name: str, track: KeypointTrack, clip: Clip, given: float | None, offset: float
) -> tuple[CameraClock, list[str]]:
    """The clock of a camera with a clip, and notes. given: by --fps, the pictures' rate unless the keypoints' number
    shows that it is theirs."""
    notes, rate, report = list[str](), track.fps, clip.report
    remedy = "correct fps in the keypoint file" if rate else "write their fps into the keypoint file"
    if not clip.rate_known and (given or rate):
        report = _at_rate(clip, given or rate)
        if given is None:
            remedy = f"give the pictures' rate: --fps {name}=RATE"
            notes.append(f"{name}: the pictures have no frame rate: {rate:g}, as {track.source} declares")
    elif given is not None and rate is None and of_keypoints(track.frame_count, report, given):
        rate = given
    elif given is not None:
        report, note = report_at(clip.path, report, given)
        rate = keypoint_rate(track, clip.report, report)
        notes += [f"{name}: {note}"] if note else []
    elif rate is None:
        remedy = f"give the keypoints' rate: --fps {name}=RATE"
    clock, of_lengths = clip_clock(name, track, report, rate, offset, remedy)
    return clock, [*notes, *(f"{name}: {note}" for note in report.notes), *of_lengths]


def _at_rate(clip: Clip, rate: float | None) -> ClipReport:
    """The report of a clip without a rate at this one."""
    with closing(Clip.open(clip.path, fps=rate)) as again:
        return again.report


def _without_clips(
    tracks: Mapping[str, KeypointTrack], offsets: Mapping[str, float], rates: Mapping[str, float], files: FileOptions
) -> tuple[dict[str, CameraClock], list[str]]:
    _refuse_unused(rates, {name for name, track in tracks.items() if track.fps is None}, files)
    known = {name: track.fps or rates.get(name) for name, track in tracks.items()}
    usual = max((rate for rate in known.values() if rate), default=None)
    if usual is None:
        notes = [f"no frame rate in the keypoint files: {DEFAULT_FPS:g} frames per second assumed; give it with --fps"]
    else:
        of_others = f"no frame rate in the keypoint file: {usual:g}, as the others have; give it with --fps NAME=RATE"
        notes = [f"{name}: {of_others}" for name, rate in known.items() if not rate]
    clocks = {
        name: keypoint_clock(track.frame_count, known[name] or usual or DEFAULT_FPS, offsets[name])
        for name, track in tracks.items()
    }
    # where offsets are still to be found, lengths mean nothing
    return clocks, notes + (_lengths(tracks, clocks) if files.sync == OFF else [])


def _lengths(tracks: Mapping[str, KeypointTrack], clocks: Mapping[str, CameraClock]) -> list[str]:
    if not in_step(list(clocks.values())):
        return []
    longest = max(track.frame_count for track in tracks.values())
    return list(length_notes(tracks, longest, "give the rates: --fps NAME=RATE, or fps in the files"))


def _refuse_unused(rates: Mapping[str, float], used: set[str], files: FileOptions) -> None:
    """A rate that changes nothing is a misunderstanding."""
    unused = [name for name in rates if name not in used]
    if unused and (by_name(files.fps) or len(unused) == len(rates)):
        problem = f"the files of {', '.join(unused)} declare their frame rates"
        remedy = "--fps is for clips, and for keypoint files that declare none; correct fps in the file"
        raise InputError("--fps", problem, remedy=remedy)


def notes_on_time(clocks: Mapping[str, CameraClock], line: Timeline) -> list[str]:
    """A note on how cameras are matched, unless frame by frame."""
    lengths = {name: len(clock.frames) for name, clock in clocks.items()}
    if not in_step(list(clocks.values())):
        each = ", ".join(f"{n} {c.rate:g} from {c.offset:g} s" for n, c in clocks.items())
        span = f"{len(line.times)} instants from {line.times[0]:.2f} to {line.times[-1]:.2f} s"
        return [f"the cameras are matched by time (frames per second: {each}): {span}, while all of them run"]
    if len(set(lengths.values())) > 1 and all(clock.pictures is not None for clock in clocks.values()):
        each = ", ".join(f"{name} {count}" for name, count in lengths.items())
        shortest = min(lengths, key=lambda name: lengths[name])
        return [f"the clips differ in length ({each} frames): all end with {shortest}"]
    return []


def report_at(path: Path, report: ClipReport, rate: float) -> tuple[ClipReport, str]:
    """The film's report with its pictures taken at a given rate, and a note where that is not the film's.

    Even times become those of the given rate; uneven ones keep their proportions, and the rate is that of the usual
    interval between frames, since some may have been dropped.

    Raises
    ------
    InputError: the film's frames have several rates, as a film that is slow in one part only.
    """
    intervals = np.diff(report.times)
    if len(intervals) == 0 or intervals.max() <= _VARIES * intervals.min():
        if abs(rate / report.fps - 1.0) <= _AS_WRITTEN:
            return report, ""
        times = np.arange(report.read) / rate
        return replace(report, times=times, fps=rate), _used(report.fps, rate)
    own = 1.0 / float(np.median(intervals))
    outside = (intervals < _SHORT / own) | (intervals > _LONG / own)
    if outside.mean() > _FEW:
        problem = f"has frames {1e3 * intervals.min():.0f} to {1e3 * intervals.max():.0f} ms apart, not at one rate"
        remedy = "leave --fps out: the frames' own times are used; or cut out the part that has one rate"
        raise InputError(path, problem, remedy=remedy, place=f"--fps {rate:g}")
    if abs(rate / own - 1.0) <= _ABOUT:
        return report, ""
    return replace(report, times=report.times * own / rate, fps=report.fps * rate / own), _used(own, rate)


def of_keypoints(count: int, report: ClipReport, rate: float) -> bool:
    """Whether a rate is that of keypoints without one beside a film: `count` of them are about as many as it makes of
    the film's length, or fewer if it is below the film's (detectors skip frames, and end early)."""
    expected = report.read * rate / report.fps
    near = max(_FRAMES, _SHARE * expected)
    if abs(count - report.read) <= abs(count - expected):
        return False
    return count <= expected + near and (rate < report.fps or count >= expected - near)


def keypoint_rate(track: KeypointTrack, film: ClipReport, given: ClipReport) -> float | None:
    """Frames per second of keypoints beside a film whose declared rate, in `film`, is replaced by that of `given`.

    A declared rate is of the film's clock where it is the film's, as a detector writes it, and else of the clock whose
    length the number of keypoints suits. None where no rate is declared.
    """
    if track.fps is None or given is film:
        return track.fps
    by_film = track.fps * given.fps / film.fps
    if abs(track.fps / film.fps - 1.0) <= _ABOUT:
        return by_film
    expected = [film.read * track.fps / report.fps for report in (film, given)]
    return by_film if abs(track.frame_count - expected[0]) <= abs(track.frame_count - expected[1]) else track.fps


def _used(own: float, rate: float) -> str:
    return f"the film has {own:.5g} frames per second: {rate:g} is used instead, as given with --fps"
