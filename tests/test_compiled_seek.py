"""The compiled search is the readable one, step by step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import CompiledSeeker, is_search_compiled
from estimator.energy.descent.qp import ACTIVE_SET, PROXQP, PROXQP_ALWAYS
from estimator.energy.descent.seek import Seeker, SeekSettings
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.term import BatchTerm
from estimator.search.cost_model import CostModel, parts_apart
from estimator.search.cost_terms import CostSettings
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody

CAMERAS = (camera_at(20.0), camera_at(100.0))


def energy(body: Body, rng: np.random.Generator, cameras: Sequence[int] = (0,)) -> tuple[Cost, np.ndarray]:
    """Keypoints of a pose, all priors, and the change from a pose nearby; a start some way off."""
    truth = random_pose(body, rng, share=0.5, turn=0.5)
    settings = CostSettings()
    model = CostModel(body, settings, parts_apart(body, settings))
    observation = observe(body, truth, [CAMERAS[k] for k in cameras])
    before = body.integrate(truth, 0.1 * rng.normal(size=body.nv))
    start = body.integrate(truth, 0.4 * rng.normal(size=body.nv))
    return model.cost(model.observation_term(observation), before, 0.04), start


class OnlyPython(BatchTerm):
    """A term without a kernel, around one that has one."""

    name = "only python"

    def __init__(self, term: BatchTerm) -> None:
        self._term = term

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        return self._term.accumulate(posed, gradient, hessian, exact)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        return self._term.values(placed)


@pytest.mark.parametrize("solver", [PROXQP, ACTIVE_SET, PROXQP_ALWAYS])
@pytest.mark.parametrize("settings", [SeekSettings(), SeekSettings(max_iterations=5, decrease_tolerance=1e-3)])
def test_searches_end_where_the_readable_ones_end(solver: str, settings: SeekSettings) -> None:
    body, rng = body_of("human34"), np.random.default_rng(0)
    for cameras in ((0,), (0, 1), (0,)):
        cost, start = energy(body, rng, cameras)
        expected = Seeker(body, settings, solver).seek(cost, start)
        solution = CompiledSeeker(body, settings, solver).seek(cost, start)
        assert (solution.status, solution.iterations) == (expected.status, expected.iterations)
        assert solution.steps == expected.steps
        assert solution.quadratic.exact == expected.quadratic.exact
        np.testing.assert_allclose(solution.q, expected.q, atol=1e-8)
        assert solution.quadratic.value == pytest.approx(expected.quadratic.value, rel=1e-12)
        np.testing.assert_allclose(solution.quadratic.hessian, expected.quadratic.hessian, atol=1e-6, rtol=1e-7)


def test_a_search_can_be_followed_by_any_other() -> None:
    body, rng = body_of("human34"), np.random.default_rng(1)
    (first, here), (second, there) = energy(body, rng), energy(body, rng, (0, 1))
    seeker = CompiledSeeker(body)
    alone = seeker.seek(first, here)
    seeker.seek(second, there)
    again = seeker.seek(first, here)
    assert np.array_equal(alone.q, again.q)
    assert alone.quadratic.value == again.quadratic.value


def test_a_term_without_a_kernel_takes_the_search_to_the_same_end() -> None:
    body, rng = body_of("human34"), np.random.default_rng(2)
    cost, start = energy(body, rng)
    keypoints = next(term for term in cost.terms if term.name == "keypoints")
    assert isinstance(keypoints, BatchTerm)
    others = [term for term in cost.terms if term is not keypoints]
    plain = Cost(body, [OnlyPython(keypoints), *others])
    assert len(plain.others) == 1
    seeker = CompiledSeeker(body)
    expected, solution = seeker.seek(cost, start), seeker.seek(plain, start)
    assert solution.iterations == expected.iterations
    np.testing.assert_allclose(solution.q, expected.q, atol=1e-8)


def test_contacts_that_are_left_to_coal_are_part_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    body, rng = body_of("human34"), np.random.default_rng(4)
    cost, _ = energy(body, rng)
    (repulsion,) = (term for term in cost.terms if isinstance(term, Interpenetration))
    plain = Cost(body, [OnlyPython(repulsion), *(term for term in cost.terms if term is not repulsion)])
    seeker, starts = CompiledSeeker(body), [random_pose(body, rng) for _ in range(6)]
    ends = [seeker.seek(plain, start) for start in starts]
    asked, accumulate = [], Interpenetration.accumulate
    monkeypatch.setattr(Interpenetration, "accumulate", lambda *given: asked.append(1) or accumulate(*given))
    for start, expected in zip(starts, ends, strict=True):
        solution = seeker.seek(cost, start)
        assert solution.iterations == expected.iterations
        np.testing.assert_allclose(solution.q, expected.q, atol=1e-7)
    assert 0 < len(asked) < sum(end.iterations for end in ends)


def test_bodies_with_other_joints_are_searched_all_the_same() -> None:
    body = body_of("gripper")
    assert body.compiled is None
    assert is_search_compiled(body)  # nothing is compiled for them, and no start waits for it
    cost = CostModel(body).cost(None, body.neutral, 0.1)
    start = random_pose(body, np.random.default_rng(3))
    expected, solution = Seeker(body).seek(cost, start), CompiledSeeker(body).seek(cost, start)
    assert np.array_equal(solution.q, expected.q)
