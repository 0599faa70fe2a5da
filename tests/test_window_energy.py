"""The energies of many frames in one pass equal those of each frame and tie alone."""

from __future__ import annotations

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.energy.cost import Cost
from estimator.energy.priors import Transition
from estimator.energy.standing import StandingTie
from estimator.energy.term import Term
from estimator.inference.motion import MotionPrior
from estimator.search.cost_model import CostModel
from estimator.tracking.smoothing.chain import FrameChain
from estimator.tracking.smoothing.window_energy import WindowEnergy, moved_poses
from humanoid.kinematics.body import Body, PosedBody

COUNT = 4


class Hanging:
    """A term without a kernel: a weight on the root's height."""

    name = "hanging"

    def value(self, posed: PosedBody) -> float:
        return 7.0 * float(posed.placements[1, 11])

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        gradient += 7.0 * posed.spatial_jacobian[:, 2] * (np.arange(len(gradient)) < 3)
        return self.value(posed)


def window_of(name: str, seed: int) -> tuple[Body, list[Cost], list[list[StandingTie]], np.ndarray]:
    """Frames of which one has a term without a kernel, and ties between some of them."""
    body, rng = body_of(name), np.random.default_rng(seed)
    model, camera = CostModel(body), camera_at(20.0, distance=3.0)
    q = np.array([random_pose(body, rng, share=0.5, turn=0.3) for _ in range(COUNT)])
    seen = [observe(body, pose, (camera,), noise=5.0, rng=rng) for pose in q]
    more: list[list[Term]] = [[], [Hanging()], [], []]
    costs = [model.cost(model.observation_term(o)).plus(terms) for o, terms in zip(seen, more, strict=True)]
    points = [rng.choice(len(body.landmark_names), 3, replace=False) for _ in range(2)]
    ties = [[StandingTie(body, some, rng.uniform(0.2, 1.0, 3), 0.03)] for some in points]
    return body, costs, [ties[0], [], ties[1] + ties[0]], q


def by_itself(
    body: Body, costs: list[Cost], ties: list[list[StandingTie]], q: np.ndarray, exact: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The sums of a window: energies of the frames and of the ties, gradient and blocks."""
    nv = body.nv
    gradient, blocks = np.zeros((COUNT, nv)), np.zeros((2, COUNT, nv, nv))
    models = [cost.at(pose, exact) for cost, pose in zip(costs, q, strict=True)]
    for t, model in enumerate(models):
        gradient[t], blocks[0, t] = model.gradient, model.hessian
    tied = np.zeros(COUNT - 1)
    for t, row in enumerate(ties):
        pull, hessian = np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv))
        tied[t] = sum(tie.accumulate_pair(models[t].posed, models[t + 1].posed, pull, hessian) for tie in row)
        gradient[t : t + 2] += pull.reshape(2, nv)
        blocks[0, t] += hessian[:nv, :nv]
        blocks[0, t + 1] += hessian[nv:, nv:]
        blocks[1, t] += hessian[:nv, nv:]
    return np.array([model.value for model in models]), tied, gradient, blocks


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(("name", "seed", "compiled"), [("human34", 1, True), ("arm8", 2, True), ("human34", 3, False)])
def test_a_window_is_the_sum_of_its_frames(
    name: str, seed: int, compiled: bool, exact: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of a body whose joints are not compiled."""
    body, costs, ties, q = window_of(name, seed)
    expected = by_itself(body, costs, ties, q, exact)
    if not compiled:
        monkeypatch.setitem(body.__dict__, "compiled", None)
    gradient, blocks = np.zeros_like(expected[2]), np.zeros_like(expected[3])
    own, tied = WindowEnergy(body, costs, ties).add(q, gradient, blocks, exact)
    for part, known in zip((own, tied, gradient, blocks), expected, strict=True):
        np.testing.assert_allclose(part, known, rtol=1e-9, atol=1e-9 * np.abs(known).max())
    assert tied[1] == 0.0 < tied[0]


@pytest.mark.parametrize(("name", "seed"), [("human34", 6), ("gripper", 7)])
def test_a_chain_with_standing_points_has_its_gradient(name: str, seed: int) -> None:
    """Also of a body with a joint that follows another; its energy alone is the same to the last bit."""
    body, rng = body_of(name), np.random.default_rng(seed)
    q = np.array([random_pose(body, rng, share=0.3, turn=0.3)] * COUNT)
    q = np.array([body.integrate(pose, 0.02 * rng.normal(size=body.nv)) for pose in q])
    costs = [Cost(body, [Transition(body, pose, np.full(body.nv, 0.3))]) for pose in q[::-1]]
    index = np.arange(min(3, len(body.landmark_names)))
    ties = [[StandingTie(body, index, rng.uniform(0.2, 1.0, len(index)), 0.03)] for _ in range(COUNT - 1)]
    motion = MotionPrior(np.full(body.nv, 1.0), np.full(body.nv, 5.0), 8.0)
    chain, away = (
        FrameChain(body, costs, 0.04 * np.arange(COUNT), motion, 1e-3, ties),
        rng.normal(size=(COUNT, body.nv)),
    )
    model = chain.at(q, np.zeros((COUNT, body.nv)))
    assert chain.energy(q) == model.value
    ends = [chain.energy(moved_poses(body, q, step * away)) for step in (1e-6, -1e-6)]
    assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(float((model.gradient * away).sum()), rel=1e-6)


def test_shared_terms_are_recorded_once() -> None:
    """Twice as many frames need fewer than twice the numbers."""
    body, costs, _, _ = window_of("human34", 4)
    none = [()] * 7
    sizes = [len(WindowEnergy(body, many, none[: len(many) - 1])._records.numbers) for many in (costs, costs * 2)]
    assert sizes[1] == sizes[0]


def test_poses_that_stay_keep_their_bits() -> None:
    body, rng = body_of("human34"), np.random.default_rng(5)
    q = np.array([random_pose(body, rng) for _ in range(3)])
    q[:, 3:7] *= 1.0 + 1e-12
    step = 0.1 * rng.normal(size=(3, body.nv))
    step[1] = 0.0
    moved = moved_poses(body, q, step)
    np.testing.assert_array_equal(moved[1], q[1])
    for t in (0, 2):
        np.testing.assert_allclose(moved[t], body.integrate(q[t], step[t]), atol=1e-9)
