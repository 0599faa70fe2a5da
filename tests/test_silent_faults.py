"""Planted faults change what they should, and verdicts follow from errors, statuses and warnings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness import keypoint_faults, point_faults, source_faults
from benchmarks.robustness.fault_verdicts import Result, Trial, outcome_of
from benchmarks.robustness.place_faults import Fault, Places, name_of, with_fault
from humanoid.support.errors import InputError
from tests.builders import body_of

SPATIAL = dict.fromkeys((*point_faults.FAULTS, *source_faults.FAULTS))


def places_of(axes: int) -> Places:
    """A person who moves away, with noise, far from zero."""
    body, rng = body_of("human34"), np.random.default_rng(2)
    points = body.landmarks(body.at(body.neutral))[:, :axes] + 0.02 * np.arange(30.0)[:, None, None] + 1.0
    return Places(points + 0.003 * rng.normal(size=points.shape), body.landmark_names)


@pytest.mark.parametrize(
    ("fault", "axes"),
    [*((fault, 3) for fault in SPATIAL), *((fault, 2) for fault in keypoint_faults.FAULTS)],
    ids=lambda value: name_of(value) if callable(value) else str(value),
)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_fault_changes_a_copy(fault: Fault, axes: int, seed: int) -> None:
    places = places_of(axes)
    before = places.at.copy()
    wrong = with_fault(places, fault, np.random.default_rng(seed))
    np.testing.assert_array_equal(places.at, before)
    assert wrong.at.shape == before.shape
    assert not np.array_equal(wrong.at, before)
    again = with_fault(places, fault, np.random.default_rng(seed))
    np.testing.assert_array_equal(again.at, wrong.at)


def result(error: float, hard: int = 0, notes: tuple[str, ...] = ("p.npz: unit m",)) -> Result:
    """Ten frames, three joints, the last never observed; the hard frames are far off."""
    errors, tracked = np.full((10, 3), error), np.arange(10) >= hard
    errors[~tracked], errors[:, 2] = 90.0, 45.0
    return Result(errors, tracked, np.array([True, True, False]), notes)


@pytest.mark.parametrize(
    ("faulty", "verdict"),
    [
        (result(1.15), "right"),
        (result(1.15, hard=3), "hard"),
        (result(1.5, hard=3), "silent"),
        (result(1.5, notes=("p.npz: unit m", "p.npz: 3 points at exactly zero")), "noted"),
        (result(1.5, notes=("p.npz: unit cm", "joints that rest on a limit in most frames: knee")), "noted"),
        (result(1.5, notes=("q.npz: unit m", "joints that rest on a limit in most frames: knee")), "silent"),
        (None, "refused"),
    ],
)
def test_verdicts(faulty: Result | None, verdict: str, tmp_path: Path) -> None:
    def run(_: Path) -> Result:
        if faulty is None:
            raise InputError("p.npz", "has impossible limbs")
        return faulty

    outcome = outcome_of(Trial("points", lambda _: result(1.0), run), "zeros", "walks", tmp_path)
    assert outcome.verdict == verdict
    if faulty is not None:
        assert outcome.faultless == pytest.approx(1.0)
        assert outcome.error == pytest.approx(faulty.errors[-1, 0])
