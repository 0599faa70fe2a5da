"""Measures against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator import evaluation
from estimator.evaluation import LIMB_JOINTS, Reference, evaluate_points, mpjpe, pa_mpjpe
from humanoid.body import Body
from humanoid.errors import InputError
from humanoid.subject import load_subject

HIPS = [LIMB_JOINTS.index("left_hip"), LIMB_JOINTS.index("right_hip")]


@pytest.fixture
def truth() -> np.ndarray:
    return np.random.default_rng(3).normal(size=(5, len(LIMB_JOINTS), 3))


def test_identical_points_have_no_error(truth: np.ndarray) -> None:
    assert np.abs(mpjpe(truth, truth)).max() == 0.0
    assert np.abs(pa_mpjpe(truth, truth)).max() < 1e-12


def test_hips_remove_translation_and_nothing_else(truth: np.ndarray) -> None:
    offset = np.array([3.0, -4.0, 12.0])
    np.testing.assert_allclose(mpjpe(truth + offset, truth), 13.0)
    np.testing.assert_allclose(mpjpe(truth + offset, truth, HIPS), 0.0, atol=1e-12)
    moved = truth.copy()
    moved[:, LIMB_JOINTS.index("left_wrist")] += [0.0, 0.0, 0.12]
    np.testing.assert_allclose(mpjpe(moved, truth, HIPS), 0.12 / 12)
    moved = truth.copy()
    moved[:, HIPS[0]] += [0.2, 0.0, 0.0]  # moves the root by 0.1: the other eleven are off by that, the hip by 0.1
    np.testing.assert_allclose(mpjpe(moved, truth, HIPS), 0.1)


def test_procrustes_removes_similarity_not_reflection(truth: np.ndarray) -> None:
    R = Rotation.random(5, random_state=1).as_matrix()
    similar = 0.7 * np.einsum("tij,tlj->tli", R, truth) + np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(pa_mpjpe(similar, truth), 0.0, atol=1e-12)
    assert pa_mpjpe(truth * [1.0, 1.0, -1.0], truth).min() > 0.1


def test_procrustes_is_optimal(truth: np.ndarray) -> None:
    # Umeyama minimises squares: no nearby rotation or scale may do better
    rng = np.random.default_rng(0)
    points = truth[0] + 0.3 * rng.normal(size=truth[0].shape)
    aligned = evaluation.procrustes(points, truth[0])
    best = ((aligned - truth[0]) ** 2).sum()
    centre = aligned.mean(axis=0)
    for _ in range(50):
        R = Rotation.from_rotvec(rng.normal(scale=0.02, size=3)).as_matrix()
        other = (1.0 + rng.normal(scale=0.02)) * (aligned - centre) @ R.T + centre + rng.normal(scale=0.01, size=3)
        assert ((other - truth[0]) ** 2).sum() >= best


def test_best_of_k_and_missing_modes(truth: np.ndarray) -> None:
    modes = np.full((5, 3, *truth.shape[1:]), np.nan)
    modes[:, 0] = truth + np.linspace(0.0, 1.0, 12)[:, None]
    modes[:3, 2] = truth[:3]
    found = evaluation.best_of_k(modes, truth, lambda p, r: mpjpe(p, r))
    np.testing.assert_allclose(found[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[3:], 0.5 * np.sqrt(3.0))


def test_unknown_reference_points_are_left_out(truth: np.ndarray) -> None:
    points = truth.copy()
    points[:, 2] += 0.6
    reference = truth.copy()
    reference[0, 2] = np.nan  # the only wrong joint is unknown in frame 0
    reference[1] = np.nan
    found = evaluate_points(LIMB_JOINTS, points, points[:, None], np.arange(5.0), Reference(LIMB_JOINTS, reference))
    assert (found["frames_compared"], found["frames_missing"]) == (4, 1)
    assert found["mpjpe"] == pytest.approx(0.6 * np.sqrt(3.0) / 12 * 3 / 4)
    assert found["per_joint"]["left_elbow"] == pytest.approx(0.6 * np.sqrt(3.0))
    assert found["per_joint"]["left_knee"] == pytest.approx(0.0)


def test_names_may_be_in_any_order_and_lengths_differ(truth: np.ndarray) -> None:
    order = np.random.default_rng(0).permutation(12)
    names = ("nose", *(LIMB_JOINTS[i] for i in order))
    points = np.concatenate([np.zeros((5, 1, 3)), truth[:, order]], axis=1)
    longer = np.concatenate([truth, truth[:2]])
    found = evaluate_points(names, points, points[:, None], np.arange(5) / 30.0, Reference(LIMB_JOINTS, longer))
    assert found["mpjpe"] == pytest.approx(0.0)
    assert (found["frames_compared"], found["frames_missing"]) == (5, 2)


def test_frames_meet_by_time() -> None:
    slow, fast = np.arange(6) / 30.0, np.arange(12) / 60.0
    np.testing.assert_array_equal(evaluation.match_frames(fast, slow, 6), np.arange(6) * 2)
    found = evaluation.match_frames(slow, fast, 12)  # every second frame of the finer reference has a counterpart
    np.testing.assert_array_equal(found[::2], np.arange(6))
    assert (found[1::2] == -1).all()
    late = evaluation.match_frames(slow + 1.0, slow, 6)
    assert (late == -1).all()
    np.testing.assert_array_equal(evaluation.match_frames(slow, None, 8), [0, 1, 2, 3, 4, 5, -1, -1])


def test_limits_are_counted_by_frame() -> None:
    body = Body(load_subject("human34"))
    q = np.tile(body.neutral, (4, 1))
    assert evaluation.limit_violations(body, q) == 0
    q[1, body.bounded_q[:2]] = body.upper[body.bounded_q[:2]] + 1e-6
    q[2, body.bounded_q[3]] = body.upper[body.bounded_q[3]] + 1e-12
    q[3, 0] = 1e6  # the root is free
    assert evaluation.limit_violations(body, q) == 1


def test_a_foreign_reference_is_refused_by_name(truth: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"tail.*left_shoulder"):
        evaluate_points(LIMB_JOINTS, truth, truth[:, None], np.arange(5.0), Reference(("tail",), truth[:, :1]))


def test_reference_from_a_file(tmp_path: Path, truth: np.ndarray) -> None:
    np.savez(tmp_path / "a.npz", landmarks=truth, landmark_names=LIMB_JOINTS, time=np.arange(5) / 25.0)
    reference = Reference.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(reference.points, truth)
    np.testing.assert_allclose(reference.time, np.arange(5) / 25.0)
    assert reference.names == LIMB_JOINTS
