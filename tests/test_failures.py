"""The failure table: every tracker gets CSS's time, and what is said of them is so."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.failure_runs import CSS, Attempt, Race, css_run, own_size, race, resized, size_for
from benchmarks.failures import PAPER, verdict
from benchmarks.scores import TRAJECTORIES, Outcome, TrackErrors
from benchmarks.sequences import FPS, Task
from estimator.tracking.registry import TRACKERS


def attempt(tracker: str, mean: float, lost: int | None = None) -> Attempt:
    errors = TrackErrors(mean, mean, 1.0, lost, mean, mean)
    return Attempt(tracker, None, 0.1, 1.0, 10, Outcome(dict.fromkeys(TRAJECTORIES, errors), 10.0, ()))


def test_time_grows_in_a_straight_line() -> None:
    def seconds(size: int) -> float:
        return 0.02 + 0.003 * size

    assert size_for(seconds(70), [10, 40], [seconds(10), seconds(40)]) == 70
    assert size_for(seconds(70), [10, 90], [seconds(10), seconds(90)]) == 70
    assert size_for(0.01, [10, 40], [seconds(10), seconds(40)]) == 1  # cheaper than any
    assert size_for(0.4, [10, 40], [0.1, 0.1]) == 160  # too quick to tell: in proportion
    assert size_for(0.4, [10, 40], [0.1, 0.1001]) == 480  # nearly so


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_tracker_is_given_its_size(tracker: str) -> None:
    changes = {"css": {"modes": 3}}
    own = own_size(tracker, changes)
    assert (own is None) == (TRACKERS[tracker].group == "single_mode")
    if own is not None:
        assert own_size(tracker, resized(tracker, changes, own + 1)) == own + 1
    assert changes == {"css": {"modes": 3}}


def test_the_paper_is_about_known_trackers_and_sequences() -> None:
    assert {tracker for _, tracker in PAPER} <= set(TRACKERS)
    assert {motion for motion, _ in PAPER} == set(FPS)


def test_the_verdict() -> None:
    css, near, far = attempt(CSS, 30.0), attempt("condensation", 29.0), attempt("annealed", 80.0, lost=4)
    assert "final: none; filtered: none" in verdict([css, far, attempt("css-paper", 1.0)])
    assert "final: condensation; filtered: condensation" in verdict([css, near, far])
    assert verdict([css, near, far]).endswith("to the end: css, condensation")
    assert "annealed" in verdict([css, replace(attempt("annealed", math.nan))])  # unknown is not further away


def test_a_short_race(tmp_path: Path) -> None:
    how = {"cues": "off", "seed": 0, "modes": 2, "settings": {"css": {"samples": 2, "jumps": 0}}}
    task = Task("arm", 1, 0.24, False, tmp_path, how, detected=True)
    clip, css = css_run(task)
    assert css.times == 1.0
    assert css.frames == 6
    single = race(Race(task, clip, "single-mode", css.cpu, 4))
    assert single.size is None
    assert single.times == pytest.approx(single.cpu / css.cpu)
    budget = 5.0 * css.cpu
    rival = race(Race(task, clip, "condensation", budget, 4))
    assert rival.size is not None
    assert rival.outcome.errors["filtered"].mean < 250.0
    assert rival.times == pytest.approx(rival.cpu / budget)
