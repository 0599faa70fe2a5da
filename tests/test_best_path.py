"""The best trajectory through kept modes, and the motion prior."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.inference.best_path import best_path, path_weights
from estimator.inference.motion import MotionPrior
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult, backtrack_results
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run
from estimator.tracking.smoothing import smooth_track
from estimator.tracking.smoothing.chain import FrameChain
from humanoid.kinematics.body import Body

FPS = 25.0
CAMERA = camera_at(15.0, distance=3.5)


def energy_of(body: Body, q: np.ndarray, times: np.ndarray, motion: MotionPrior) -> float:
    """Of the motion along poses (T, nq), term by term as the prior is defined."""
    v = [body.difference(a, b) / dt for a, b, dt in zip(q, q[1:], np.diff(times), strict=False)]
    gaps, spans = np.diff(times), [(c - a) / 2.0 for a, c in zip(times, times[2:], strict=False)]
    a = [(after - before) / span for before, after, span in zip(v, v[1:], spans, strict=False)]
    if motion.memory > 0.0:
        left = [np.exp(-span / motion.memory) for span in spans[1:]]
        a = a[:1] + [(y - f * x) / np.sqrt(1.0 - f * f) for x, y, f in zip(a, a[1:], left, strict=False)]
    if motion.pace is not None:
        a = [x / pace for x, pace in zip(a, motion.pace[1:], strict=False)]
    share = lambda dt: min(1.0, dt / motion.correlation)  # noqa: E731
    lorentzian = lambda e: 0.5 * motion.nu * np.log1p(np.square(e) / motion.nu).sum()  # noqa: E731
    return float(
        sum(share(dt) * lorentzian(x / motion.velocity_std) for x, dt in zip(v, gaps, strict=True))
        + sum(share(dt) * lorentzian(x / motion.acceleration_std) for x, dt in zip(a, spans, strict=True))
    )


@pytest.mark.parametrize("seed", range(6))
def test_no_other_path_has_less_energy(seed: int) -> None:
    """Against all possible paths, with uneven times and numbers of modes."""
    body, rng = body_of("arm8"), np.random.default_rng(seed)
    counts = [3, 2, 4, 1, 3]
    q = [np.array([body.integrate(body.neutral, rng.normal(0.0, 0.3, body.nv)) for _ in range(k)]) for k in counts]
    energy = [rng.normal(0.0, 4.0, k) for k in counts]
    times = np.cumsum(rng.uniform(0.02, 0.1, len(counts)))
    motion = MotionPrior(np.full(body.nv, 6.0), np.full(body.nv, 10.0), 5.0, 0.06)
    every = {
        path: sum(e[k] for e, k in zip(energy, path, strict=True))
        + energy_of(body, np.array([m[k] for m, k in zip(q, path, strict=True)]), times, motion)
        for path in product(*(range(k) for k in counts))
    }
    assert tuple(best_path(body, q, energy, times, motion)) == min(every, key=lambda path: every[path])
    share = {path: np.exp(min(every.values()) - value) for path, value in every.items()}
    for t, weight in enumerate(path_weights(body, q, energy, times, motion)):
        through = [sum(s for path, s in share.items() if path[t] == k) for k in range(counts[t])]
        np.testing.assert_allclose(weight, np.array(through) / sum(share.values()), atol=1e-12)


@pytest.mark.parametrize("memory", [0.0, 0.12])
@pytest.mark.parametrize("paced", [False, True])
def test_smoothing_has_the_same_energy_of_motion(memory: float, paced: bool) -> None:
    body, rng = body_of("human34"), np.random.default_rng(7)
    q = np.array([random_pose(body, rng) for _ in range(5)])
    times = np.cumsum(rng.uniform(0.02, 0.1, len(q)))
    pace = rng.uniform(0.5, 2.0, (len(q), body.nv)) if paced else None
    motion = MotionPrior(np.full(body.nv, 6.0), np.full(body.nv, 10.0), 5.0, 0.06, memory, pace)
    chain = FrameChain(body, [Cost(body, [])] * len(q), times, motion, 1e-3)
    assert chain.energy(q) == pytest.approx(energy_of(body, q, times, motion), rel=1e-9)


def test_a_movement_costs_as_much_by_a_faster_camera() -> None:
    body, motion = body_of("human34"), MotionPrior(np.full(34, 6.0), np.full(34, 10.0), 5.0, 0.06)

    def cost_at(fps: float) -> float:
        times = np.arange(0.0, 1.0, 1.0 / fps)
        return energy_of(body, np.array([swing(body, t) for t in times]), times, motion)

    assert cost_at(200.0) == pytest.approx(cost_at(50.0), rel=0.05)


def test_one_frame_and_two() -> None:
    body = body_of("arm8")
    near, far = body.neutral, body.integrate(body.neutral, np.full(body.nv, 0.5))
    motion = MotionPrior(np.full(body.nv, 1.0), np.full(body.nv, 1.0))
    path = best_path(body, [np.array([near, far])], [np.array([1.0, 0.0])], np.zeros(1), motion)
    assert path.tolist() == [1]
    (weight,) = path_weights(body, [np.array([near, far])], [np.array([1.0, 0.0])], np.zeros(1), motion)
    np.testing.assert_allclose(weight, np.exp([-1.0, 0.0]) / (1.0 + np.exp(-1.0)))
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


def test_smoothing_leaves_a_path_that_the_filter_got_wrong(
    track: tuple[ModeSearch, list[Observation], list[FrameResult], np.ndarray],
) -> None:
    """A last frame whose weights favour a far-fetched mode misleads the way back through the parents, not this one."""
    search, seen, results, truth = track
    body, last = search.body, results[-1]
    wrong = int(np.argmax([error(body, q[None], truth[-1:]) for q in last.q]))
    misled = [*results[:-1], replace(last, weight=np.eye(len(last.weight))[wrong])]
    assert backtrack_results(misled)[-1] == wrong
    off = error(body, smooth_track(search, seen, results).q, truth)
    assert off < 0.05
    assert error(body, smooth_track(search, seen, misled).q, truth) == pytest.approx(off, rel=0.05)
