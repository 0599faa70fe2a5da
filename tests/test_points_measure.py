"""The measure of points is right: simulated faults have the requested properties."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.points import captured_errors, laboratory, opensim_side
from benchmarks.points.captured_trials import (
    CapturedTrial,
    MarkerFaults,
    missing,
    random_person,
    spoilt,
    standing_points,
)
from benchmarks.points.four_cameras import triangulated
from benchmarks.points.tracked_points import observations_of
from estimator.data.observation import Observation
from estimator.fitting.measures import standing_pose
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import Body

NOTHING_WRONG = MarkerFaults(noise=0.0, outliers=0.0, gaps=0.0, places=0.0)


def test_a_constant_offset_is_taken_off() -> None:
    angles = np.linspace(-20.0, 40.0, 50)
    shifted = laboratory.offset(angles + 3.0, angles)
    assert shifted[:2] == pytest.approx((3.0, 0.0), abs=1e-9)
    waves = np.where(np.arange(50) % 2, 2.0, -2.0)
    assert laboratory.offset(angles + waves - 1.0, angles)[:2] == pytest.approx((-1.0, 2.0))
    assert laboratory.offset(angles + 361.0, angles)[:2] == pytest.approx((1.0, 0.0), abs=1e-9)
    assert laboratory.pooled([(9.0, 3.0), (-9.0, 4.0)]) == pytest.approx(np.sqrt(12.5))


def test_gaps_have_the_requested_share_and_come_in_bursts() -> None:
    faults = MarkerFaults()
    gone = missing(np.random.default_rng(0), 200, 39, faults)
    assert gone.sum(axis=0).tolist() == [20] * 39
    begins = np.diff(gone.astype(int), axis=0) == 1
    assert begins.sum() < 0.5 * gone.sum()


def test_noise_and_outliers_have_the_requested_size() -> None:
    faults = MarkerFaults(gaps=0.0)
    off = spoilt(np.zeros((400, 39, 3)), np.random.default_rng(0), faults)
    far = np.linalg.norm(off, axis=2) > 5.0 * faults.noise
    assert far.mean() == pytest.approx(faults.outliers, abs=0.01)
    assert off[~far].std() == pytest.approx(faults.noise, rel=0.1)


def test_places_are_off_by_the_requested_amount() -> None:
    rng = np.random.default_rng(0)
    true, moved = random_person(np.random.default_rng(1), 0.0), random_person(rng, 0.01)
    assert len(true.markers) == len(moved.markers) == 39
    assert captured_errors.length_errors(Body(true), Body(true)) == pytest.approx(0.0)
    assert np.abs(captured_errors.length_errors(Body(true), Body(moved))).max() > 1.0


def test_a_trial_without_faults_has_its_markers_where_the_body_has_them(tmp_path: Path) -> None:
    person = random_person(np.random.default_rng(0), 0.01)
    body, time = Body(person), np.arange(3) / 60.0
    q = np.array([body.integrate(body.neutral, np.full(body.nv, 0.01 * t)) for t in range(3)])
    points = spoilt(body.markers_of(body.placed(q)), np.random.default_rng(0), NOTHING_WRONG)
    trial = CapturedTrial(person, q, body.marker_names, time, points)
    tracked, observations = observations_of(person, trial.write(tmp_path / "trial.trc"))
    assert tracked.marker_names == trial.names
    seen = np.array([o.markers for o in observations])
    assert seen == pytest.approx(tracked.markers_of(tracked.placed(q)), abs=1e-6)
    assert captured_errors.angle_errors(q, q).shape == (3, body.nv - 6)


def test_the_static_trial_is_held_within_the_requested_deviation() -> None:
    body = Body(random_person(np.random.default_rng(0), 0.01))
    upright = body.markers_of(body.placed(standing_pose(body, body.neutral)[None]))[0]
    rng = np.random.default_rng(0)
    assert standing_points(body, rng, NOTHING_WRONG) is None
    still, loose = (standing_points(body, rng, replace(NOTHING_WRONG, standing=degrees)) for degrees in (0.0, 3.0))
    assert still is not None
    assert loose is not None
    assert still == pytest.approx(np.tile(upright, (60, 1, 1)), abs=1e-9)
    assert np.ptp(loose, axis=0) == pytest.approx(0.0, abs=1e-9)
    assert 0.002 < np.linalg.norm(loose[0] - upright, axis=1).max() < 0.3


def test_weights_count() -> None:
    apart = np.array([[3.0, 4.0], [3.0, np.nan]])
    assert opensim_side.weighted_rms(apart, np.array([1.0, 0.0])) == pytest.approx(3.0)
    assert opensim_side.weighted_rms(apart, np.array([1.0, 2.0])) == pytest.approx(np.sqrt((9 + 9 + 32) / 4))


def test_rays_meet_where_the_points_are() -> None:
    points = np.random.default_rng(0).normal(0.0, 0.3, (5, 3)) + np.array([0.0, 0.0, 1.0])
    cameras = framing_cameras(points[None], ViewSettings(count=4))
    pixels = np.array([camera.project(points) for camera in cameras])
    confidence = np.ones(pixels.shape[:2])
    confidence[1:, 0] = 0.0  # a single view
    pixels[0, 1] += 80.0  # one view is wrong
    places = triangulated(Observation(0, 0.0, cameras, pixels, confidence), 20.0)
    assert np.isnan(places[0]).all()
    assert places[1:] == pytest.approx(points[1:], abs=1e-6)
