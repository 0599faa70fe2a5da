"""Laws of the energy: known values of each term. Their common contract: test_term_contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import body_of, camera_at, observe, random_pose, slope
from term_family import CAMERAS, evaluated, observed, reprojection

from estimator.data.observation import image_extent
from estimator.energy.cost import Cost
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.priors import GravityPrior, Stabilisers, Transition, world_up
from estimator.energy.reprojection import Reprojection
from estimator.energy.term import Term
from estimator.numerics.robust import POTENTIALS
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.tracking.smoothing import SmoothSettings
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body


@pytest.mark.parametrize("name", POTENTIALS)
def test_potentials(name: str) -> None:
    """rho as printed, its two derivatives, and its start as a Gaussian, seen through one joint's transition."""
    body, nu, std = body_of("arm8"), 3.0, 0.2
    printed = {
        "gaussian": lambda s: s,
        "lorentzian": lambda s: nu * np.log(1.0 + s / nu),
        "leclerc": lambda s: nu * (1.0 - np.exp(-s / nu)),
    }
    term = Transition(body, np.zeros(body.nq), np.full(body.nv, std), name, nu)

    def along(e: float) -> tuple[float, float, float]:
        value, gradient, hessian = evaluated(term, body, e * np.eye(body.nq)[5], exact=True)
        return value, gradient[5], hessian[5, 5]

    for e in (0.01, 0.2, 0.4, 1.5):
        value, pull, bend = along(e)
        assert value == pytest.approx(0.5 * printed[name]((e / std) ** 2), rel=1e-12)
        h = 1e-5
        assert pull == pytest.approx((along(e + h)[0] - along(e - h)[0]) / (2 * h), rel=1e-6, abs=1e-9)
        assert bend == pytest.approx((along(e + h)[1] - along(e - h)[1]) / (2 * h), rel=1e-6, abs=1e-9)
    value, pull, bend = along(1e-7)
    assert (value, pull, bend) == pytest.approx((0.5e-14 / std**2, 1e-7 / std**2, 1.0 / std**2), rel=1e-6)


def quadratic_form_matches(term: Term, body: Body, q: np.ndarray, tolerance: float) -> None:
    """Whether the exact Hessian gives the second derivative of the value along every two directions together."""
    hessian = evaluated(term, body, q, exact=True)[2]
    for i in range(body.nv):
        for k in range(i, body.nv):
            v = np.eye(body.nv)[i] + np.eye(body.nv)[k]
            # along q (+) tv the velocity stays v, so that the gradient's change along v is the curvature
            expected = slope(lambda x, v=v: evaluated(term, body, x)[1] @ v, body, q, v, 1e-4)
            assert abs(v @ hessian @ v - expected) < tolerance * np.abs(hessian).max(), (i, k)


@pytest.mark.parametrize("name", ["arm8", "human34", "upper13"])
def test_exact_curvature_of_the_reprojection(name: str) -> None:
    """Nearby, with skew, distortion and large residuals: kinematics, potential and projection. The difference between
    exact and Gauss-Newton Hessians is not small."""
    body, rng = body_of(name), np.random.default_rng(14)
    seen = observe(body, random_pose(body, rng, share=0.6, turn=0.4), CAMERAS, noise=20.0, rng=rng)
    term = Reprojection(body, seen, np.full(seen.confidence.shape, 40.0), "lorentzian", 4.0)
    q = random_pose(body, rng, share=0.6, turn=0.4)
    plain, exact = (evaluated(term, body, q, exact=e)[2] for e in (False, True))
    assert np.abs(plain - exact).max() > 0.05 * np.abs(exact).max()
    quadratic_form_matches(term, body, q, 1e-8)


@pytest.mark.parametrize("potential", POTENTIALS)
def test_exact_curvature_of_the_upright_root(potential: str) -> None:
    body = body_of("human34")
    q = random_pose(body, np.random.default_rng(19))
    quadratic_form_matches(GravityPrior(body, np.array([0.0, 0.0, 1.0]), 2.0, potential), body, q, 1e-6)


def test_upright_knows_tilt_but_not_heading() -> None:
    """The closed form: 1/2 |2 sin(tilt / 2)|^2 / std^2, whatever the heading."""
    body = body_of("human34")
    up = np.array([0.0, 0.0, 1.0])
    assert body.subject.upright is not None
    std = body.subject.upright.std
    for heading in (0.0, 1.0, 3.0):
        v = np.zeros(body.nv)
        v[5] = heading
        tilt = np.zeros(body.nv)
        tilt[3] = 0.4
        q = body.integrate(body.integrate(body.neutral, v), tilt)
        value, gradient, _ = evaluated(GravityPrior(body, up, potential="gaussian"), body, q)
        assert value == pytest.approx(0.5 * (2.0 * np.sin(0.2) / std) ** 2, rel=1e-12)
        assert abs(gradient @ np.r_[np.zeros(3), body.at(q).rotations[1].T @ up, np.zeros(28)]) < 1e-12


