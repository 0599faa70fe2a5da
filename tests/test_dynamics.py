"""Inverse dynamics with contact: derivatives of known motions, laws of statics, free fall, and forward dynamics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from builders import bent, body_of
from scipy.optimize import fsolve

from estimator.dynamics.contact_forces import GRAVITY, ForceSettings, InverseDynamics, Support
from estimator.dynamics.motion import Motion, motion_of
from estimator.dynamics.soles import SolePoints
from estimator.dynamics.trunk import Trunk
from estimator.dynamics.uncertainty import UncertaintySettings, poses_off, samples_of, smooth_noise
from estimator.inference.contacts import FootPoints
from humanoid.kinematics.body import points_in_world
from humanoid.shape.segment_masses import person_inertias

BODY = body_of("human34")
MASS = 70.0
WEIGHT = GRAVITY * sum(inertia.mass for inertia in person_inertias(body_of("human34"), MASS))
FEET = FootPoints.of(BODY)
assert FEET is not None
LEFT, RIGHT = (np.array([float(name.startswith(side)) for name in FEET.names]) for side in ("left", "right"))
TIME = np.arange(12) / 100.0


def dynamics(**settings: float) -> InverseDynamics:
    inertias = person_inertias(BODY, MASS)
    return InverseDynamics(BODY, inertias, ForceSettings(**settings))


def still(q: np.ndarray) -> Motion:
    return motion_of(BODY, TIME, np.tile(q, (len(TIME), 1)))


def standing(carries: np.ndarray, count: int = len(TIME)) -> Support:
    return Support(np.tile(carries, (count, 1)), np.zeros(count), np.zeros((count, 0)))


def leaning(roll: float) -> np.ndarray:
    """A pose with bent legs and level soles, turned about x."""
    bends = {"hip_flexion": 0.1, "knee_flexion": 0.2, "ankle_dorsiflexion": 0.1}
    q = bent(BODY, **{f"{side}_{joint}": angle for side in ("left", "right") for joint, angle in bends.items()})
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(roll, 0.0, 0.3)).coeffs()
    return q


def test_a_screw_motion_has_its_twist_and_no_acceleration() -> None:
    twist = np.zeros(BODY.nv)
    twist[:9] = 0.4, -0.2, 0.1, 0.6, -0.5, 0.8, 0.7, -0.3, 0.2
    time = np.arange(20) / 100.0
    q = np.array([BODY.integrate(leaning(0.1), t * twist) for t in time])
    motion = motion_of(BODY, time, q)
    np.testing.assert_allclose(motion.v[4:-4], np.tile(twist, (12, 1)), atol=1e-5)
    np.testing.assert_allclose(motion.a[4:-4], 0.0, atol=2e-3)


def test_polynomials_have_their_derivatives_at_uneven_times() -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(0.008, 0.012, 30))
    q = np.tile(BODY.neutral, (30, 1))
    q[:, 20] = 0.1 + time - 2.0 * time**2 + 3.0 * time**3
    motion = motion_of(BODY, time, q)
    np.testing.assert_allclose(motion.v[:, 19], 1.0 - 4.0 * time + 9.0 * time**2, atol=1e-8)
    np.testing.assert_allclose(motion.a[:, 19], -4.0 + 18.0 * time, atol=1e-6)


def test_motion_ends_at_gaps() -> None:
    """Nothing is interpolated over frames without a pose or over a pause, and short stretches have no accelerations."""
    q, time = np.tile(BODY.neutral, (40, 1)), np.arange(40) / 50.0
    q[10] = np.nan
    time[25:] += 0.2
    motion = motion_of(BODY, np.append(time[:-3], time[-3:] + 0.3), q)
    assert motion.parts == ((0, 10), (11, 25), (25, 37))
    assert not motion.known[[10, 37, 38, 39]].any()
    assert motion.known.sum() == 36


def test_a_body_at_rest_weighs_its_weight_under_its_centre_of_mass() -> None:
    """Whatever the split between the feet, the centre of pressure of both is below the centre of mass."""
    d, motion = dynamics(), still(leaning(0.01))
    loads = d.loads(motion, standing(LEFT + RIGHT))
    total = loads.force.sum(axis=1)
    np.testing.assert_allclose(total[5], [0.0, 0.0, WEIGHT], atol=2e-3 * WEIGHT)
    pressure = np.einsum("tf,tfi->ti", loads.force[..., 2], loads.pressure) / total[:, 2:]
    np.testing.assert_allclose(pressure[5, :2], d.centres(motion)[5, :2], atol=2e-3)
    assert (loads.force[5, :, 2] > 0.3 * WEIGHT).all()


def test_statics_is_the_gradient_of_the_potential() -> None:
    """Joint moments do the work that potential energy and contact forces need, by central differences."""
    d, q = dynamics(), leaning(0.0)
    loads, soles = d.loads(still(q), standing(LEFT)), SolePoints.of(BODY)
    assert soles is not None
    own = soles.foot == 0
    foot = int(soles.joint[own][0])
    pressure = loads.pressure[5, 0]
    local = BODY.at(q).rotations[foot].T @ (pressure - BODY.at(q).translations[foot])
    turn = np.array([0.0, 0.0, loads.free_moment[5, 0]])

    def work(step: np.ndarray) -> float:
        moved = BODY.integrate(q, step)
        posed, height = BODY.at(moved), d.centres(still(moved))[0, 2]
        point = points_in_world(posed, np.array([foot]), local[None])[0]
        turned = pin.log3(posed.rotations[foot] @ BODY.at(q).rotations[foot].T)
        return float(WEIGHT * height - loads.force[5, 0] @ point - turn @ turned)

    for i in range(BODY.nv):
        step = 1e-5 * np.eye(BODY.nv)[i]
        assert (work(step) - work(-step)) / 2e-5 == pytest.approx(loads.torque[5, i], abs=1e-2)


def test_nothing_carries_who_falls_freely() -> None:
    time = np.arange(20) / 100.0
    q = np.tile(leaning(0.2), (20, 1))
    q[:, :3] += np.stack([2.0 * time, 0.0 * time, 3.0 * time - 0.5 * GRAVITY * time**2], axis=1)
    loads = dynamics().loads(motion_of(BODY, time, q), standing(0.0 * LEFT, 20))
    np.testing.assert_array_equal(loads.force, 0.0)
    assert np.isnan(loads.pressure).all()
    np.testing.assert_allclose(loads.torque, 0.0, atol=1e-5)


def test_feet_push_and_do_not_pull_and_stay_in_their_cones() -> None:
    """Of who is pulled up, or forwards more than friction allows, the rest is a residual."""
    time, friction = np.arange(20) / 100.0, 0.05
    for acceleration in ([0.0, 0.0, -2.0 * GRAVITY], [0.9, 0.0, 0.0]):
        q = np.tile(leaning(0.0), (20, 1))
        q[:, :3] += 0.5 * np.square(time)[:, None] * acceleration
        loads = dynamics(friction=friction).loads(motion_of(BODY, time, q), standing(LEFT + RIGHT, 20))
        assert (loads.force[..., 2] >= 0.0).all()
        level = np.linalg.norm(loads.force[..., :2], axis=2)
        assert (level <= friction * loads.force[..., 2] + 1e-6).all()
        assert np.abs(loads.torque[10, :3]).max() > 0.03 * WEIGHT


@pytest.mark.parametrize(
    ("way", "joint", "turns"), [(1, "hip_abduction", (0.25, 0.25)), (0, "hip_flexion", (0.3, -0.3))]
)
def test_feet_apart_push_towards_the_point_above_the_centre_of_mass(
    way: int, joint: str, turns: tuple[float, float]
) -> None:
    """What both feet push against each other motion does not determine: the prior alone does, by the way one faces."""
    heading, q = 0.8, leaning(0.0)
    for side, turn in zip(("left", "right"), turns, strict=True):
        q[BODY.place(f"{side}_{joint}").q] = turn
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 0.0, heading)).coeffs()
    d, motion = dynamics(), still(q)
    loads, centre = d.loads(motion, standing(LEFT + RIGHT)), d.centres(motion)[5]
    R_facing_world = pin.rpy.rpyToMatrix(0.0, 0.0, heading).T
    away, force = ((centre - loads.pressure[5]) @ R_facing_world.T, loads.force[5] @ R_facing_world.T)
    lean = force[:, way] / force[:, 2]
    np.testing.assert_allclose(lean, d.settings.pivot[way] * away[:, way] / away[:, 2], atol=0.02)
    assert np.abs(lean).min() > 0.05
    assert lean[0] * lean[1] < 0.0


def test_a_seat_is_not_used_by_feet_that_can_carry() -> None:
    d = InverseDynamics(BODY, person_inertias(BODY, MASS), ForceSettings(), np.zeros(3))
    loads = d.loads(still(leaning(0.0)), standing(LEFT + RIGHT)._replace(seated=np.ones(len(TIME))))
    assert np.abs(loads.seat[5]).max() < 0.02 * WEIGHT


def test_a_seat_carries_what_the_feet_cannot() -> None:
    """Who leans far back on both feet is held up by a seat where there may be one, and falls where there is none."""
    q = leaning(0.0)
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, -0.5, 0.0)).coeffs()
    d = InverseDynamics(BODY, person_inertias(BODY, MASS), ForceSettings(), np.zeros(3))
    both = standing(LEFT + RIGHT)
    seated = d.loads(still(q), both._replace(seated=np.ones(len(TIME))))
    assert seated.seat[5, 2] > 0.3 * WEIGHT
    assert seated.force[5, :, 2].sum() + seated.seat[5, 2] == pytest.approx(WEIGHT, rel=1e-2)
    alone = d.loads(still(q), both)
    assert alone.seat[5, 2] == 0.0
    assert np.abs(alone.torque[5, :6]).max() > np.abs(seated.torque[5, :6]).max()


def balanced(feet: tuple[int, ...]) -> np.ndarray:
    """A pose whose centre of mass is over the middle of these soles."""
    soles, d = SolePoints.of(BODY), dynamics()
    assert soles is not None
    own = np.isin(soles.foot, feet)

    def posed(turns: np.ndarray) -> np.ndarray:
        q = leaning(0.0)
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*turns, 0.0)).coeffs()
        return q

    def off(turns: np.ndarray) -> np.ndarray:
        q = posed(turns)
        sole = points_in_world(BODY.at(q), soles.joint[own], soles.local[own]).mean(axis=0)
        return np.asarray((d.centres(still(q))[0] - sole)[:2])

    return posed(fsolve(off, np.zeros(2)))


def test_hands_on_the_ground_carry_their_share() -> None:
    """On all fours hands and feet together carry the weight, and balance it."""
    q = bent(BODY, left_shoulder_flexion=1.5, right_shoulder_flexion=1.5)
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 1.3, 0.0)).coeffs()
    wrists = np.array([BODY.landmark_names.index(f"{side}_wrist") for side in ("left", "right")])
    d = InverseDynamics(BODY, person_inertias(BODY, MASS), ForceSettings(friction=2.0), hands=wrists)
    support = standing(LEFT + RIGHT)._replace(hands=np.ones((len(TIME), 2)))
    loads = d.loads(still(q), support)
    assert loads.hands[5, :, 2].min() > 0.05 * WEIGHT
    assert loads.force[5, :, 2].sum() + loads.hands[5, :, 2].sum() == pytest.approx(WEIGHT, rel=1e-2)
    assert np.abs(loads.torque[5, 3:6]).max() < 0.02 * WEIGHT


class Simulated(NamedTuple):
    """q (T, nq) at times (T,) [s], the ground's force (T, 3) [N] and the joints' torques (T, nv)."""

    time: np.ndarray
    q: np.ndarray
    force: np.ndarray
    torque: np.ndarray


def simulated(seconds: float, feet: tuple[int, ...]) -> Simulated:
    """A person on these feet, moved by torques that change, by forward dynamics with points of the soles held."""
    model, soles = pin.Model(BODY.model), SolePoints.of(BODY)
    assert soles is not None
    for j, inertia in enumerate(person_inertias(BODY, MASS)):
        model.inertias[j] = inertia
    data, q, v = model.createData(), balanced(feet), np.zeros(BODY.nv)
    own = np.concatenate([np.flatnonzero(soles.foot == foot)[:3] for foot in feet])
    resting = dynamics().loads(still(q), standing(LEFT if feet == (0,) else LEFT + RIGHT)).torque[5]
    rng, dt, rows = np.random.default_rng(1), 5e-4, []
    swing = np.r_[np.zeros(6), rng.uniform(-8.0, 8.0, BODY.nv - 6)]
    for k in range(int(seconds / dt)):
        tau = np.r_[np.zeros(6), resting[6:]] + swing * np.sin(9.0 * k * dt) - 4.0 * np.r_[np.zeros(6), v[6:]]
        posed = BODY.at(q)
        points = points_in_world(posed, soles.joint[own], soles.local[own])
        J = BODY.point_jacobians(posed, soles.joint[own], points).reshape(3 * len(own), -1)
        after = BODY.point_jacobians(BODY.at(pin.integrate(model, q, 1e-6 * v)), soles.joint[own], points)
        a = pin.forwardDynamics(model, data, q, v, tau, J, (after.reshape(len(J), -1) - J) @ v / 1e-6, 1e-9)
        rows.append((q.copy(), data.lambda_c.reshape(-1, 3).sum(axis=0), tau))
        q = pin.integrate(model, q, dt * (v + 0.5 * dt * a))
        v = v + dt * a
    q_of, force, torque = (np.array(part)[::8] for part in zip(*rows, strict=True))
    return Simulated(8 * dt * np.arange(len(q_of)), q_of, force, torque)


def test_forces_and_moments_of_forward_dynamics_are_recovered() -> None:
    """In single support to 0.5 % of the weight and 1 N m."""
    truth = simulated(0.19, (0,))
    motion, count = motion_of(BODY, truth.time, truth.q), len(truth.time)
    loads = dynamics().loads(motion, standing(LEFT, count))
    inner = slice(8, -8)
    assert np.ptp(truth.force[inner, 2]) > 0.02 * WEIGHT  # it moves
    np.testing.assert_allclose(loads.force[inner, 0], truth.force[inner], atol=5e-3 * WEIGHT)
    np.testing.assert_allclose(loads.torque[inner, 6:], truth.torque[inner, 6:], atol=1.0)
    np.testing.assert_allclose(loads.force[inner, 1], 0.0, atol=1e-9)


def test_with_both_feet_on_the_ground_their_sum_is_recovered() -> None:
    """To 0.5 % of the weight."""
    truth = simulated(0.19, (0, 1))
    motion, count = motion_of(BODY, truth.time, truth.q), len(truth.time)
    loads, inner = dynamics().loads(motion, standing(LEFT + RIGHT, count)), slice(8, -8)
    assert np.ptp(truth.force[inner, 2]) > 0.02 * WEIGHT
    np.testing.assert_allclose(loads.force[inner].sum(axis=1), truth.force[inner], atol=5e-3 * WEIGHT)
    assert (loads.force[inner, :, 2] > 0.2 * WEIGHT).all()


def test_noise_has_its_variance_and_its_correlation() -> None:
    noise = smooth_noise(np.random.default_rng(0), np.linspace(0.0, 1.0, 101), 3000, 0.1)
    assert np.mean(np.square(noise)) == pytest.approx(1.0, abs=0.05)
    for lag in (5, 10, 20):
        assert np.mean(noise[lag:] * noise[:-lag]) == pytest.approx(np.exp(-0.5 * (lag / 10.0) ** 2), abs=0.05)


def test_samples_scatter_as_poses_do_and_repeat_with_their_seed() -> None:
    """A body at rest whose poses are certain has certain forces; wider poses give wider forces."""
    d, motion, support = dynamics(), still(leaning(0.01)), standing(LEFT + RIGHT)
    settings = UncertaintySettings(strike=0.0)
    spreads = []
    for std in (0.0, 1e-3, 3e-3):
        covariance = np.tile(std**2 * np.eye(BODY.nv), (len(TIME), 1, 1))
        forces = []
        for rng in map(np.random.default_rng, (5, 5)):
            others = [motion_of(BODY, TIME, poses_off(rng, BODY, TIME, motion.q, covariance, 0.2)) for _ in range(6)]
            forces.append(np.array([s.force for s in samples_of(rng, d, motion, others, support, settings)]))
        np.testing.assert_allclose(*forces, rtol=1e-6)  # but for the solver's last digits
        spreads.append(forces[0].sum(axis=2)[:, :, 2].std(axis=0).mean())
    assert spreads[0] < 1e-3 * WEIGHT
    assert spreads[0] < spreads[1] < spreads[2]


def test_a_trunk_that_lengthens_presses_on_the_ground_by_the_mass_that_it_lifts() -> None:
    trunk, d, time = Trunk.of(BODY), dynamics(), np.arange(30) / 100.0
    assert trunk is not None
    upper = sum(person_inertias(BODY, MASS)[j].mass for j in trunk.above)
    assert 0.4 * MASS < upper < 0.6 * MASS  # trunk, head and arms
    stretch = 0.01 * np.square(time) / 0.1**2
    q = np.tile(leaning(0.0), (30, 1))
    rigid, lifted = (d.force_of_acceleration(motion_of(BODY, time, q, s)) for s in (None, stretch))
    up = BODY.at(q[0]).rotations[trunk.joint] @ trunk.axis
    np.testing.assert_allclose(lifted - rigid, np.tile(2.0 * upper * up, (30, 1)), atol=0.01)
