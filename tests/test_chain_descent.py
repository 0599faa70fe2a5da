"""How a chain of poses descends: steps end at limits, and few of them are needed near the minimum."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.energy.cost import Cost
from estimator.energy.descent.solution import free_mask
from estimator.energy.priors import Transition
from estimator.inference.motion import MotionPrior
from estimator.search.cost_model import CostModel
from estimator.tracking.smoothing import SmoothSettings, chain
from estimator.tracking.smoothing.chain import FrameChain, product
from humanoid.kinematics.body import Body

COUNT = 8
TIMES = np.arange(COUNT) / 30.0
STAY = np.zeros(COUNT, dtype=bool)


def pulled(body: Body, rng: np.random.Generator) -> FrameChain:
    """Each frame is pulled towards a pose with joints beyond their limits."""
    motion = MotionPrior(np.full(body.nv, 1.0), np.full(body.nv, 5.0), 8.0)
    targets = [body.neutral + rng.normal(scale=1.5, size=body.nq) for _ in range(COUNT)]
    costs = [Cost(body, [Transition(body, target, np.full(body.nv, 0.1))]) for target in targets]
    return FrameChain(body, costs, TIMES, motion, 1e-9)


def observed(body: Body, seed: int, tolerance: float) -> tuple[FrameChain, np.ndarray]:
    """Noisy keypoints of a turning body, and poses near it."""
    rng, model, camera = np.random.default_rng(seed), CostModel(body), camera_at(15.0, distance=3.5)
    pose, turn = random_pose(body, rng, share=0.3, turn=0.2), 0.02 * rng.normal(size=body.nv)
    truth = np.array([body.integrate(pose, t * turn) for t in range(COUNT)])
    costs = [model.cost(model.observation_term(observe(body, q, (camera,), noise=4.0, rng=rng))) for q in truth]
    start = np.array([body.integrate(q, 0.05 * rng.normal(size=body.nv)) for q in truth])
    return FrameChain(body, costs, TIMES, SmoothSettings().motion(model), tolerance), start


@pytest.mark.parametrize("seed", [1, 2])
def test_a_step_ends_at_limits_and_is_least_for_all_others(seed: int) -> None:
    body = body_of("arm8")
    stretch, q = pulled(body, np.random.default_rng(seed)), np.tile(body.neutral, (COUNT, 1))
    model = stretch.at(q, np.zeros((COUNT, body.nv)))
    step = stretch.step(model, STAY, 0.0)
    moved = (q + step)[:, body.bounded_q]
    lower, upper = body.lower[body.bounded_q], body.upper[body.bounded_q]
    assert np.all(moved >= lower - 1e-6)
    assert np.all(moved <= upper + 1e-6)
    ends = (np.abs(moved - lower) < 1e-9) | (np.abs(moved - upper) < 1e-9)
    assert 0 < ends.sum() < ends.size
    left = (model.gradient + product(model.blocks, step))[:, body.bounded_v]
    np.testing.assert_allclose(left[~ends], 0.0, atol=1e-8 * np.abs(model.gradient).max())


@pytest.mark.parametrize("seed", [3, 4])
def test_exact_models_end_lower_in_fewer_steps(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    body, results = body_of("human34"), list[tuple[float, int, float]]()
    for below in (0.0, 2e-3):
        monkeypatch.setattr(chain, "_EXACT_BELOW", below)
        stretch, start = observed(body, seed, 1e-7)
        tried, at = list[bool](), stretch.at
        monkeypatch.setattr(stretch, "at", lambda q, v, exact=False, a=at, n=tried: n.append(exact) or a(q, v, exact))
        q = stretch.descend(start, STAY, 100)
        gradient = stretch.at(q, np.zeros((COUNT, body.nv))).gradient
        pull = np.abs(np.where(free_mask(body, q, gradient), gradient, 0.0)).max()
        results.append((stretch.energy(q), len(tried), float(pull)))
        assert any(tried) == (below > 0.0)
    plain, exact = results
    assert exact[0] <= plain[0] + 1e-9
    assert exact[1] < plain[1]
    assert exact[2] < plain[2]


def test_gauss_newton_continues_where_an_exact_model_has_no_minimum() -> None:
    """All models are exact at once, far from the minimum."""
    body = body_of("human34")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(chain, "_EXACT_BELOW", np.inf)
        stretch, start = observed(body, 5, 1e-7)
        plain, made = stretch.plain, list[int]()
        patched.setattr(stretch, "plain", lambda model: made.append(1) or plain(model))
        q = stretch.descend(start, STAY, 100)
        assert made
    known, start = observed(body, 5, 1e-7)
    assert known.energy(q) == pytest.approx(known.energy(known.descend(start, STAY, 100)), abs=1e-4)