@pytest.mark.parametrize(("rows", "axis"), [((0, 1, 2), (0, -1, 0)), ((0, 2, 1), (0, 0, -1)), ((2, 0, 1), (-1, 0, 0))])
def test_world_up_is_the_axis_nearest_to_the_cameras_up(rows: tuple[int, ...], axis: tuple[int, ...]) -> None:
    tilted = pin.utils.rotate("x", 0.4) @ pin.utils.rotate("z", -0.3) @ np.eye(3)[list(rows)]
    assert np.array_equal(world_up([replace(CAMERAS[0], R_camera_world=tilted)]), axis)


@pytest.mark.parametrize("potential", POTENTIALS)
def test_exact_curvature_of_the_stabilisers(potential: str) -> None:
    body = body_of("human34")
    q = random_pose(body, np.random.default_rng(16))
    quadratic_form_matches(Stabilisers(body, 2.0, potential), body, q, 1e-6)


def test_exact_projections_cost_nothing() -> None:
    """The term projects as the camera does, with skew and distortion."""
    body = body_of("human34")
    q = random_pose(body, np.random.default_rng(17), share=0.6, turn=0.4)
    seen = observe(body, q, CAMERAS)
    term = Reprojection(body, seen, np.ones(seen.confidence.shape))
    value, gradient, _ = evaluated(term, body, q)
    assert value < 1e-18
    assert np.abs(gradient).max() < 1e-6
    assert np.nanmax(term.distances(body.at(q))) < 1e-9


def test_cameras_add() -> None:
    body, rng = body_of("human34"), np.random.default_rng(18)
    seen = observed(body, rng)
    q = random_pose(body, rng, share=0.6, turn=0.4)
    sigma = np.full(seen.confidence.shape, 9.0)
    both = evaluated(Reprojection(body, seen, sigma), body, q)
    single = [
        replace(
            seen, cameras=seen.cameras[c : c + 1], pixels=seen.pixels[c : c + 1], confidence=seen.confidence[c : c + 1]
        )
        for c in range(2)
    ]
    parts = [evaluated(Reprojection(body, view, sigma[:1]), body, q) for view in single]
    for whole, a, b in zip(both, *parts, strict=True):
        assert np.allclose(whole, a + b, rtol=1e-12, atol=1e-12 * np.abs(whole).max())
    of_cameras = Reprojection(body, seen, sigma).values_of_cameras(body.at(q))
    np.testing.assert_allclose(of_cameras, [part[0] for part in parts], rtol=1e-12)


def test_missing_keypoints_have_no_influence() -> None:
    body, rng = body_of("human34"), np.random.default_rng(19)
    seen = observed(body, rng)
    q = random_pose(body, rng, share=0.6, turn=0.4)
    sigma = np.full(seen.confidence.shape, 9.0)
    without = evaluated(Reprojection(body, seen, sigma), body, q)
    lied = replace(seen, pixels=np.where(seen.confidence[..., None] > 0.0, seen.pixels, 1e4))
    nan = replace(seen, confidence=np.where(np.isnan(seen.pixels[..., 0]), 1.0, seen.confidence))
    for other in (lied, nan):
        again = evaluated(Reprojection(body, other, sigma), body, q)
        assert all(np.array_equal(a, b) for a, b in zip(without, again, strict=True))
    assert np.isnan(Reprojection(body, seen, sigma).distances(body.at(q))[0, 3])


def test_a_body_behind_the_camera_costs_much_and_pulls_nowhere() -> None:
    body = body_of("human34")
    seen = observe(body, body.neutral, CAMERAS[:1])
    term = Reprojection(body, seen, np.full(seen.confidence.shape, 5.0))
    q = body.neutral.copy()
    q[:3] = 2.0 * CAMERAS[0].centre_world
    for exact in (False, True):
        value, gradient, hessian = evaluated(term, body, q, exact)
        assert np.isfinite(value)
        assert value > evaluated(term, body, random_pose(body, np.random.default_rng(20)))[0]
        assert not gradient.any()
        assert not hessian.any()
    for reach in np.linspace(0.0, 2.0, 41):  # through the camera itself
        q[:3] = reach * CAMERAS[0].centre_world
        assert all(np.isfinite(part).all() for part in evaluated(term, body, q, exact=True))


def test_point_loads_are_the_derivative_by_the_landmarks() -> None:
    """J' f is the gradient, J' W J the Hessian: sums over the tree against plain ones."""
    for name in ("human34", "upper13"):
        body, term, q = reprojection(name, "leclerc")(np.random.default_rng(21))
        assert isinstance(term, Reprojection)
        posed = body.at(q)
        force, weight = term.point_loads(posed)
        J = body.landmark_jacobians(posed)
        _, gradient, hessian = evaluated(term, body, q)
        assert np.allclose(np.einsum("lav,la->v", J, force), gradient, atol=1e-11 * np.abs(gradient).max())
        assert np.allclose(np.einsum("lav,lab,lbw->vw", J, weight, J), hessian, atol=1e-11 * np.abs(hessian).max())


