"""Laws of a search: the energy never rises, converged modes satisfy KKT, parts are separated, covariances fit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from builders import BROWN, bent, body_of, camera_at, inside, observe, random_pose

from estimator.energy.cost import Cost
from estimator.energy.descent.contact import ContactSettings, contact_kkt_residual, separate
from estimator.energy.descent.qp import PROXQP_ALWAYS, STEP_SOLVERS
from estimator.energy.descent.seek import Seeker, SeekSettings, trust_box
from estimator.energy.descent.solution import MAX_STD, Solution, free_directions, mode_covariance
from estimator.energy.term import Term
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.search.proposals import HELD_STD, CovarianceScaledProposal
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, PosedBody

TWO = (camera_at(20.0, distortion=BROWN), camera_at(110.0))
NO_CONTACT = CostSettings(interpenetration_weight=0.0)


def problem(seed: int, name: str = "human34", share: float = 0.5) -> tuple[Body, Cost, np.ndarray]:
    """Exact projections of one random pose, and another random pose to start from."""
    body, rng = body_of(name), np.random.default_rng(seed)
    truth = random_pose(body, rng, share=share, turn=0.5)
    model = CostModel(body, NO_CONTACT)
    return body, model.cost(model.observation_term(observe(body, truth, TWO))), random_pose(body, rng, turn=1.0)


def test_the_energy_never_rises() -> None:
    """Searches of 0, 1, 2, ... iterations are prefixes of one search: their ends are its accepted poses."""
    for seed in range(3):
        body, cost, start = problem(seed)
        seeker = Seeker(body)
        ends = [seeker.seek(cost, start, SeekSettings(max_iterations=n)) for n in range(1, 40)]
        values = [cost.at(body.clamp(start)).value, *(cost.at(end.q).value for end in ends)]
        # at the bottom the last digits are rounding, and there the gradient decides
        assert all(after <= before + 2e-14 * (1.0 + abs(before)) for before, after in pairwise(values))
        assert values[-1] < 0.5 * values[0]
        assert all(end.quadratic.value == value for end, value in zip(ends, values[1:], strict=True))
        assert all(inside(body, end.q) for end in ends)


def test_converged_modes_satisfy_kkt() -> None:
    """From random starts: a zero gradient wherever no limit holds, and elsewhere one that presses against the limit."""
    converged = active = 0
    for seed in range(25):
        # the odd ones pull joints beyond their limits
        body, cost, start = problem(seed, ("human34", "arm8", "upper13")[seed % 3], share=0.5 + seed % 2)
        solution = Seeker(body).seek(cost, start)
        assert np.isfinite(solution.quadratic.value)
        assert np.isfinite(solution.q).all()
        if solution.status != "converged":
            continue
        q, gradient = solution.q, cost.at(solution.q).gradient
        on_low = body.bounded_v[q[body.bounded_q] == body.lower[body.bounded_q]]
        on_high = body.bounded_v[q[body.bounded_q] == body.upper[body.bounded_q]]
        gradient[on_low], gradient[on_high] = np.minimum(gradient[on_low], 0.0), np.maximum(gradient[on_high], 0.0)
        assert np.abs(gradient).max() < 1e-6
        assert np.abs(gradient).max() == pytest.approx(solution.kkt_residual, abs=1e-12)
        converged += 1
        active += len(on_low) + len(on_high)
    assert converged >= 20
    assert active > 10  # limits were active


def test_a_perfect_start_stays() -> None:
    body = body_of("human34")
    model = CostModel(body, CostSettings(stabiliser_weight=0.0, interpenetration_weight=0.0))
    truth = random_pose(body, np.random.default_rng(41), share=0.5, turn=0.5)
    solution = Seeker(body).seek(model.cost(model.observation_term(observe(body, truth, TWO))), truth)
    assert (solution.status, solution.iterations) == ("converged", 0)
    assert np.array_equal(solution.q, truth)


def test_searches_repeat_and_have_no_memory() -> None:
    body, cost, start = problem(2)
    _, other_cost, other_start = problem(3)
    seeker = Seeker(body)
    first = seeker.seek(cost, start)
    seeker.seek(other_cost, other_start)
    for again in (seeker.seek(cost, start), Seeker(body).seek(cost, start)):
        assert np.array_equal(again.q, first.q)
        assert again[1:] == first[1:]


def test_solutions_record_the_solver_of_their_steps() -> None:
    body, cost, start = problem(6)
    seeker = Seeker(body)
    ends = [seeker.seek(cost, start) for _ in range(2)]
    assert ends[0].steps == ends[1].steps  # counts of the search, not the solver's total
    assert ends[0].steps.plus(ends[1].steps) == seeker.solver.counts
    assert ends[0].steps.free > 0
    assert ends[0].steps.proxqp > 0
    assert sum(ends[0].steps) >= ends[0].iterations > 3
    always = Seeker(body, step_solver=PROXQP_ALWAYS).seek(cost, start)
    assert always.steps.free == 0
    assert always.steps.proxqp == ends[0].steps.proxqp + ends[0].steps.free


@pytest.mark.parametrize("name", STEP_SOLVERS)
def test_searches_end_alike_with_any_step_solver(name: str) -> None:
    body, cost, start = problem(6)
    end, other = Seeker(body).seek(cost, start), Seeker(body, step_solver=name).seek(cost, start)
    assert np.array_equal(end.q, other.q)
    assert end[1:-1] == other[1:-1]  # all but the counts
    assert sum(end.steps) == sum(other.steps)


def test_starts_outside_the_limits_are_clamped_first() -> None:
    body, cost, start = problem(4)
    wild = start.copy()
    wild[body.bounded_q] += np.random.default_rng(42).normal(scale=5.0, size=len(body.bounded_q))
    seeker = Seeker(body)
    assert np.array_equal(seeker.seek(cost, wild).q, seeker.seek(cost, body.clamp(wild)).q)


def test_no_iterations() -> None:
    body, cost, start = problem(4)
    solution = Seeker(body).seek(cost, start, SeekSettings(max_iterations=0))
    assert np.array_equal(solution.q, body.clamp(start))
    assert (solution.status, solution.iterations) == ("iterations", 0)


def test_statuses_give_how_a_search_ended() -> None:
    body, cost, start = problem(5)
    seeker = Seeker(body)
    assert seeker.seek(cost, start, SeekSettings(max_iterations=1)).status == "iterations"
    stalled = seeker.seek(cost, start, SeekSettings(decrease_tolerance=1.0))
    assert stalled.status == "stalled"
    assert stalled.quadratic.value <= cost.at(body.clamp(start)).value


def test_steps_keep_to_the_trust_box() -> None:
    body, cost, start = problem(6)
    seeker = Seeker(body)
    settings = SeekSettings()
    radius = trust_box(body, settings.max_turn, settings.max_slide)
    assert np.array_equal(np.unique(radius[:3]), [settings.max_slide])
    assert np.array_equal(np.unique(radius[3:]), [settings.max_turn])
    sliding = trust_box(body_of("upper13"), 0.6, 0.25)
    assert np.array_equal(sliding[:2], [0.25, 0.25])
    poses = [body.clamp(start), *(seeker.seek(cost, start, SeekSettings(max_iterations=n)).q for n in range(1, 6))]
    for before, after in pairwise(poses):
        assert np.all(np.abs(body.difference(before, after)) <= radius + 1e-9)


class Bowl:
    """A term given as a function of the posed body."""

    name = "bowl"

    def __init__(self, function: Callable[[PosedBody], tuple[float, np.ndarray, np.ndarray]]) -> None:
        self._function = function

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        value, slope, curvature = self._function(posed)
        gradient += slope
        hessian += curvature
        return value

    def value(self, posed: PosedBody) -> float:
        return self._function(posed)[0]


def test_a_search_survives_useless_models() -> None:
    """No observation, an indefinite Hessian, a wrong gradient: a status, never an exception or a worse pose."""
    body, start = body_of("arm8"), random_pose(body_of("arm8"), np.random.default_rng(43))
    zero, eye = np.zeros(body.nv), np.eye(body.nv)
    terms: dict[str, tuple[Term, str]] = {
        "flat": (Bowl(lambda p: (1.0, zero, 0.0 * eye)), "converged"),
        "saddle": (Bowl(lambda p: (-0.5 * float(p.q @ p.q), -p.q, -eye)), "converged"),  # in a corner of the limits
        "liar": (Bowl(lambda p: (float(p.q @ p.q), -2.0 * p.q, eye)), "stalled"),
    }
    for name, (term, status) in terms.items():
        cost = Cost(body, [term])
        solution = Seeker(body).seek(cost, start)
        assert solution.status == status, name
        assert solution.quadratic.value <= cost.at(start).value
        assert inside(body, solution.q)


# ---- contact


CROSSED = {  # the left hand inside the trunk
    "left_shoulder_elevation": 0.1,
    "left_shoulder_flexion": 0.5,
    "left_shoulder_rotation": 1.0,
    "left_elbow_flexion": 1.9,
}


def overlapping() -> tuple[Body, Seeker, SelfCollision, Cost, Solution]:
    body = body_of("human34")
    self_collision = SelfCollision(body)
    crossed = bent(body, **CROSSED)
    model = CostModel(body, NO_CONTACT)
    cost = model.cost(model.observation_term(observe(body, crossed, TWO)))
    seeker = Seeker(body)
    return body, seeker, self_collision, cost, seeker.seek(cost, crossed)


def test_overlapping_limbs_are_separated() -> None:
    body, seeker, self_collision, cost, solution = overlapping()
    settings = ContactSettings()
    before = self_collision.penetration(solution.quadratic.posed)
    assert before > 4.0 * settings.tolerance  # the pictures do pull into an overlap
    end = separate(seeker, self_collision, cost, solution, settings)
    after = self_collision.penetration(body.at(end.q))
    assert after <= settings.tolerance
    assert inside(body, end.q)
    assert end.steps.proxqp > solution.steps.proxqp  # active rows
    assert sum(end.steps) - sum(solution.steps) >= end.iterations - solution.iterations > 0
    merits = [f.quadratic.value + settings.force * depth for f, depth in ((solution, before), (end, after))]
    assert merits[1] <= merits[0]
    assert end.quadratic.value == cost.at(end.q).value
    # near a constrained minimum: the contacts and limits balance all but a little of the gradient
    pressed = seeker.kkt_residual(end.quadratic)
    assert end.kkt_residual == contact_kkt_residual(seeker, self_collision, end.quadratic)
    assert end.kkt_residual < 0.02 * pressed
    assert end.status == ("converged" if end.kkt_residual < seeker.settings.kkt_tolerance else "separated")


def test_separate_bodies_are_let_be() -> None:
    body, cost, _ = problem(7)
    seeker, self_collision = Seeker(body), SelfCollision(body)
    solution = seeker.seek(cost, body.neutral, SeekSettings(decrease_tolerance=np.inf))
    assert separate(seeker, self_collision, cost, solution, ContactSettings()) is solution


# ---- covariance and proposals


def test_covariance_is_the_inverse_hessian_inside_the_limits() -> None:
    body, cost, _ = problem(8)
    q = random_pose(body, np.random.default_rng(44), share=0.5, turn=0.5)
    model = cost.at(q)
    covariance = mode_covariance(body, q, model.gradient, model.hessian, max_std=1e6)
    inverse = np.linalg.inv(model.hessian)
    assert np.abs(covariance - inverse).max() < 1e-6 * np.abs(inverse).max()
    bounded = mode_covariance(body, q, model.gradient, model.hessian)
    assert np.allclose(np.linalg.inv(bounded), model.hessian + np.eye(body.nv) / MAX_STD**2, rtol=1e-6, atol=1e-4)
    unknown = mode_covariance(body, q, np.zeros(body.nv), np.zeros((body.nv, body.nv)), max_std=0.3)
    assert np.allclose(unknown, 0.09 * np.eye(body.nv))


def test_active_limits_have_no_variance() -> None:
    body, cost, _ = problem(9)
    q = random_pose(body, np.random.default_rng(45), share=0.5, turn=0.5)
    low, high, slack = body.bounded_v[[2, 9, 14]], body.bounded_v[[5, 20]], body.bounded_v[11]
    q[body.bounded_q[[2, 9, 14, 11]]] = body.lower[body.bounded_q[[2, 9, 14, 11]]]
    q[body.bounded_q[[5, 20]]] = body.upper[body.bounded_q[[5, 20]]]
    gradient = np.random.default_rng(46).normal(size=body.nv)
    gradient[low], gradient[high], gradient[slack] = 2.0, -2.0, -1.0  # on its limit, but pulled away from it
    hessian = cost.at(q).hessian
    held = np.concatenate([low, high])
    assert set(free_directions(body, q, gradient)) == set(range(body.nv)) - set(held)
    covariance = mode_covariance(body, q, gradient, hessian)
    assert not covariance[held].any()
    assert not covariance[:, held].any()
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-12
    free = np.setdiff1d(np.arange(body.nv), held)
    conditional = np.linalg.inv(hessian[np.ix_(free, free)] + np.eye(len(free)) / MAX_STD**2)
    assert np.allclose(covariance[np.ix_(free, free)], conditional)


def test_samples_have_the_scaled_covariance() -> None:
    """The sample covariance S of N draws: tr(C^-1 S) / n and its largest eigenvalues follow Wishart's law."""
    body, rng, count, scale = body_of("arm8"), np.random.default_rng(47), 4000, 3.0
    q = 0.5 * (body.lower + body.upper)
    root = rng.normal(size=(body.nv, body.nv))
    covariance = 1e-4 * (root @ root.T + np.eye(body.nv))
    proposal = CovarianceScaledProposal(body, q, covariance, scale)
    steps = np.array([body.difference(q, proposal.sample(rng)) for _ in range(count)])
    whitened = steps @ np.linalg.inv(np.linalg.cholesky(scale**2 * covariance)).T
    assert np.abs(whitened.mean(axis=0)).max() < 5.0 / np.sqrt(count)
    edge = np.sqrt(body.nv / count)
    eigenvalues = np.linalg.eigvalsh(whitened.T @ whitened / count)
    assert (1.0 - edge) ** 2 - 0.03 < eigenvalues[0]
    assert eigenvalues[-1] < (1.0 + edge) ** 2 + 0.03


def test_samples_stay_in_the_limits_and_repeat() -> None:
    body, cost, _ = problem(10)
    q = random_pose(body, np.random.default_rng(48))
    q[body.bounded_q[::3]] = body.lower[body.bounded_q[::3]]
    model = cost.at(q)
    covariance = mode_covariance(body, q, model.gradient, model.hessian)  # with zero rows
    proposal = CovarianceScaledProposal(body, q, covariance, 8.0)
    draws = [
        [proposal.sample(rng) for _ in range(30)] for rng in (np.random.default_rng(49), np.random.default_rng(49))
    ]
    assert np.array_equal(*draws)
    assert inside(body, np.array(draws[0]))
    held = np.setdiff1d(np.arange(body.nv), free_directions(body, q, model.gradient))
    assert len(held) > 0
    assert max(np.abs(body.difference(q, s)[held]).max() for s in draws[0]) < 6.0 * HELD_STD
