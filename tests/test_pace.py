"""How quick a person is: correlated accelerations, and a pace per frame, estimated from a clip."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of, random_pose

from estimator.energy.cost import Cost
from estimator.energy.priors import Transition
from estimator.inference.motion import MotionPrior
from estimator.search.cost_model import CostModel
from estimator.tracking.smoothing import SmoothSettings, smooth
from estimator.tracking.smoothing.chain import REACH, FrameChain
from estimator.tracking.smoothing.clip import TrajectoryUncertainty
from estimator.tracking.smoothing.pace import limbs_of, pace_of
from humanoid.kinematics.body import Body

FPS, NOISE = 30.0, 0.06
OLD = SmoothSettings(turn_acceleration=10.0, root_turn_acceleration=5.0, root_slide_acceleration=2.5, memory=0.0)


def prior(body: Body, count: int, memory: float = 0.12, pace: np.ndarray | None = None) -> MotionPrior:
    return MotionPrior(np.full(body.nv, 6.0), np.full(body.nv, 5.0), 8.0, 0.0, memory, pace)


def chain_of(body: Body, motion: MotionPrior, times: np.ndarray) -> FrameChain:
    return FrameChain(body, [Cost(body, [])] * len(times), times, motion, 1e-6)


def seen(body: Body, truth: np.ndarray, rng: np.random.Generator) -> tuple[list[Cost], np.ndarray]:
    """Costs of frames that see each pose with noise, and these poses."""
    noisy = np.array([body.integrate(q, rng.normal(0.0, NOISE, body.nv)) for q in truth])
    return [Cost(body, [Transition(body, q, np.full(body.nv, NOISE))]) for q in noisy], noisy


def kicking(body: Body, times: np.ndarray, amplitude: float) -> np.ndarray:
    """Arms hang still; the legs swing 2.5 times a second."""
    q = np.tile(body.neutral, (len(times), 1))
    for joint, share in (("left_knee_flexion", 1.0), ("right_knee_flexion", 0.8), ("left_hip_flexion", 0.5)):
        q[:, body.q_names.index(joint)] += amplitude * share * (1.0 - np.cos(2.0 * np.pi * 2.5 * times))
    return q


@pytest.mark.parametrize("memory", [0.0, 0.12])
def test_the_gradient_of_a_paced_chain_is_that_of_differences(memory: float) -> None:
    body, rng = body_of("human34"), np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.02, 0.06, 6))
    start = random_pose(body, rng, share=0.3)
    q = np.array([body.integrate(start, rng.normal(0.0, 0.05, body.nv)) for _ in times])
    chain = chain_of(body, prior(body, 6, memory, rng.uniform(0.4, 3.0, (6, body.nv))), times)
    gradient, direction = chain._model(q).gradient, rng.normal(size=(6, body.nv))
    step = 1e-6
    ends = [np.array([body.integrate(x, s * d) for x, d in zip(q, direction, strict=True)]) for s in (-step, step)]
    slope = (chain.energy(ends[1]) - chain.energy(ends[0])) / (2.0 * step)
    assert np.sum(gradient * direction) == pytest.approx(slope, rel=1e-5)


def test_a_descent_of_a_paced_chain_never_rises_and_held_frames_stay() -> None:
    body, rng = body_of("human34"), np.random.default_rng(4)
    times = np.arange(12) / FPS
    costs, q = seen(body, kicking(body, times, 0.4), rng)
    chain = FrameChain(body, costs, times, prior(body, 12, 0.12, rng.uniform(0.4, 3.0, (12, body.nv))), 1e-6)
    held = np.arange(12) < REACH
    after = chain.descend(q, held, 20)
    assert chain.energy(after) < chain.energy(q)
    np.testing.assert_array_equal(after[held], q[held])


def test_a_pace_of_one_changes_nothing() -> None:
    """To the last bit; without memory the whole acceleration is new."""
    body, rng = body_of("human34"), np.random.default_rng(5)
    times = np.arange(10) / FPS
    costs, q = seen(body, kicking(body, times, 0.3), rng)
    motion = prior(body, 10)
    np.testing.assert_array_equal(
        smooth(body, costs, times, q, motion),
        smooth(body, costs, times, q, motion._replace(pace=np.ones((10, body.nv)))),
    )
    v, dt = rng.normal(size=(9, body.nv)), np.full(9, 1.0 / FPS)
    np.testing.assert_allclose(motion._replace(memory=0.0).news(v, dt), np.diff(v, axis=0) * FPS)
    assert np.isclose(motion.news(np.cumsum(v, axis=0), dt).std(), FPS * np.hypot(1.0, motion.left(1 / FPS))
                      / np.sqrt(1.0 - motion.left(1 / FPS) ** 2), rtol=0.1)  # fmt: skip


def test_what_is_drawn_has_the_covariance_of_the_hessian() -> None:
    body, rng = body_of("arm8"), np.random.default_rng(6)
    times = np.arange(5) / FPS
    q = np.array([random_pose(body, rng, share=0.3) for _ in times])
    costs = [Cost(body, [Transition(body, x, np.full(body.nv, 0.1))]) for x in q]
    chain = FrameChain(body, costs, times, prior(body, 5), 1e-6)
    n, nv = 5 * body.nv, body.nv
    hessian, blocks = np.zeros((n, n)), chain._model(q).blocks
    for k in range(1 + REACH):
        for t in range(5 - k):
            hessian[t * nv : (t + 1) * nv, (t + k) * nv : (t + k + 1) * nv] = blocks[k, t]
    hessian = np.triu(hessian) + np.triu(hessian, 1).T
    samples = chain.draw(q, 20_000, np.random.default_rng(0)).reshape(n, -1)
    expected = np.linalg.inv(hessian)
    scale = np.sqrt(np.diag(expected))
    assert np.abs(samples @ samples.T / 20_000 - expected).max() < 0.05 * scale.max() ** 2
    np.testing.assert_allclose(samples.std(axis=1), scale, rtol=0.05)


def test_movements_that_are_drawn_window_by_window_scatter_as_those_of_one_window() -> None:
    """In positions, and in their second differences across the seams; the last window is a short one."""
    body, count = body_of("arm8"), 250
    times = np.arange(count) / FPS
    q = np.tile(body.neutral, (count, 1))
    costs = [Cost(body, [Transition(body, x, np.full(body.nv, 0.1))]) for x in q]
    scatters = []
    for window in (80, count):
        told = TrajectoryUncertainty(Cost(body, []), times, prior(body, count), SmoothSettings(window=window))
        moved = np.zeros((count, 16, body.nv), dtype=np.float32)
        assert len(list(told.covariances(costs, [()] * count, q, moved))) == count
        seams = moved[50:110], moved[130:190], moved[210:245]
        scatters.append([f(np.concatenate(seams)) for f in (np.std, lambda x: np.diff(x[:60], n=2, axis=0).std())])
    np.testing.assert_allclose(scatters[0], scatters[1], rtol=0.1)


def test_limbs_are_identified_by_what_they_move() -> None:
    body = body_of("human34")
    of = dict(zip(body.v_names, limbs_of(body).tolist(), strict=True))
    legs = {name for name in of if name.split("_", 1)[-1].split("_")[0] in ("hip", "knee", "ankle")}
    arms = {name for name in of if name.split("_", 1)[-1].split("_")[0] in ("clavicle", "shoulder", "elbow")}
    assert {of[name] for name in legs} == {1}
    assert {of[name] for name in arms} == {2}
    assert of["root_vz"] == 3
    assert {of[name] for name in set(of) - legs - arms - {"root_vz"}} == {0}


def test_a_kick_makes_the_legs_quick_and_keeps_the_swing() -> None:
    """Better than with the old prior, and than with this one at a constant pace; standing still gets no extra
    jitter."""
    body = body_of("human34")
    times = np.arange(45) / FPS
    settings, model = SmoothSettings(), CostModel(body)
    motion = settings.motion(model)
    knee = body.q_names.index("left_knee_flexion")

    def paced(amplitude: float) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
        truth = kicking(body, times, amplitude)
        costs, start = seen(body, truth, np.random.default_rng(7))
        even = smooth(body, costs, times, start, motion, settings)
        q, prior = even, motion
        for _ in range(settings.pace_rounds):
            prior = prior._replace(pace=pace_of(body, costs, times, q, prior, settings))
            q = smooth(body, costs, times, q, prior, settings)
        old = smooth(body, costs, times, start, OLD.motion(model), OLD)
        error = {n: float(np.abs(x - truth)[3:-3, 7:].mean()) for n, x in (("paced", q), ("even", even), ("old", old))}
        knees = {n + " knee": float(np.abs(x - truth)[3:-3, knee].mean()) for n, x in (("paced", q), ("old", old))}
        assert prior.pace is not None
        return prior.pace, q, {**error, **knees}

    limbs = limbs_of(body)
    quick, _, kick = paced(0.9)
    assert np.median(quick[:, limbs == 1]) > 1.5 * np.median(quick[:, limbs == 2])
    assert kick["paced knee"] < kick["old knee"]
    assert kick["paced"] < min(kick["even"], kick["old"])
    slow, _, still = paced(0.0)
    assert np.median(slow) < 1.0
    assert still["paced"] < min(still["even"], still["old"])
