"""The best trajectory through kept modes, the motion prior, and smoothing behind a live track."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from builders import body_of, camera_at, observe

from estimator.imaging.observation import Observation
from estimator.modes.best_path import best_path
from estimator.modes.motion import MotionPrior
from estimator.search.mode_search import ModeSearch
from estimator.smoothing import FixedLag, SmoothSettings, smooth_track
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.paths import backtrack_results
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body

FPS = 25.0
CAMERA = camera_at(15.0, distance=3.5)


def energy_of(body: Body, q: np.ndarray, times: np.ndarray, motion: MotionPrior) -> float:
    """Of the motion along poses (T, nq), term by term as the prior is defined."""
    v = [body.difference(a, b) / dt for a, b, dt in zip(q, q[1:], np.diff(times), strict=False)]
    spans = [(c - a) / 2.0 for a, c in zip(times, times[2:], strict=False)]
    a = [(after - before) / span for before, after, span in zip(v, v[1:], spans, strict=False)]
    lorentzian = lambda e: 0.5 * motion.nu * np.log1p(np.square(e) / motion.nu).sum()  # noqa: E731
    return float(
        sum(lorentzian(x / motion.velocity_std) for x in v) + sum(lorentzian(x / motion.acceleration_std) for x in a)
    )


@pytest.mark.parametrize("seed", range(6))
def test_no_other_path_has_less_energy(seed: int) -> None:
    """Against every path there is, with uneven times and numbers of modes."""
    body, rng = body_of("arm8"), np.random.default_rng(seed)
    counts = [3, 2, 4, 1, 3]
    q = [np.array([body.integrate(body.neutral, rng.normal(0.0, 0.3, body.nv)) for _ in range(k)]) for k in counts]
    energy = [rng.normal(0.0, 4.0, k) for k in counts]
    times = np.cumsum(rng.uniform(0.02, 0.1, len(counts)))
    motion = MotionPrior(np.full(body.nv, 6.0), np.full(body.nv, 10.0))
    every = {
        path: sum(e[k] for e, k in zip(energy, path, strict=True))
        + energy_of(body, np.array([m[k] for m, k in zip(q, path, strict=True)]), times, motion)
        for path in product(*(range(k) for k in counts))
    }
    assert tuple(best_path(body, q, energy, times, motion)) == min(every, key=lambda path: every[path])


def test_one_frame_and_two() -> None:
    body = body_of("arm8")
    near, far = body.neutral, body.integrate(body.neutral, np.full(body.nv, 0.5))
    motion = MotionPrior(np.full(body.nv, 1.0), np.full(body.nv, 1.0))
    one = best_path(body, [np.array([near, far])], [np.array([1.0, 0.0])], np.zeros(1), motion)
    assert one.tolist() == [1]
    two = [np.array([near, far]), np.array([far, near])]
    energy = [np.array([0.0, 9.0]), np.array([0.0, 0.1])]
    assert best_path(body, two, energy, np.array([0.0, 0.04]), motion).tolist() == [0, 1]


def swing(body: Body, t: float) -> np.ndarray:
    q = body.neutral.copy()
    q[body.q_names.index("left_shoulder_elevation")] += 0.7 * (1.0 - np.cos(2.5 * t))
    q[body.q_names.index("right_elbow_flexion")] += 0.5 * (1.0 - np.cos(3.0 * t))
    return body.integrate(q, np.r_[np.zeros(5), 0.4 * t, np.zeros(body.nv - 6)])


@pytest.fixture(scope="module")
def track() -> tuple[ModeSearch, list[Observation], list[FrameResult], np.ndarray]:
    body, rng = body_of("human34"), np.random.default_rng(3)
    truth = np.array([swing(body, i / FPS) for i in range(16)])
    seen = [observe(body, q, (CAMERA,), noise=3.0, rng=rng, index=i, time=i / FPS) for i, q in enumerate(truth)]
    tracker = make_tracker("css", body)
    return tracker.search, seen, [r for r, _ in run(tracker, seen, 0)], truth


def error(body: Body, q: np.ndarray, truth: np.ndarray) -> float:
    points = [np.array([body.landmarks(body.at(x)) for x in poses]) for poses in (q, truth)]
    return float(np.linalg.norm(points[0] - points[1], axis=2).mean())


def test_a_lag_gives_every_frame_once_and_lies_between_filter_and_smoother(
    track: tuple[ModeSearch, list[Observation], list[FrameResult], np.ndarray],
) -> None:
    search, seen, results, truth = track
    body, lag = search.body, FixedLag(search, SmoothSettings(lag=5))
    given: list[tuple[int, np.ndarray]] = []
    for k, (observation, result) in enumerate(zip(seen, results, strict=True)):
        now = lag.push(observation, result)
        assert [i for i, _ in now] == ([k - 5] if k >= 5 else [])
        given += now
    given += lag.flush()
    assert [i for i, _ in given] == list(range(len(seen)))
    q = np.array([pose for _, pose in given])
    assert np.all(q >= body.lower)
    assert np.all(q <= body.upper)
    filtered = error(body, np.array([r.q[0] for r in results]), truth)
    assert error(body, q, truth) < filtered
    jerk = [np.abs(np.diff(poses[:, 7:], 3, axis=0)).mean() for poses in (q, np.array([r.q[0] for r in results]))]
    assert jerk[0] < 0.6 * jerk[1]


def test_what_has_been_given_out_does_not_depend_on_what_comes(
    track: tuple[ModeSearch, list[Observation], list[FrameResult], np.ndarray],
) -> None:
    search, seen, results, _ = track
    whole, part = FixedLag(search, SmoothSettings(lag=3)), FixedLag(search, SmoothSettings(lag=3))
    all_given = [g for o, r in zip(seen, results, strict=True) for g in whole.push(o, r)]
    given = [g for o, r in zip(seen[:9], results[:9], strict=True) for g in part.push(o, r)]
    assert len(given) == 6
    assert all(i == j and np.array_equal(p, q) for (i, p), (j, q) in zip(given, all_given, strict=False))


def test_frames_without_hypotheses_are_left_out(
    track: tuple[ModeSearch, list[Observation], list[FrameResult], np.ndarray],
) -> None:
    search, seen, results, _ = track
    r = results[0]
    none = replace(r, q=r.q[:0], weight=r.weight[:0], energy=r.energy[:0], parent=r.parent[:0], association=())
    lag = FixedLag(search, SmoothSettings(lag=1))
    assert lag.push(seen[0], none) == []
    assert lag.flush() == []


def test_smoothing_leaves_a_path_that_the_filter_got_wrong(
    track: tuple[ModeSearch, list[Observation], list[FrameResult], np.ndarray],
) -> None:
    """A last frame whose weights favour a far-fetched mode misleads the way back through the parents, not this one."""
    search, seen, results, truth = track
    body, last = search.body, results[-1]
    wrong = int(np.argmax([error(body, q[None], truth[-1:]) for q in last.q]))
    misled = [*results[:-1], replace(last, weight=np.eye(len(last.weight))[wrong])]
    assert backtrack_results(misled)[-1] == wrong
    q = smooth_track(search, seen, misled)
    assert error(body, q, truth) == pytest.approx(error(body, smooth_track(search, seen, results), truth), rel=0.05)
