"""Laws of the kinematics: derivatives, ownership, limits, and segment lengths as parameters."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import SUBJECTS, body_of, inside, random_pose, slope

from humanoid.kinematics.body import Body
from humanoid.kinematics.placements import JointKinematics
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Base, Subject, load_subject, subject_from_text


@pytest.fixture(params=SUBJECTS)
def body(request: pytest.FixtureRequest) -> Body:
    return body_of(request.param)


def test_landmark_jacobians_are_derivatives(body: Body) -> None:
    rng = np.random.default_rng(1)
    for _ in range(3):
        q = random_pose(body, rng)
        jacobians = body.landmark_jacobians(body.at(q))
        directions = [*np.eye(body.nv), rng.normal(size=body.nv)]
        for v in directions:
            expected = slope(lambda x: body.landmarks(body.at(x)), body, q, v, 1e-4)
            assert np.abs(jacobians @ v - expected).max() < 1e-6 * max(np.abs(expected).max(), 1e-3)


def test_support_is_where_landmarks_move(body: Body) -> None:
    q = random_pose(body, np.random.default_rng(2))
    moved = np.abs(body.landmark_jacobians(body.at(q))).max(axis=1) > 0.0
    assert not np.any(moved & ~body.landmark_support)
    for landmark, joint in enumerate(body.landmark_joint):
        ancestors = list(body.model.supports[int(joint)])
        expected = np.isin(body.tree.dof_joint, ancestors)
        assert np.array_equal(body.landmark_support[landmark], expected)


def test_placements_and_columns_are_pinocchios(body: Body) -> None:
    q = random_pose(body, np.random.default_rng(3))
    posed, data = body.at(q), body.model.createData()
    pin.computeJointJacobians(body.model, data, q)
    for j in range(1, body.njoints):
        assert np.array_equal(posed.rotations[j], data.oMi[j].rotation)
        assert np.array_equal(posed.translations[j], data.oMi[j].translation)
        spatial = pin.getJointJacobian(body.model, data, j, pin.ReferenceFrame.WORLD)
        assert np.allclose(np.where(body.support(j)[:, None], posed.spatial_jacobian, 0.0), spatial.T, atol=1e-14)


def test_a_posed_body_owns_its_arrays(body: Body) -> None:
    rng = np.random.default_rng(4)
    first = body.at(random_pose(body, rng))
    before = [array.copy() for array in (*first, body.landmarks(first))]
    body.at(random_pose(body, rng))
    assert all(np.array_equal(a, b) for a, b in zip(before, (*first, body.landmarks(first)), strict=True))


def test_steps_within_tangent_bounds_stay_inside_and_reach_the_limits(body: Body) -> None:
    rng = np.random.default_rng(5)
    q = random_pose(body, rng)
    low, high = body.tangent_bounds(q)
    assert np.all(low <= 0.0)
    assert np.all(high >= 0.0)
    assert set(np.flatnonzero(np.isfinite(low) & np.isfinite(high))) == set(body.bounded_v)
    for bound, limit in ((low, body.lower), (high, body.upper)):
        reached = body.integrate(q, np.where(np.isfinite(bound), bound, 0.0))[body.bounded_q]
        assert np.abs(reached - limit[body.bounded_q]).max() < 1e-14
    for _ in range(20):
        v = rng.normal(scale=3.0, size=body.nv)
        assert inside(body, body.integrate(q, v))


def test_difference_undoes_integrate(body: Body) -> None:
    rng = np.random.default_rng(6)
    q = random_pose(body, rng, share=0.5)
    v = rng.uniform(-0.05, 0.05, size=body.nv)
    assert np.abs(body.difference(q, body.integrate(q, v)) - v).max() < 1e-12


def test_clamping_leaves_the_root_alone_and_is_idempotent(body: Body) -> None:
    q = random_pose(body, np.random.default_rng(7))
    wild = q.copy()
    wild[body.bounded_q] += 10.0
    once = body.clamp(wild)
    free = np.setdiff1d(np.arange(body.nq), body.bounded_q)
    assert np.array_equal(once[body.bounded_q], body.upper[body.bounded_q])
    assert np.array_equal(once[free], wild[free])
    assert np.array_equal(body.clamp(once), once)
    assert np.array_equal(body.clamp(q), q)


def test_scaled_bodies_equal_scaled_subjects(body: Body) -> None:
    proportioned, rng = ProportionedBody(body.subject), np.random.default_rng(8)
    for _ in range(3):
        scales = rng.uniform(proportioned.low, proportioned.high)
        q = random_pose(body, rng)
        ours, theirs = proportioned.at(scales), Body(body.subject.scaled(proportioned.scales(scales)))
        assert np.abs(ours.landmarks(ours.at(q)) - theirs.landmarks(theirs.at(q))).max() < 1e-12
        assert np.abs(ours.at(q).spatial_jacobian - theirs.at(q).spatial_jacobian).max() < 1e-12
    plain = proportioned.at(np.ones(len(proportioned.names)))
    assert np.array_equal(plain.landmarks(plain.at(q)), body.landmarks(body.at(q)))


def test_landmark_derivatives_in_the_scales(body: Body) -> None:
    proportioned, rng = ProportionedBody(body.subject), np.random.default_rng(9)
    q, scales = random_pose(body, rng), rng.uniform(0.9, 1.1, size=len(proportioned.names))
    scaled = proportioned.at(scales)
    derivatives = proportioned.landmark_derivatives(scaled.at(q))
    for k in range(len(scales)):
        sides = []
        for h in (1e-3, -1e-3):
            other = proportioned.at(scales + h * np.eye(len(scales))[k])
            sides.append(other.landmarks(other.at(q)))
        # landmarks are linear in the scales, so that the difference is exact
        assert np.abs((sides[0] - sides[1]) / 2e-3 - derivatives[:, :, k]).max() < 1e-10
    assert np.abs(derivatives).max(axis=(0, 1)).min() > 1e-2  # every proportion has an effect


def test_a_left_proportion_moves_the_right_side_as_far() -> None:
    body = body_of("human34")
    proportioned = ProportionedBody(body.subject)
    derivatives = np.linalg.norm(proportioned.landmark_derivatives(body.at(body.neutral)), axis=1)
    for left, name in enumerate(body.landmark_names):
        if name.startswith("left_"):
            right = body.landmark_names.index("right_" + name[5:])
            assert np.allclose(derivatives[left], derivatives[right], atol=1e-12)


@pytest.mark.parametrize("name", SUBJECTS)
def test_placements_are_the_same_read_at_once_or_joint_by_joint(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A build of Pinocchio with another memory layout is slower, not wrong."""
    monkeypatch.setattr("humanoid.kinematics.placements._raw_placements", lambda data, njoints: None)
    slow, fast = Body(load_subject(name)), body_of(name)
    q = random_pose(fast, np.random.default_rng(31))
    assert np.array_equal(slow.at(q).placements, fast.at(q).placements)
    assert np.ptp(fast.at(q).placements) > 0.1


