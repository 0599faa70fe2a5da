"""The centre of mass over the standing feet: segment masses, the term, and when it applies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import bent, body_of, camera_at, observe, random_pose

from estimator.data.cameras.camera import guessed_camera
from estimator.data.observation import Observation
from estimator.data.standing import HIP_SPAN, with_standing
from estimator.energy.balance import Balance, BalanceSettings, MassSpread, balance_terms
from estimator.energy.priors import up_is_assumed
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.tracking.registry import settings_for
from humanoid.kinematics.body import Body
from humanoid.shape.segment_masses import mass_points
from humanoid.subject.example_robots import installed
from humanoid.subject.landmarks import foot_landmarks
from humanoid.subject.subject import load_subject

BODY = body_of("human34")
NAMES = BODY.landmark_names
BOTH = foot_landmarks(NAMES)
FEET = np.array([NAMES.index(name) for name in BOTH])
CAMERA = camera_at(20.0, distance=3.5)
UP = np.array([0.0, 0.0, 1.0])
STANCE = MassSpread(spread=0.5, width=0.02, tail=13.0, held=0.04)


def masses() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points = mass_points(BODY)
    assert points is not None
    return points.joint, points.local, points.share


def standing(q: np.ndarray, *names: str, seated: float = 0.0) -> Observation:
    """A frame in which some landmarks stand."""
    seen = observe(BODY, q, (CAMERA,))
    return replace(seen, standing=np.array([float(name in names) for name in NAMES]), seated=seated)


def test_the_centre_of_mass_of_a_urdf_with_masses_is_pinocchios() -> None:
    if "talos" not in installed():
        pytest.skip("example-robot-data is not installed")
    body = Body(load_subject("example-robot-data:talos"))
    points = mass_points(body)
    assert points is not None
    assert points.from_urdf
    q = random_pose(body, np.random.default_rng(0))
    posed = body.at(q)
    ours = points.share @ (
        np.einsum("nij,nj->ni", posed.rotations[points.joint], points.local) + posed.translations[points.joint]
    )
    # links of less than a gram are left out
    np.testing.assert_allclose(ours, pin.centerOfMass(body.model, body.model.createData(), q), atol=2e-3)


def test_a_body_without_feet_masses_or_a_free_root_is_not_balanced() -> None:
    for name in ("arm8", "upper13", "gripper"):
        body = body_of(name)
        seen = replace(observe(body, body.neutral, (CAMERA,)), standing=np.ones(len(body.landmark_names)))
        assert balance_terms(body, seen, BalanceSettings()) == []


def test_the_value_is_the_stated_mixture_of_the_offset() -> None:
    """By hand: the offset of the centre of mass from the middle of the feet, whitened by their spread."""
    q, (joint, local, share) = bent(BODY, left_hip_flexion=0.4, right_hip_flexion=0.5, lumbar_flexion=0.6), masses()
    posed = BODY.at(q)
    centre = share @ (np.einsum("nij,nj->ni", posed.rotations[joint], local) + posed.translations[joint])
    feet = BODY.landmarks(posed)[FEET, :2]
    r, S = centre[:2] - feet.mean(axis=0), np.cov(feet.T, bias=True)
    x = r @ np.linalg.solve(STANCE.width**2 * np.eye(2) + STANCE.spread**2 * S, r)
    near, far = (1.0 - STANCE.held) * np.exp(-0.5 * x) / 2.0, STANCE.held / STANCE.tail * (1.0 + x / STANCE.tail) ** -2
    expected = -np.log((near + far) / ((1.0 - STANCE.held) / 2.0 + STANCE.held / STANCE.tail))
    term = Balance(BODY, FEET, masses(), UP, STANCE, weight=1.5)
    assert x > 1.0
    assert term.value(posed) == pytest.approx(1.5 * expected)
    assert term.deviations(posed) == pytest.approx(np.sqrt(x))


def test_the_tail_allows_for_external_support() -> None:
    """Far from the feet each further step costs less, and the heading does not matter."""
    term, values = Balance(BODY, FEET, masses(), UP, STANCE), []
    for lean in np.linspace(0.0, 1.1, 12):
        q = BODY.neutral.copy()
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, lean, 0.7)).coeffs()
        values.append(term.value(BODY.at(q)))
    steps = np.diff(values)
    assert np.all(steps > 0.0)
    assert steps[-1] < 0.25 * steps.max()
    assert values[-1] < 16.0


def test_balance_needs_standing_feet_and_counts_less_for_a_seated_person() -> None:
    q, settings = bent(BODY, lumbar_flexion=1.2), BalanceSettings()
    value = {
        what: sum(term.value(BODY.at(q)) for term in balance_terms(BODY, seen, settings))
        for what, seen in {
            "both": standing(q, *BOTH), "one": standing(q, *BOTH[:3]), "none": standing(q),
            "ankles": standing(q, "left_ankle", "right_ankle"), "sits": standing(q, *BOTH, seated=1.0),
        }.items()
    }  # fmt: skip
    assert value["none"] == 0.0
    assert value["ankles"] == pytest.approx(value["both"])
    assert 0.0 < value["sits"] < 0.5 * value["both"]
    assert min(value["one"], value["both"]) > 0.0
    assert balance_terms(BODY, standing(q, *BOTH), replace(settings, weight=0.0)) == []


def test_a_robot_balances_only_on_request() -> None:
    if "talos" not in installed():
        pytest.skip("example-robot-data is not installed")
    body = Body(load_subject("example-robot-data:talos"))
    names = body.landmark_names
    heels = np.array([float(name.endswith(("heel", "toe", "ankle"))) for name in names])
    seen = replace(observe(body, body.neutral, (CAMERA,)), standing=heels)
    counts = [len(balance_terms(body, seen, BalanceSettings(robots=asked))) for asked in (False, True)]
    assert counts == [0, 1]


def test_up_from_a_held_camera_alone_is_less_certain() -> None:
    guess = guessed_camera("phone", (720, 1280))
    assert up_is_assumed((guess,))
    assert not up_is_assumed((CAMERA,))
    assert not up_is_assumed((guess, CAMERA))
    q = bent(BODY, lumbar_flexion=1.2)
    q[:3] = [3.0, 0.0, 0.0]
    values = [
        balance_terms(BODY, replace(standing(q, *BOTH), cameras=(camera,)), BalanceSettings())[0].value(BODY.at(q))
        for camera in (guess, CAMERA)
    ]
    assert values[0] < values[1]


def test_the_energy_of_a_frame_has_balance_except_in_reproductions() -> None:
    seen = standing(BODY.neutral, *BOTH)
    for tracker, expected in (("css", True), ("css-paper", False), ("condensation", False)):
        model = CostModel(BODY, settings_for(tracker).cost)
        assert any(isinstance(term, Balance) for term in model.observation_term(seen).beside) is expected
    assert isinstance(CostSettings().terms[Balance.name], BalanceSettings)


@pytest.mark.parametrize(("bend", "moves", "expected"), [(1.4, 0.0, True), (1.4, 0.4, False), (0.2, 0.0, False)])
def test_hips_that_are_low_and_rest_may_be_seated(bend: float, moves: float, expected: bool) -> None:
    """A person on a chair, seen from the side: hips low and at rest, rising and sinking, or at rest but high."""
    camera, fps, frames = camera_at(90.0, distance=3.5), 30.0, int(30 * HIP_SPAN) + 10
    shots = []
    for t in range(frames):
        q = bent(BODY, **{f"{s}_{j}_flexion": bend for s in ("left", "right") for j in ("hip", "knee")})
        q[2] += moves * np.sin(4.0 * t / fps)
        shots.append(observe(BODY, q, (camera,), index=t, time=t / fps))
    resting = with_standing([replace(shot, jitter=(0.5,)) for shot in shots], NAMES)
    assert resting[5].seated == 0.0
    assert (resting[-1].seated > 0.5) is expected
