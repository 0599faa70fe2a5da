"""The measure of gait events is right: known differences, known noise, a captured walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.captured_steps import LASTS, NOISE, captured_errors, lasting
from benchmarks.accuracy.gait_events import EventErrors, loaded_events
from benchmarks.support.mocap_person import FPS
from estimator.runs.events import Event, Side


def strikes(side: Side, *times: float) -> list[Event]:
    return [Event(side, "strike", t, 0) for t in times]


def test_known_differences() -> None:
    truth = strikes("left", 0.05, 1.0, 2.0, 3.0) + strikes("right", 1.5)
    ours = [*strikes("left", 0.9, 2.05, 4.0), *strikes("right", 1.49, 3.0), Event("left", "off", 3.0, 0)]
    errors = EventErrors.of(ours, truth, "strike", (0.0, 5.0))
    np.testing.assert_allclose(errors.off, [-0.1, 0.05, np.nan, -0.01])  # the event at the clip's end does not count
    assert errors.extra == 2
    assert errors.within == 0.5
    twice = EventErrors.joined([errors, errors])
    assert (len(twice.off), twice.extra) == (8, 4)
    assert errors.cells() == ("4", "-20", "53", "50.0%", "1", "2")


def test_loads_are_events_between_frames() -> None:
    loaded = {"left": np.array([0, 1, 1, 0], bool), "right": np.array([1, 1, 1, 1], bool)}
    events = loaded_events(np.arange(4) * 0.1, loaded)
    assert [(e.side, e.kind, round(e.time, 6)) for e in events] == [("left", "strike", 0.05), ("left", "off", 0.25)]


def test_noise_has_the_stated_size_and_duration() -> None:
    noise = lasting((20000, 3), np.random.default_rng(0))
    assert noise.std() == pytest.approx(NOISE, rel=0.03)
    frames = round(LASTS * FPS)
    assert np.mean(noise[:-frames] * noise[frames:]) / noise.var() == pytest.approx(np.exp(-1.0), abs=0.03)


def test_a_captured_walk_keeps_its_events(shared_data: Path) -> None:
    errors = captured_errors(shared_data / "mocap" / "walk_straight_07_01.bvh", (0, 1))
    for kind in ("strike", "off"):
        assert len(errors["gait", kind].off) >= 8
        assert errors["gait", kind].within >= 0.95
        assert errors["gait", kind].extra == 0