def test_kinematics_joint_by_joint_are_the_same() -> None:
    """The code path of large models, on every kind of joint."""
    bodies = [*(body_of(name) for name in SUBJECTS), Body(of_all_joints()), Body(of_all_joints("free"))]
    for body in bodies:
        q = pin.integrate(body.model, body.neutral, np.random.default_rng(32).normal(size=body.nv))
        expected, slow = body.at(q), JointKinematics(body.model).at(q)
        assert np.abs(slow[0] - expected.placements).max() < 1e-12
        assert np.abs(slow[1] - expected.spatial_jacobian).max() < 1e-12
        assert np.ptp(expected.spatial_jacobian) > 0.1


def test_a_long_chain_does_without_the_memory_of_dynamics(monkeypatch: pytest.MonkeyPatch) -> None:
    """`pin.Data` of 400 joints takes 2 GB; of 800, more than most machines have."""
    monkeypatch.setattr(pin.Model, "createData", None)
    count = 400
    body = Body(subject_from_text(chain(count), source="test"))
    q = body.integrate(body.neutral, np.full(body.nv, 0.01))
    angles = 0.01 * np.arange(1, count + 1)  # all turn about y
    tip = [0.05 * np.sin(angles).sum(), 0.05 * np.cos(angles).sum()]
    assert body.landmarks(body.at(q))[-1] == pytest.approx([tip[0], 0.0, tip[1]], abs=1e-9)
    assert body.support(body.njoints - 1).sum() == count


def of_all_joints(base: Base = "fixed") -> Subject:
    limits = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    joints = "".join(
        f'<joint name="{kind}" type="{kind}"><parent link="{a}"/><child link="{b}"/><origin xyz="0.1 0.2 0.3"'
        f' rpy="0.3 0.2 0.1"/><axis xyz="{axis}"/>{limits}</joint>'
        for kind, a, b, axis in (
            ("planar", "a", "b", "0 0 1"),
            ("continuous", "b", "c", "0 0 1"),
            ("revolute", "c", "d", "1 2 2"),
            ("prismatic", "d", "e", "0 1 0"),
        )
    )
    links = "".join(f'<link name="{n}"/>' for n in "abcde")
    return subject_from_text(f'<robot name="r">{links}{joints}</robot>', source="test", base=base)


def chain(count: int) -> str:
    """A URDF of `count` joints about y, 0.05 m above each other."""
    limits = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 {0.05 if k else 0}"/><axis xyz="0 1 0"/>{limits}</joint>'
        for k in range(count)
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(count + 1))
    tip = f'<landmark name="tip" link="l{count}" xyz="0 0 0.05"/>'
    return f'<robot name="chain">{links}{joints}{tip}</robot>'


def test_every_entry_of_q_has_its_own_name() -> None:
    """A planar joint has x, y and the cosine and sine of its angle; a continuous one only the last two."""
    body = Body(of_all_joints())
    planar = tuple(f"planar_{s}" for s in ("x", "y", "cos", "sin"))
    assert body.q_names == (*planar, "continuous_cos", "continuous_sin", "revolute", "prismatic")
    turned = pin.integrate(body.model, body.neutral, np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert turned[:4] == pytest.approx([0.3, 0.0, 1.0, 0.0])