def test_keypoint_noise_grows_with_the_person_in_the_image() -> None:
    body = body_of("human34")
    model = CostModel(body, CostSettings(keypoint_noise=0.1))
    near, far = (observe(body, body.neutral, [camera_at(0.0, distance=d)]) for d in (3.0, 6.0))
    ratio = model.keypoint_sigma(near) / model.keypoint_sigma(far)
    assert np.ptp(ratio) < 1e-12
    assert 1.9 < ratio[0, 0] < 2.2
    sides = np.array(
        [image_extent(near.pixels[0], near.confidence[0]), image_extent(near.pixels[0], 0 * near.confidence[0])]
    )
    assert sides[1] == 100.0
    assert model.keypoint_sigma(near).min() > 0.03 * sides[0]


@pytest.mark.parametrize("dt", [0.01, 0.04])
def test_joints_that_nothing_holds_go_back_to_rest_in_their_time(dt: float) -> None:
    """Near rest the energy with a past is lowest where the distance from rest has shrunk by dt / time, at any rate."""
    body, seconds, away = body_of("human34"), 0.5, 0.01
    even = [s for s in body.subject.stabilisers if s.std == s.std_above and s.quickness >= 1.0]
    v = np.array([body.model.idx_vs[body.model.getJointId(s.joint)] for s in even])
    rest, distance = body.neutral.copy(), np.zeros(body.nv)
    rest[[body.model.idx_qs[body.model.getJointId(s.joint)] for s in even]] = [s.rest for s in even]
    distance[v] = away
    model = CostModel(body, CostSettings(pose_prior_weight=0.0, rest_time=seconds))
    cost = Cost(body, [Stabilisers(body), *model.since(body.integrate(rest, distance), dt, None)])
    at_lowest = cost.at(body.integrate(rest, distance / (1.0 + dt / seconds))).gradient[v]
    beside = cost.at(body.integrate(rest, distance)).gradient[v]
    assert len(v) > 8
    assert np.abs(at_lowest / beside).max() < 0.01


def test_without_a_time_rest_positions_count_in_full_in_every_frame() -> None:
    body = body_of("human34")
    q = random_pose(body, np.random.default_rng(3))
    assert [term.name for term in CostModel(body).since(q, 0.04, None)] == [Transition.name]


def test_the_model_sums_its_terms() -> None:
    body, rng = body_of("human34"), np.random.default_rng(22)
    settings = CostSettings(stabiliser_weight=2.0, interpenetration_weight=0.7, pose_prior_weight=0.0)
    self_collision = SelfCollision(body)
    model = CostModel(body, settings, self_collision)
    term = model.observation_term(observed(body, rng))
    q, previous = random_pose(body, rng, share=0.6, turn=0.4), random_pose(body, rng, share=0.6, turn=0.4)
    parts: list[Term] = [
        term,
        Stabilisers(body, 2.0),
        GravityPrior(body, world_up(CAMERAS), 2.0 * settings.upright_weight),
        Interpenetration(self_collision, settings.clearance_scale, 0.7),
        Transition(body, previous, model.transition_std(0.04), settings.transition_potential, settings.transition_nu),
    ]
    whole, alone = model.cost(term, previous, 0.04).at(q), [evaluated(part, body, q) for part in parts]
    assert whole.value == pytest.approx(sum(a[0] for a in alone), rel=1e-12)
    assert np.allclose(whole.gradient, sum(a[1] for a in alone), rtol=1e-10, atol=1e-9)
    assert len(model.cost(term).terms) == 4
    bare = CostModel(body, CostSettings(stabiliser_weight=0.0, interpenetration_weight=0.0), self_collision)
    assert bare.cost(term).terms == (term,)
    assert np.allclose(model.transition_std(0.2), 2.0 * model.transition_std(0.1))


def test_quick_joints_may_change_more() -> None:
    body = body_of("human34")
    own, alike = (CostModel(body, CostSettings(turn_speed=5.0, quickness=q)).transition_std(0.1) for q in (True, False))
    assert np.ptp(alike[6:]) == 0.0
    ratio = dict(zip([body.model.names[j] for j in range(2, body.njoints)], (own / alike)[6:], strict=True))
    assert (ratio["left_knee_flexion"], ratio["lumbar_axial"], ratio["neck_axial"]) == pytest.approx((3.0, 0.4, 1.0))
    assert np.array_equal(own[:6], alike[:6])
    smoothed = [
        SmoothSettings(turn_acceleration=7.0).motion(CostModel(body, CostSettings(quickness=q))) for q in (True, False)
    ]
    assert np.allclose(smoothed[0].acceleration_std / smoothed[1].acceleration_std, own / alike)
