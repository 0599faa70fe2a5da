"""The clocks of the cameras that a user gives: frame rates from files and from the user, and what they leave open."""

from __future__ import annotations

from collections.abc import Mapping

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.clip import DEFAULT_FPS, Clip
from estimator.data.timing import CameraClock, Timeline, clip_clock, in_step, keypoint_clock, length_notes
from humanoid.support.errors import InputError
from kinemode.inputs.declared import OFF, Declared
from kinemode.inputs.named import by_name


def clocks_of(
    tracks: Mapping[str, KeypointTrack], clips: Mapping[str, Clip], told: Declared
) -> tuple[dict[str, CameraClock], list[str]]:
    """The clock of each camera, in the order of the tracks, and notes on what had to be assumed.

    clips: opened; none where there are keypoints alone.

    Raises
    ------
    InputError: offsets or rates of unknown cameras; a rate for files that have one.
    """
    offsets, rates = told.offsets(tracks), told.rates(tracks)
    if not clips:
        return _without_clips(tracks, offsets, rates, told)
    clocks: dict[str, CameraClock] = {}
    notes: list[str] = []
    used = set()
    for name, track in tracks.items():
        clip, rate = clips[name], track.fps
        remedy = "correct fps in the keypoint file" if rate else "write their fps into the keypoint file"
        if not clip.rate_known and (rates.get(name) or rate):
            clip = Clip.open(clip.path, fps=rates.get(name) or rate)
            clip.close()  # its report opens it again
            used.add(name)
            if name not in rates:
                remedy = f"say the pictures' rate: --fps {name}=RATE"
                notes.append(f"{name}: the pictures have no frame rate: {rate:g}, as {track.source} declares")
        elif clip.rate_known and rate is None:
            rate = rates.get(name)
            remedy = f"say the keypoints' rate: --fps {name}=RATE"
            used.add(name)
        notes += [f"{name}: {note}" for note in clip.report.notes]
        clocks[name], of_lengths = clip_clock(name, track, clip.report, rate, offsets[name], remedy)
        notes += of_lengths
    _refuse_unused(rates, used, told)
    return clocks, notes


def _without_clips(
    tracks: Mapping[str, KeypointTrack], offsets: Mapping[str, float], rates: Mapping[str, float], told: Declared
) -> tuple[dict[str, CameraClock], list[str]]:
    _refuse_unused(rates, {name for name, track in tracks.items() if track.fps is None}, told)
    known = {name: track.fps or rates.get(name) for name, track in tracks.items()}
    usual = max((rate for rate in known.values() if rate), default=None)
    if usual is None:
        notes = [f"no frame rate in the keypoint files: {DEFAULT_FPS:g} frames per second assumed; --fps says it"]
    else:
        of_others = f"no frame rate in the keypoint file: {usual:g}, as the others have; --fps NAME=RATE says it"
        notes = [f"{name}: {of_others}" for name, rate in known.items() if not rate]
    clocks = {
        name: keypoint_clock(track.frame_count, known[name] or usual or DEFAULT_FPS, offsets[name])
        for name, track in tracks.items()
    }
    # where offsets are still to be found, lengths tell nothing
    return clocks, notes + (_lengths(tracks, clocks) if told.sync == OFF else [])


def _lengths(tracks: Mapping[str, KeypointTrack], clocks: Mapping[str, CameraClock]) -> list[str]:
    if not in_step(list(clocks.values())):
        return []
    longest = max(track.frame_count for track in tracks.values())
    return list(length_notes(tracks, longest, "say the rates: --fps NAME=RATE, or fps in the files"))


def _refuse_unused(rates: Mapping[str, float], used: set[str], told: Declared) -> None:
    """A rate that changes nothing is a misunderstanding."""
    unused = [name for name in rates if name not in used]
    if unused and (by_name(told.fps) or len(unused) == len(rates)):
        problem = f"the files of {', '.join(unused)} declare their frame rates"
        remedy = "--fps is for folders of pictures, and for keypoint files that declare none; correct fps in the file"
        raise InputError("--fps", problem, remedy=remedy)


def notes_on_time(clocks: Mapping[str, CameraClock], line: Timeline) -> list[str]:
    """How the cameras are matched, where they are not simply frame by frame."""
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
