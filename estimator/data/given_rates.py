"""A frame rate that the user gives for a film that declares another, as of slow motion: whose it is, and the times."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.clip import ClipReport
from humanoid.support.errors import InputError

_AS_WRITTEN = 2e-4  # rates this close are one rate, written with fewer digits: 23.98 for 24000/1001
_ABOUT = 0.05  # a film of uneven times has its given rate where it is this close to the usual one
_VARIES = 1.5  # longest interval over the shortest of a film of uneven times
_SHORT, _LONG = 0.5, 2.5  # of the usual interval: what is between may be late, or follow a frame that was dropped
_FEW = 0.1  # share of the intervals that may be outside
_FRAMES, _SHARE = 2, 0.02  # by which a number of keypoints may differ from what their rate makes of the film's length


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
        problem = f"has frames {1e3 * intervals.min():.0f} to {1e3 * intervals.max():.0f} ms apart, not of one rate"
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
