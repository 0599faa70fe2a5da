"""Energies without derivatives: those with derivatives, to the last bit, alone and many at once."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import observe, random_pose
from term_family import CAMERAS, FAMILY, Made, evaluated
from test_image_terms import frame, terms

from estimator.energy.cost import Cost
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.point_targets import PointTargets
from estimator.energy.term import BatchTerm
from estimator.trackers.particle_set import FrameEnergy
from estimator.tracking.registry import make_tracker, settings_for
from humanoid.collision import curvature
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

IMAGE = {f"image-{cue}": cue for cue in ("edges", "outline", "flow", "all")}


@pytest.fixture(params=[*FAMILY, *IMAGE])
def member(request: pytest.FixtureRequest) -> Made:
    if request.param in IMAGE:
        return frame().body, terms(IMAGE[request.param])[1], frame().q_off
    return FAMILY[request.param](np.random.default_rng(5))


def poses(body: Body, q: np.ndarray, count: int = 40) -> np.ndarray:
    """Poses near and far, some in contact, some behind or inside a camera where the body is free."""
    rng = np.random.default_rng(6)
    near = [body.integrate(q, 0.1 * rng.normal(size=body.nv)) for _ in range(count // 2)]
    far = [random_pose(body, rng) for _ in range(count - count // 2)]
    if body.has_free_root:
        for k, reach in enumerate((0.5, 1.0, 1.02, 2.0)):
            far[k][:3] = reach * CAMERAS[0].centre_world
    return np.array([q, *near, *far])


def test_a_value_is_the_one_with_derivatives_to_the_last_bit(member: Made) -> None:
    body, term, q = member
    many = poses(body, q)
    whole = np.array([evaluated(term, body, each)[0] for each in many])
    assert len(np.unique(whole)) > len(many) // 4  # not constant
    assert np.array_equal([term.value(body.at(each)) for each in many], whole)
    assert isinstance(term, BatchTerm)
    order = np.random.default_rng(7).permutation(len(many))
    assert np.array_equal(term.values(body.placed(many[order])), whole[order])
    assert term.values(body.placed(many[:0])).shape == (0,)


def test_names_distinguish_the_family() -> None:
    made = [make(np.random.default_rng(5)) for make in FAMILY.values()]
    assert len({type(term) for _, term, _ in made}) == len({term.name for _, term, _ in made})
    assert {term.name for cue in IMAGE.values() for term in terms(cue)} == {"on contours", "flow"}


def test_a_sum_has_the_value_of_its_quadratic_model() -> None:
    """Also with a term that does not support many poses at once."""

    class Alone:
        name = "alone"

        def value(self, posed: object) -> float:
            return 0.1

        def accumulate(self, posed: object, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
            return 0.1

    rng = np.random.default_rng(8)
    chosen = [FAMILY[name](rng) for name in ("reprojection-lorentzian", "stabilisers-leclerc", "interpenetration")]
    body = chosen[0][0]
    cost = Cost(body, [chosen[0][1], Alone(), *(term for _, term, _ in chosen[1:])])
    many = poses(body, chosen[2][2])
    whole = np.array([cost.at(q).value for q in many])
    assert np.array_equal(cost.values_at(many), whole)
    assert np.array_equal([cost.value_at(q) for q in many], whole)
    assert np.array_equal([cost.value(body.at(q)) for q in many], whole)


@pytest.mark.parametrize("pictures", [False, True])
def test_particles_pay_for_no_derivatives_and_have_the_same_energies(pictures: bool) -> None:
    """In two cameras, for particles of two hypotheses, each with a flow of its own."""
    f, rng = frame(), np.random.default_rng(9)
    search = make_tracker("condensation", f.body, settings_for("condensation")).search
    seen = observe(f.body, f.q, [c.camera for c in f.cues], noise=3.0, rng=rng)
    modes = [SimpleNamespace(q=q) for q in (f.q_before, f.q_off)]
    energy = FrameEnergy(search, replace(seen, cues=f.cues if pictures else ()), SimpleNamespace(modes=modes))  # type: ignore[arg-type]
    q = np.array([f.body.integrate(f.q, 0.05 * rng.normal(size=f.body.nv)) for _ in range(12)])
    owner = rng.integers(2, size=12)
    whole = np.array([energy.at(each, int(k)).value for each, k in zip(q, owner, strict=True)])
    assert np.array_equal(energy.values(q, owner), whole)
    assert np.array_equal(energy.values(q, 1 - owner), whole) != pictures
    points = np.array([f.body.landmarks(f.body.at(each)) for each in q])
    for poses_now in (q, q[::-1]):
        assert np.array_equal(energy.landmarks(poses_now), points if poses_now is q else points[::-1])


def test_distances_survive_failed_queries() -> None:
    """Every query fails here, so that the approximations in their place are compared too."""
    body = frame().body
    self_collision = SelfCollision(body)
    self_collision.arrays.kind[:] = curvature.UNKNOWN  # so that every pair is left to coal
    term = Interpenetration(self_collision)
    many = poses(body, frame().q)
    before = [evaluated(term, body, q)[0] for q in many]
    self_collision._queries = [q and (*q[:2], lambda *_: np.nan, None) for q in self_collision._queries]
    whole = [evaluated(term, body, q)[0] for q in many]
    assert not np.array_equal(whole, before)
    assert np.array_equal(term.values(body.placed(many)), whole)


def test_point_targets_report_mismatches() -> None:
    body, (joint, local) = frame().body, (frame().body.landmark_joint, frame().body.landmark_local)
    target, precision = np.zeros((len(joint), 3)), np.tile(np.eye(3), (len(joint), 1, 1))
    at_target = PointTargets(body, joint, local, body.landmarks(body.at(frame().q)), precision)
    assert at_target.value(body.at(frame().q)) < 1e-25
    for problem in (
        {"target": target[:-1]}, {"precision": precision[:, 0]}, {"target": target * np.nan}, {"weight": np.ones(2)},
    ):  # fmt: skip
        with pytest.raises(InputError, match=next(iter(problem))):
            PointTargets(body, joint, local, **{"target": target, "precision": precision} | problem)
