"""Frame rates given for films: to which clock they apply, and how the films' own times change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.clip import ClipReport
from humanoid.support.errors import InputError
from kinemode.inputs.clocks import keypoint_rate, of_keypoints, report_at

FILM = Path("film.mp4")


def film(intervals: np.ndarray) -> ClipReport:
    times = np.concatenate([[0.0], np.cumsum(intervals)])
    return ClipReport(len(times), len(times), times, (len(times) - 1) / times[-1], ())


def keypoints(count: int, rate: float | None) -> KeypointTrack:
    return KeypointTrack("none", (), np.zeros((count, 0, 2)), np.zeros((count, 0)), None, rate)


@pytest.mark.parametrize(("own", "given"), [(30.0, 120.0), (25.0, 100.0), (60.0, 59.94), (30.0, 29.85)])
def test_even_times_become_those_of_the_given_rate(own: float, given: float) -> None:
    report, note = report_at(FILM, film(np.full(80, 1.0 / own)), given)
    np.testing.assert_allclose(report.times, np.arange(81) / given)
    assert report.fps == given
    assert f"{given:g} is used instead" in note


@pytest.mark.parametrize(("own", "given"), [(30000.0 / 1001.0, 29.97), (24000.0 / 1001.0, 23.98), (50.0, 50.0)])
def test_a_rate_that_is_the_films_changes_no_bit(own: float, given: float) -> None:
    report = film(np.full(40, 1.0 / own))
    assert report_at(FILM, report, given) == (report, "")


def test_dropped_frames_stay_dropped() -> None:
    intervals = np.full(90, 1.0 / 30.0)
    intervals[[20, 50]] *= [2.0, 4.0]
    report = film(intervals)
    slow, note = report_at(FILM, report, 240.0)
    np.testing.assert_allclose(slow.times, report.times / 8.0)
    assert "has 30 frames per second: 240 is used" in note
    assert report_at(FILM, report, 30.0) == (report, "")  # the usual interval's rate, not the mean


@pytest.mark.parametrize(("fast", "share"), [(240.0, 0.5), (120.0, 0.2)])
def test_a_film_that_is_slow_in_a_part_has_no_one_rate(fast: float, share: float) -> None:
    parts = [np.full(round(100 * share), 1.0 / fast), np.full(round(100 * (1.0 - share)), 1.0 / 30.0)]
    with pytest.raises(InputError, match=r"--fps 240: has frames \d to 33 ms apart.*leave --fps out"):
        report_at(FILM, film(np.concatenate(parts)), 240.0)


def test_the_number_of_keypoint_frames_decides_whose_rate_it_is() -> None:
    report = film(np.full(119, 1.0 / 30.0))
    assert not of_keypoints(120, report, 15.0)  # one for each picture: the pictures' rate
    assert of_keypoints(60, report, 15.0)
    assert of_keypoints(52, report, 15.0)  # they end early
    assert of_keypoints(240, report, 60.0)
    assert not of_keypoints(110, report, 120.0)
    assert not of_keypoints(30, report, 120.0)


def test_a_declared_rate_belongs_to_the_clock_that_matches_its_frame_count() -> None:
    own = film(np.full(119, 1.0 / 30.0))
    slow, _ = report_at(FILM, own, 120.0)
    assert keypoint_rate(keypoints(120, None), own, slow) is None
    assert keypoint_rate(keypoints(90, 30.0), own, slow) == pytest.approx(120.0)  # the film's rate, copied
    assert keypoint_rate(keypoints(60, 15.0), own, slow) == pytest.approx(60.0)  # every second frame of the film
    assert keypoint_rate(keypoints(60, 60.0), own, slow) == 60.0  # every second frame, by the true clock
    assert keypoint_rate(keypoints(120, 120.0), own, slow) == 120.0
    assert keypoint_rate(keypoints(60, 15.0), own, own) == 15.0
