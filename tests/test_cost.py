"""Laws of the energy: one contract for every term, and what each of them is known to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import BROWN, body_of, camera_at, observe, random_pose, slope

from estimator.cost.model import CostModel, CostSettings, image_extent
from estimator.imaging.observation import Observation
from estimator.numerics.robust import POTENTIALS
from estimator.terms.interpenetration import Interpenetration
from estimator.terms.point_targets import PointTargets
from estimator.terms.pose_mixture import load_mixture
from estimator.terms.pose_prior import PosePrior
from estimator.terms.priors import Stabilisers, Transition
from estimator.terms.reprojection import Reprojection
from estimator.terms.term import Cost, Term
from estimator.terms.upright import Upright, world_up
from humanoid.collision.clearance import Clearance
from humanoid.kinematics.body import Body

CAMERAS = (camera_at(20.0, distortion=BROWN), camera_at(110.0, focal=500.0))
Made = tuple[Body, Term, np.ndarray]


def evaluated(term: Term, body: Body, q: np.ndarray, exact: bool = False) -> tuple[float, np.ndarray, np.ndarray]:
    gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
    return term.accumulate(body.at(q), gradient, hessian, exact), gradient, hessian


def observed(body: Body, rng: np.random.Generator, noise: float = 8.0) -> Observation:
    """Noisy keypoints of a random pose, some of them missing."""
    seen = observe(body, random_pose(body, rng, share=0.6, turn=0.4), CAMERAS, noise=noise, rng=rng)
    seen.pixels[0, 3] = np.nan
    seen.confidence[0, 3] = 0.0
    seen.confidence[1] = rng.uniform(0.2, 1.0, size=len(body.landmark_names))
    return seen


def reprojection(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        seen = observed(body, rng)
        sigma = rng.uniform(5.0, 15.0, size=seen.confidence.shape)
        return body, Reprojection(body, seen, sigma, potential, 6.0), random_pose(body, rng, share=0.6, turn=0.4)

    return make


def stabilisers(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        return body, Stabilisers(body, 1.7, potential), random_pose(body, rng)

    return make


def transition(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        std = rng.uniform(0.1, 1.0, size=body.nv)
        return (
            body,
            Transition(body, random_pose(body, rng, turn=1.0), std, potential),
            random_pose(body, rng, turn=1.0),
        )

    return make


def interpenetration(rng: np.random.Generator) -> Made:
    body = body_of("human34")
    term = Interpenetration(Clearance(body), scale=0.01)
    while True:
        q = random_pose(body, rng)
        if evaluated(term, body, q)[0] > 0.5:
            return body, term, q


def upright(potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of("human34")
        return body, Upright(body, world_up(CAMERAS), 1.3, potential), random_pose(body, rng)

    return make


def point_targets(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    """Three landmarks, one of which is known in two directions only and another counts half."""

    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        chosen = [0, 2, len(body.landmark_names) - 1]
        factors = rng.normal(size=(3, 3, 3)) * 5.0
        factors[1, :, 2] = 0.0
        target = body.landmarks(body.at(random_pose(body, rng)))[chosen]
        term = PointTargets(
            body, body.landmark_joint[chosen], body.landmark_local[chosen], target,
            factors @ factors.transpose(0, 2, 1), weight=np.array([1.0, 1.0, 0.5]), potential=potential, nu=3.0,
        )  # fmt: skip
        return body, term, random_pose(body, rng)

    return make


FAMILY = {
    **{f"point-targets-{p}": point_targets("human34", p) for p in POTENTIALS},
    "point-targets-arm8": point_targets("arm8", "lorentzian"),
    "pose-prior": lambda rng: (
        body_of("human34"),
        PosePrior(body_of("human34"), load_mixture(), 0.7),
        random_pose(body_of("human34"), rng, share=0.3),
    ),
    **{f"upright-{p}": upright(p) for p in POTENTIALS},
    **{f"reprojection-{p}": reprojection("human34", p) for p in POTENTIALS},
    **{f"reprojection-{n}": reprojection(n, "lorentzian") for n in ("arm8", "upper13")},
    **{f"stabilisers-{p}": stabilisers("human34", p) for p in POTENTIALS},
    **{f"transition-{p}": transition("human34", p) for p in POTENTIALS},
    "transition-arm8": transition("arm8", "leclerc"),
    "interpenetration": interpenetration,
}


@pytest.fixture(params=FAMILY)
def made(request: pytest.FixtureRequest) -> Made:
    return FAMILY[request.param](np.random.default_rng(11))


def test_gradient_is_the_derivative_of_the_value(made: Made) -> None:
    body, term, q = made
    gradient = evaluated(term, body, q)[1]
    rng = np.random.default_rng(12)
    # one entry at a time, and all at once: a wrong entry cannot hide behind large others
    for v in [*np.eye(body.nv), rng.normal(size=body.nv)]:
        expected = slope(lambda x: np.array(evaluated(term, body, x)[0]), body, q, v, 1e-5)
        assert abs(gradient @ v - expected) < 1e-5 * max(
            abs(expected), 1e-2 * np.linalg.norm(gradient) * np.linalg.norm(v)
        )


def test_hessian_is_symmetric_and_semi_definite_unless_exact(made: Made) -> None:
    body, term, q = made
    for exact in (False, True):
        hessian = evaluated(term, body, q, exact)[2]
        largest = np.abs(hessian).max()
        assert largest > 0.0
        assert np.abs(hessian - hessian.T).max() < 1e-13 * largest
        assert exact or np.linalg.eigvalsh(hessian)[0] > -1e-12 * body.nv * largest


def test_terms_add_and_repeat(made: Made) -> None:
    body, term, q = made
    posed = body.at(q)
    once = evaluated(term, body, q)
    gradient, hessian = np.ones(body.nv), np.ones((body.nv, body.nv))
    values = [term.accumulate(posed, gradient, hessian) for _ in range(2)]
    assert values == [once[0], once[0]]
    assert np.allclose(gradient - 1.0, 2.0 * once[1], rtol=1e-12, atol=1e-12 * np.abs(once[1]).max())
    assert np.allclose(hessian - 1.0, 2.0 * once[2], rtol=1e-12, atol=1e-12 * np.abs(once[2]).max())
    summed = Cost(body, [term, term]).at(q)
    assert summed.value == 2.0 * once[0]


def test_a_term_has_no_memory(made: Made) -> None:
    body, term, q = made
    before = evaluated(term, body, q)
    evaluated(term, body, random_pose(body, np.random.default_rng(13)), exact=True)
    assert all(np.array_equal(a, b) for a, b in zip(before, evaluated(term, body, q), strict=True))


def test_exactness_changes_the_curvature_alone(made: Made) -> None:
    body, term, q = made
    plain, exact = evaluated(term, body, q), evaluated(term, body, q, exact=True)
    assert plain[0] == exact[0]
    assert np.array_equal(plain[1], exact[1])


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


@pytest.mark.parametrize("name", ["arm8", "human34"])
def test_exact_curvature_of_the_reprojection(name: str) -> None:
    """Far away perspective is affine: all curvature left is the kinematics' and the potential's, which `exact` has.

    The part left out falls with the distance; at 100 km it is far below a ten-thousandth.
    """
    body, rng = body_of(name), np.random.default_rng(14)
    far = tuple(camera_at(a, distance=1e5, focal=2e7) for a in (20.0, 110.0))
    seen = observe(body, random_pose(body, rng, share=0.6, turn=0.4), far, noise=20.0, rng=rng)
    term = Reprojection(body, seen, np.full(seen.confidence.shape, 40.0), "lorentzian", 4.0)
    q = random_pose(body, rng, share=0.6, turn=0.4)
    plain, exact = (evaluated(term, body, q, exact=e)[2] for e in (False, True))
    assert np.abs(plain - exact).max() > 0.05 * np.abs(exact).max()  # there is something to get right
    quadratic_form_matches(term, body, q, 1e-4)


def test_exact_curvature_of_the_reprojection_at_a_perfect_fit() -> None:
    """Nearby, what is left out is multiplied by the residual: at none, nothing is missing."""
    body = body_of("arm8")
    q = random_pose(body, np.random.default_rng(15), share=0.6)
    seen = observe(body, q, CAMERAS)
    quadratic_form_matches(Reprojection(body, seen, np.full(seen.confidence.shape, 10.0)), body, q, 1e-5)


@pytest.mark.parametrize("potential", POTENTIALS)
def test_exact_curvature_of_the_upright_root(potential: str) -> None:
    body = body_of("human34")
    q = random_pose(body, np.random.default_rng(19))
    quadratic_form_matches(Upright(body, np.array([0.0, 0.0, 1.0]), 2.0, potential), body, q, 1e-6)


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
        value, gradient, _ = evaluated(Upright(body, up, potential="gaussian"), body, q)
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
    """With skew and distortion the term projects as the camera does."""
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
    parts = [evaluated(Reprojection(body, one, sigma[:1]), body, q) for one in single]
    for whole, a, b in zip(both, *parts, strict=True):
        assert np.allclose(whole, a + b, rtol=1e-12, atol=1e-12 * np.abs(whole).max())


def test_missing_keypoints_have_no_say() -> None:
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
    """J' f is the gradient, J' W J the Hessian: the sums over the tree against the plain ones."""
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


def test_the_model_sums_its_terms() -> None:
    body, rng = body_of("human34"), np.random.default_rng(22)
    settings = CostSettings(stabiliser_weight=2.0, interpenetration_weight=0.7)
    clearance = Clearance(body)
    model = CostModel(body, settings, clearance)
    term = model.observation_term(observed(body, rng))
    q, previous = random_pose(body, rng, share=0.6, turn=0.4), random_pose(body, rng, share=0.6, turn=0.4)
    parts: list[Term] = [
        term,
        Stabilisers(body, 2.0),
        Upright(body, world_up(CAMERAS), 2.0 * settings.upright_weight),
        Interpenetration(clearance, settings.clearance_scale, 0.7),
        Transition(body, previous, model.transition_std(0.04), settings.transition_potential, settings.transition_nu),
    ]
    whole, alone = model.cost(term, previous, 0.04).at(q), [evaluated(part, body, q) for part in parts]
    assert whole.value == pytest.approx(sum(a[0] for a in alone), rel=1e-12)
    assert np.allclose(whole.gradient, sum(a[1] for a in alone), rtol=1e-10, atol=1e-9)
    assert len(model.cost(term).terms) == 4
    bare = CostModel(body, CostSettings(stabiliser_weight=0.0, interpenetration_weight=0.0), clearance)
    assert bare.cost(term).terms == (term,)
    assert np.allclose(model.transition_std(0.2), 2.0 * model.transition_std(0.1))
