"""Smoothing over a whole clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import body_of, camera_at, observe

from estimator.energy.cost import Cost
from estimator.search.cost_model import CostModel
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run
from estimator.tracking.smoothing import SmoothSettings, clip, smooth, smooth_track
from estimator.tracking.smoothing.pace import pace_of
from humanoid.kinematics.body import Body

FPS = 30.0
CAMERA = camera_at(15.0, distance=3.5, distortion=(0.0,) * 5)


def swing(body: Body, t: float) -> np.ndarray:
    """A smooth motion: the left arm rises and the root turns."""
    q = body.neutral.copy()
    q[body.q_names.index("left_shoulder_elevation")] += 0.8 * (1.0 - np.cos(2.0 * t))
    q[body.q_names.index("right_elbow_flexion")] += 0.5 * (1.0 - np.cos(3.0 * t))
    return body.integrate(q, np.r_[np.zeros(5), 0.3 * t, np.zeros(body.nv - 6)])


def noisy(body: Body, count: int, sigma: float) -> tuple[list[Cost], np.ndarray, np.ndarray]:
    """Costs of noisy frames, times, and the true motion."""
    rng, model = np.random.default_rng(5), CostModel(body)
    times = np.arange(count) / FPS
    truth = np.array([swing(body, t) for t in times])
    seen = [observe(body, q, (CAMERA,), noise=sigma, rng=rng, index=i, time=i / FPS) for i, q in enumerate(truth)]
    return [model.cost(model.observation_term(o)) for o in seen], times, truth


def points(body: Body, q: np.ndarray) -> np.ndarray:
    return np.array([body.landmarks(body.at(x)) for x in q])


def test_smoothing_brings_noisy_poses_nearer_to_a_smooth_truth() -> None:
    body = body_of("human34")
    costs, times, truth = noisy(body, 30, 3.0)
    rng = np.random.default_rng(6)
    start = np.array([body.integrate(q, rng.normal(scale=0.08, size=body.nv)) for q in truth])
    smoothed = smooth(body, costs, times, start, SmoothSettings().motion(CostModel(body)))
    before, after = (np.linalg.norm(points(body, q) - points(body, truth), axis=2).mean() for q in (start, smoothed))
    assert after < 0.6 * before
    assert np.all(smoothed >= body.lower)
    assert np.all(smoothed <= body.upper)
    jerk = [np.abs(np.diff(points(body, q), 2, axis=0)).mean() for q in (start, smoothed)]
    assert jerk[1] < 0.2 * jerk[0]


def test_the_window_does_not_matter_much() -> None:
    """Windows overlap by half, so short ones end near where one long one does."""
    body = body_of("human34")
    costs, times, truth = noisy(body, 40, 2.0)
    motion = SmoothSettings().motion(CostModel(body))
    whole = smooth(body, costs, times, truth, motion)
    parts = smooth(body, costs, times, truth, motion, SmoothSettings(window=28))
    assert np.linalg.norm(points(body, whole) - points(body, parts), axis=2).mean() < 0.01
    assert np.linalg.norm(points(body, whole) - points(body, truth), axis=2).mean() > 0.005


@pytest.mark.parametrize(("apart", "times"), [(0.02, 3), (None, 6)])
def test_paths_that_come_to_the_same_poses_are_smoothed_once(
    monkeypatch: pytest.MonkeyPatch, apart: float | None, times: int
) -> None:
    """Two modes of each frame: the second near the first, or in the other reading of left and right."""
    body, rng = body_of("human34"), np.random.default_rng(7)
    seen = [observe(body, swing(body, i / FPS), (CAMERA,), noise=2.0, rng=rng, index=i, time=i / FPS) for i in range(8)]
    tracker, paced = make_tracker("css", body), list[int]()
    results = [result for result, _ in run(tracker, seen, 0)]
    other = "exchanged" if apart is None else "as_detected"
    moved = [body.integrate(r.q[0], (apart or 0.0) * rng.normal(size=body.nv)) for r in results]
    names, parent = ("as_detected", other), np.array([0, 1])
    doubled = [
        replace(r, q=np.array([r.q[0], q]), weight=np.array([0.6, 0.4]), association=names, parent=parent)
        for r, q in zip(results, moved, strict=True)
    ]
    monkeypatch.setattr(clip, "best_path", lambda *_: np.ones(8, dtype=int))
    monkeypatch.setattr(clip, "pace_of", lambda *a, **k: paced.append(1) or pace_of(*a, **k))
    smooth_track(tracker.search, seen, doubled)
    assert len(paced) == times


def test_frames_without_hypotheses_stay_empty_and_the_rest_is_smoothed() -> None:
    body = body_of("human34")
    rng = np.random.default_rng(7)
    seen = [observe(body, swing(body, i / FPS), (CAMERA,), noise=2.0, rng=rng, index=i, time=i / FPS) for i in range(8)]
    for i in (0, 4):
        seen[i].confidence[:] = 0.0
    tracker = make_tracker("css", body)
    results = [result for result, _ in run(tracker, seen, 0)]
    q = smooth_track(tracker.search, seen, results).q
    assert np.isnan(q[0]).all()
    assert np.isfinite(q[1:]).all()
    assert np.array_equal(q[1:], smooth_track(tracker.search, seen, results).q[1:])
