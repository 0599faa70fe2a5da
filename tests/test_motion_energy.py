"""The motion prior's energy along poses: its gradient and its Hessian."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of, random_pose

from estimator.inference.motion import MotionPrior
from estimator.tracking.smoothing.motion_energy import MotionEnergy
from humanoid.kinematics.body import Body

COUNT = 6


def motion_of(body: Body, memory: float, count: int = COUNT) -> MotionEnergy:
    rng = np.random.default_rng(4)
    pace = rng.uniform(0.5, 2.0, (count, body.nv))
    prior = MotionPrior(rng.uniform(1.0, 4.0, body.nv), rng.uniform(5.0, 20.0, body.nv), 6.0, 0.05, memory, pace)
    return MotionEnergy(body, prior, rng.uniform(0.02, 0.06, count - 1))


def model_at(motion: MotionEnergy, body: Body, q: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    gradient, blocks = np.zeros((len(q), body.nv)), np.zeros((4, len(q), body.nv, body.nv))
    return motion.add(q, gradient, blocks), gradient, blocks


@pytest.mark.parametrize("memory", [0.0, 0.12])
@pytest.mark.parametrize("name", ["human34", "arm8"])
def test_gradient_and_hessian_are_differences(name: str, memory: float) -> None:
    """At rest the Gauss-Newton Hessian is the exact one."""
    body, rng, step = body_of(name), np.random.default_rng(5), 1e-6
    motion, still = motion_of(body, memory), np.tile(random_pose(body, rng), (COUNT, 1))
    moved = np.array([body.integrate(pose, 0.05 * rng.normal(size=body.nv)) for pose in still])
    _, gradient, _ = model_at(motion, body, moved)
    _, _, blocks = model_at(motion, body, still)
    for t, i in [(0, 0), (1, 4), (2, body.nv - 1), (3, 5), (5, 2)]:
        away = np.zeros(body.nv)
        away[i] = step

        def shifted(q: np.ndarray, by: np.ndarray, t: int = t) -> tuple[float, np.ndarray, np.ndarray]:
            other = q.copy()
            other[t] = body.integrate(q[t], by)
            return model_at(motion, body, other)

        slope = (shifted(moved, away)[0] - shifted(moved, -away)[0]) / (2.0 * step)
        assert slope == pytest.approx(gradient[t, i], rel=1e-5, abs=1e-4)
        bend = (shifted(still, away)[1] - shifted(still, -away)[1]) / (2.0 * step)
        for s in range(COUNT):
            row = blocks[abs(s - t), min(s, t)] if abs(s - t) < 4 else np.zeros((body.nv, body.nv))
            own = row[:, i] if s <= t else row[i]
            np.testing.assert_allclose(own, bend[s], rtol=1e-4, atol=1e-7 * np.abs(blocks).max())


@pytest.mark.parametrize("memory", [0.0, 0.12])
def test_the_exact_hessian_is_that_of_the_potential(memory: float) -> None:
    """For joints with additive steps; fast movements have negative curvature."""
    body, rng, step = body_of("arm8"), np.random.default_rng(6), 1e-6
    motion = motion_of(body, memory)
    q = np.array([body.neutral + 0.2 * rng.normal(size=body.nv) for _ in range(COUNT)])

    def gradient_at(poses: np.ndarray) -> np.ndarray:
        return model_at(motion, body, poses)[1]

    blocks = np.zeros((4, COUNT, body.nv, body.nv))
    motion.add(q, np.zeros((COUNT, body.nv)), blocks, exact=True)
    assert blocks[0].diagonal(axis1=1, axis2=2).min() < 0.0
    for t, i in [(0, 0), (2, 3), (5, 7)]:
        away = np.zeros_like(q)
        away[t, i] = step
        bend = (gradient_at(q + away) - gradient_at(q - away)) / (2.0 * step)
        for s in range(t, min(COUNT, t + 4)):
            np.testing.assert_allclose(blocks[s - t, t, i], bend[s], rtol=1e-5, atol=1e-8 * np.abs(blocks).max())


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_frames(count: int) -> None:
    body = body_of("arm8")
    q = np.array([body.integrate(body.neutral, np.full(body.nv, 0.1 * t)) for t in range(count)])
    value, gradient, _ = model_at(motion_of(body, 0.1, count), body, q)
    assert (value > 0.0) == (count > 1)
    assert gradient.any() == (count > 1)
