"""Sums of recorded terms, evaluated in one compiled call, are the sums of their terms."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.energy.cost import Cost
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.kernels.evaluate import evaluate
from estimator.energy.point_targets import PointTargets
from estimator.energy.priors import Stabilisers, Transition
from estimator.energy.recorded import RecordedTerm
from estimator.search.cost_model import CostModel, parts_apart
from estimator.search.cost_terms import CostSettings
from humanoid.kinematics.body import Body, PosedBody

BODY = body_of("human34")
MODEL = CostModel(BODY, CostSettings(), parts_apart(BODY, CostSettings()))


def energy(rng: np.random.Generator) -> Cost:
    """Keypoints of a standing frame, all priors, and the change since a pose nearby."""
    truth = random_pose(BODY, rng, share=0.5, turn=0.5)
    standing = np.where(np.char.find(BODY.landmark_names, "heel") + np.char.find(BODY.landmark_names, "toe") > -2, 1, 0)
    observation = observe(BODY, truth, [camera_at(20.0), camera_at(100.0)])
    observation = replace(observation, standing=standing.astype(float))
    before = BODY.integrate(truth, 0.1 * rng.normal(size=BODY.nv))
    return MODEL.cost(MODEL.observation_term(observation), before, 0.04)


def alone(cost: Cost, posed: PosedBody, exact: bool) -> tuple[float, np.ndarray, np.ndarray]:
    value, gradient, hessian = 0.0, np.zeros(cost.body.nv), np.zeros((cost.body.nv, cost.body.nv))
    for term in cost.terms:
        value += term.accumulate(posed, gradient, hessian, exact)
    return value, gradient, hessian


def left_to_coal(cost: Cost, posed: PosedBody) -> int:
    recorded, tree = cost.recorded, cost.body.tree
    gradient, hessian = np.zeros(cost.body.nv), np.zeros((cost.body.nv, cost.body.nv))
    return int(
        evaluate(
            *recorded.own, *recorded.kept, tree.joint_parent, tree.column_joint, tree.column_parent, posed.placements,
            posed.spatial_jacobian, posed.q, False, gradient, hessian, gradient, hessian,
        )[1]
    )  # fmt: skip


@pytest.mark.parametrize("exact", [False, True])
def test_a_sum_is_that_of_its_terms_also_where_contacts_are_left_to_coal(exact: bool) -> None:
    rng = np.random.default_rng(0)
    cost = energy(rng)
    assert {term.name for term in cost.terms} >= {"keypoints", "transition", "standing points", "level feet", "balance"}
    assert not cost.others
    some_left = 0
    for share in np.linspace(0.2, 1.0, 20):
        posed = BODY.at(random_pose(BODY, rng, share=share))
        some_left += left_to_coal(cost, posed) > 0
        model, (value, gradient, hessian) = cost.of(posed, exact), alone(cost, posed, exact)
        assert model.value == value
        np.testing.assert_allclose(model.gradient, gradient, rtol=0.0, atol=1e-12 * np.abs(gradient).max())
        np.testing.assert_allclose(model.hessian, hessian, rtol=0.0, atol=1e-12 * np.abs(hessian).max())
    assert 0 < some_left < 20


@pytest.mark.parametrize("lasts", [False, True])
def test_terms_added_to_a_sum_make_the_sum_of_all(lasts: bool) -> None:
    """To the last bit, also where an added term is permanent and belongs among the base's terms of its kind."""
    rng = np.random.default_rng(3)
    whole = energy(rng)
    later = [t for t in whole.terms if (t.name == "stabilisers" if lasts else t.name in ("transition", "balance"))]
    base = Cost(BODY, [term for term in whole.terms if term not in later])
    added, anew = base.plus(later), Cost(BODY, [*base.terms, *later])
    assert added.terms == anew.terms
    q = random_pose(BODY, rng, share=0.5)
    for a, b in zip(added.at(q, exact=True)[1:], anew.at(q, exact=True)[1:], strict=True):
        assert np.array_equal(a, b)
    assert added.value_at(q) != base.value_at(q)


def test_joints_that_follow_others_have_their_terms_recorded_too() -> None:
    body, rng = body_of("gripper"), np.random.default_rng(1)
    assert body.follows
    count = len(body.landmark_joint)
    target, precision = rng.normal(size=(count, 3)), np.tile(np.eye(3), (count, 1, 1))
    q = random_pose(body, rng)
    terms = [
        PointTargets(body, body.landmark_joint, body.landmark_local, target, precision),
        Stabilisers(body),
        Transition(body, q, np.ones(body.nv)),
    ]
    cost = Cost(body, terms)
    assert [term.name for term in cost.others] == ["transition"]
    posed = body.at(random_pose(body, rng))
    model, (value, gradient, hessian) = cost.of(posed, True), alone(cost, posed, True)
    assert model.value == value
    assert model.gradient == pytest.approx(gradient, rel=1e-12)
    assert model.hessian == pytest.approx(hessian, rel=1e-12)


def test_a_second_repulsion_is_evaluated_by_itself() -> None:
    assert MODEL.self_collision is not None
    twice = [Interpenetration(MODEL.self_collision), Interpenetration(MODEL.self_collision, weight=2.0)]
    cost = Cost(BODY, twice)
    assert cost.others == (twice[1],)
    posed = BODY.at(random_pose(BODY, np.random.default_rng(2)))
    assert cost.of(posed).value == pytest.approx(3.0 * Cost(BODY, twice[:1]).of(posed).value, rel=1e-12)


def test_records_do_not_travel_and_are_made_again() -> None:
    terms = energy(np.random.default_rng(3)).terms
    cost = Cost(BODY, [term for term in terms if not isinstance(term, Interpenetration)])  # no objects of coal
    posed = BODY.at(random_pose(BODY, np.random.default_rng(4)))
    before = cost.of(posed)
    sent = pickle.loads(pickle.dumps(cost))
    assert "recorded" not in sent.__dict__
    assert all("record" not in term.__dict__ for term in sent.terms if isinstance(term, RecordedTerm))
    after = sent.of(posed)
    assert after.value == before.value
    assert np.array_equal(after.hessian, before.hessian)


def test_unseen_landmarks_are_not_recorded() -> None:
    def size(body: Body, names: set[str]) -> int:
        observation = observe(body, body.neutral, [camera_at(20.0)])
        seen = np.array([name in names for name in body.landmark_names])
        hidden = replace(observation, confidence=observation.confidence * seen)
        return len(MODEL.observation_term(hidden).record.numbers)

    assert size(BODY, {"left_knee"}) < size(BODY, {"left_knee", "right_knee"})
