"""Standing feet: found from keypoints at rest, and held in place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.observation import Observation
from estimator.data.standing import SPAN, StandingPoints, with_standing
from estimator.energy.standing import HeldPoints, LevelFeet, Soles, standing_ties
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.tracking.smoothing import SmoothSettings, smooth
from humanoid.subject.landmarks import mirror_index
from tests.builders import body_of, camera_at, observe, random_pose

BODY = body_of("human34")
NAMES = BODY.landmark_names
HEEL, TOE, ANKLE = (NAMES.index(f"left_{name}") for name in ("heel", "big_toe", "ankle"))
FPS = 30.0
ASIDE, BEFORE = camera_at(0.0, distance=3.5), camera_at(90.0, distance=3.5)


def squat(frames: int, feet: float = 0.0) -> np.ndarray:
    """Down and up again, the left foot flat in place, or gliding along y with a speed `feet` [m/s]."""
    poses = []
    for t, bend in enumerate(0.5 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, frames)))):
        q = BODY.neutral.copy()
        for side in ("left", "right"):
            for joint, angle in (("hip_flexion", 1.3), ("knee_flexion", 1.6), ("ankle_dorsiflexion", 0.5)):
                q[BODY.model.idx_qs[BODY.model.getJointId(f"{side}_{joint}")]] = 0.05 + angle * bend
        R_pelvis_foot = BODY.at(q).rotations[BODY.landmark_joint[HEEL]]
        q[3:7] = pin.Quaternion(R_pelvis_foot.T).coeffs()
        q[:3] += np.array([0.0, feet * t / FPS, 0.0]) - BODY.landmarks(BODY.at(q))[ANKLE]
        poses.append(q)
    return np.array(poses)


def seen(poses: np.ndarray, *cameras: object, noise: float = 1.0) -> list[Observation]:
    rng = np.random.default_rng(1)
    shots = [observe(BODY, q, cameras, noise=noise, rng=rng, index=i, time=i / FPS) for i, q in enumerate(poses)]
    return with_standing([replace(s, jitter=(noise,) * len(cameras)) for s in shots], NAMES)


def test_feet_stand_while_the_rest_moves() -> None:
    stands = np.array([o.standing for o in seen(squat(40), ASIDE)])
    assert not stands[:2].any()  # two instants do not determine a speed
    assert (stands[5:, [HEEL, TOE]] > 0.9).mean() > 0.95
    others = [i for i, name in enumerate(NAMES) if not name.endswith(("heel", "toe"))]
    assert not stands[:, others].any()


@pytest.mark.parametrize("speed", [0.6, 1.5])
def test_feet_that_glide_do_not_stand(speed: float) -> None:
    """In one camera feet gliding towards it may seem to stand; a second camera shows the motion."""
    glides = squat(14, speed)
    assert np.array([o.standing for o in seen(glides, ASIDE)])[6:, [HEEL, TOE]].max() < 0.1
    assert np.array([o.standing for o in seen(glides, BEFORE)])[6:, [HEEL, TOE]].min() > 0.1
    assert np.array([o.standing for o in seen(glides, BEFORE, ASIDE)])[6:, [HEEL, TOE]].max() < 0.1


def test_an_ankle_stands_for_a_foot_that_is_not_seen() -> None:
    blind = []
    for o in seen(squat(20), ASIDE):
        hidden = np.array([name.startswith("left") and name.endswith(("heel", "toe")) for name in NAMES])
        blind.append(replace(o, confidence=np.where(hidden, 0.0, o.confidence)))
    stands = np.array([o.standing for o in with_standing(blind, NAMES)])
    assert (stands[6:, ANKLE] > 0.5).mean() > 0.9
    assert not stands[:, [HEEL, TOE, NAMES.index("right_ankle")]].any()


def test_standing_depends_on_the_last_moments_alone() -> None:
    """So that a stream, a whole clip and a frame of a run file agree."""
    observations = seen(squat(20), ASIDE)
    late = [o for o in observations if o.time >= observations[-1].time - 1.5 * SPAN]
    np.testing.assert_array_equal(with_standing(late, NAMES)[-1].standing, observations[-1].standing)
    points = StandingPoints(NAMES)
    for o in observations[:-1]:
        points.standing(o)
        points.add(o)
    np.testing.assert_array_equal(points.standing(observations[-1]), observations[-1].standing)


def test_exchanged_sides_exchange_what_stands() -> None:
    (observation,) = seen(squat(20), ASIDE)[-1:]
    standing = np.arange(float(len(NAMES)))
    mirror = mirror_index(NAMES)
    exchanged = replace(observation, standing=standing).exchanged(mirror)
    assert exchanged.standing is not None
    assert exchanged.standing[HEEL] == standing[NAMES.index("right_heel")]


def test_a_tie_has_the_derivatives_of_its_value() -> None:
    rng = np.random.default_rng(2)
    standing = np.zeros(len(NAMES))
    standing[[HEEL, TOE]] = 1.0, 0.4
    (tie,), nv = standing_ties(BODY, standing, 0.05, 1.3), BODY.nv
    poses = [random_pose(BODY, rng, share=0.3, turn=0.2)]
    poses.append(BODY.integrate(poses[0], rng.normal(0.0, 0.05, nv)))

    def value(step: np.ndarray) -> float:
        a, b = (BODY.at(BODY.integrate(q, v)) for q, v in zip(poses, step.reshape(2, nv), strict=True))
        return tie.accumulate_pair(a, b, np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv)))

    gradient, hessian = np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv))
    tie.accumulate_pair(*(BODY.at(q) for q in poses), gradient, hessian)
    for v in rng.normal(size=(5, 2 * nv)):
        slope = (value(1e-5 * v) - value(-1e-5 * v)) / 2e-5
        assert gradient @ v == pytest.approx(slope, rel=1e-5)
    assert np.linalg.eigvalsh(hessian)[0] > -1e-6
    same = BODY.at(poses[0])
    assert tie.accumulate_pair(same, same, np.zeros(2 * nv), np.zeros((2 * nv, 2 * nv))) == 0.0


def test_targets_are_the_tie_with_the_earlier_pose_held() -> None:
    standing = np.zeros(len(NAMES))
    standing[HEEL] = 0.7
    before, after = (BODY.at(q) for q in squat(9, 0.3)[[2, 4]])
    (target,) = HeldPoints(BODY, standing, 0.02, 1.5).targets(before)
    gradient, hessian = np.zeros(2 * BODY.nv), np.zeros((2 * BODY.nv, 2 * BODY.nv))
    (tie,) = standing_ties(BODY, standing, 0.02, 1.5)
    tied = tie.accumulate_pair(before, after, gradient, hessian)
    own = np.zeros(BODY.nv)
    assert target.accumulate(after, own, np.zeros((BODY.nv, BODY.nv))) == pytest.approx(tied)
    np.testing.assert_allclose(own, gradient[BODY.nv :], atol=1e-9)
    assert HeldPoints(BODY, np.zeros(len(NAMES)), 0.02).targets(before) == []
    assert standing_ties(BODY, np.zeros(len(NAMES)), 0.02) == []


@pytest.mark.parametrize("angle", [-0.3, 0.2])
def test_a_foot_is_level_at_zero_and_pays_for_its_tilt(angle: float) -> None:
    """By the angle itself, for any heading; a foot that does not stand has no energy, nor has one without an upright
    body."""
    soles, up, std = Soles.of(BODY), np.array([0.0, 0.0, 1.0]), 0.1
    assert [NAMES[i] for i in soles.toe] == ["left_big_toe", "right_big_toe"]
    q = pin.neutral(BODY.model)
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 0.0, 0.8)).coeffs()
    level = LevelFeet(BODY, soles, np.ones(2), up, std)
    assert level.value(BODY.at(q)) == pytest.approx(0.0, abs=1e-12)
    q[BODY.model.idx_qs[BODY.model.getJointId("left_ankle_dorsiflexion")]] = angle
    paid = 2.0 * np.log1p((np.sin(angle) / std) ** 2 / 4.0)  # Lorentzian of nu 4; the sole lies along the foot
    assert level.value(BODY.at(q)) == pytest.approx(paid, rel=0.02)
    assert LevelFeet(BODY, soles, np.array([0.05, 1.0]), up, std).value(BODY.at(q)) == pytest.approx(0.0, abs=1e-12)
    assert not len(Soles.of(body_of("arm8")).heel)


def test_standing_feet_are_level_in_the_energy_unless_nothing_stands() -> None:
    (observation,) = seen(squat(12), ASIDE)[-1:]
    for weight, names in ((1.0, ["level feet"]), (0.0, [])):
        model = CostModel(BODY, CostSettings(standing_weight=weight))
        terms = model.cost(model.observation_term(observation)).terms
        assert [t.name for t in terms if isinstance(t, LevelFeet)] == names


def test_held_feet_slide_less_and_the_rest_is_no_worse() -> None:
    truth, model = squat(24), CostModel(BODY)
    camera = camera_at(20.0, distance=3.0, height=1.0)
    observations = seen(truth, camera, noise=2.0)
    costs = [model.cost(model.observation_term(o)) for o in observations]
    times = np.array([o.time for o in observations])
    ties = [model.standing_ties(o.standing, 1.0 / FPS) for o in observations]
    motion = SmoothSettings().motion(model)
    true = np.array([BODY.landmarks(BODY.at(x)) for x in truth])

    def errors(q: np.ndarray) -> tuple[float, float]:
        points = np.array([BODY.landmarks(BODY.at(x)) for x in q])
        slid = np.linalg.norm(np.diff(points[6:, [HEEL, TOE]], axis=0), axis=2).sum(axis=0).mean()
        return float(slid), float(np.linalg.norm(points - true, axis=2).mean())

    free, held = (errors(smooth(BODY, costs, times, truth, motion, ties=t)) for t in (None, ties))
    assert held[0] < 0.25 * free[0]
    assert held[1] < 1.1 * free[1]
