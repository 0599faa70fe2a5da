"""Measures against closed forms."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from estimator.data.formats.opensim import Coordinates, read_mot, write_mot
from estimator.runs import evaluation
from estimator.runs.coordinates import opensim_coordinates
from estimator.runs.evaluation import LIMB_JOINTS, evaluate, evaluate_points, mpjpe, pa_mpjpe
from estimator.runs.reference_motion import Reference
from estimator.synthesis.scene import write_truth
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject, subject_from_text
from humanoid.support.errors import InputError
from kinemode.terminal import report

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
    errors = evaluation.best_of_k(modes, truth, lambda p, r: mpjpe(p, r))
    np.testing.assert_allclose(errors[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(errors[3:], 0.5 * np.sqrt(3.0))


def test_unknown_reference_points_are_left_out(truth: np.ndarray) -> None:
    points = truth.copy()
    points[:, 2] += 0.6
    reference = truth.copy()
    reference[0, 2] = np.nan  # the only wrong joint, now unknown in frame 0
    reference[1] = np.nan
    figures = evaluate_points(LIMB_JOINTS, points, points[:, None], np.arange(5.0), Reference(LIMB_JOINTS, reference))
    assert (figures["frames_compared"], figures["frames_missing"]) == (4, 1)
    assert figures["mpjpe"] == pytest.approx(0.6 * np.sqrt(3.0) / 12 * 3 / 4)
    assert figures["per_joint"]["left_elbow"] == pytest.approx(0.6 * np.sqrt(3.0))
    assert figures["per_joint"]["left_knee"] == pytest.approx(0.0)


def test_names_may_be_in_any_order_and_lengths_differ(truth: np.ndarray) -> None:
    order = np.random.default_rng(0).permutation(12)
    names = ("nose", *(LIMB_JOINTS[i] for i in order))
    points = np.concatenate([np.zeros((5, 1, 3)), truth[:, order]], axis=1)
    longer = np.concatenate([truth, truth[:2]])
    figures = evaluate_points(names, points, points[:, None], np.arange(5) / 30.0, Reference(LIMB_JOINTS, longer))
    assert figures["mpjpe"] == pytest.approx(0.0)
    assert (figures["frames_compared"], figures["frames_missing"]) == (5, 2)


def test_frames_meet_by_time() -> None:
    slow, fast = np.arange(6) / 30.0, np.arange(12) / 60.0
    np.testing.assert_array_equal(evaluation.match_frames(fast, slow, 6), np.arange(6) * 2)
    matched = evaluation.match_frames(slow, fast, 12)  # every second frame of the finer reference has a counterpart
    np.testing.assert_array_equal(matched[::2], np.arange(6))
    assert (matched[1::2] == -1).all()
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
    with pytest.raises(InputError, match=r"run: left_shoulder.*reference: tail"):
        evaluate_points(LIMB_JOINTS, truth, truth[:, None], np.arange(5.0), Reference(("tail",), truth[:, :1]))


def test_the_smoothed_best_is_not_counted_among_the_k_hypotheses(truth: np.ndarray) -> None:
    modes = np.stack([truth * 1.2, truth * 1.1], axis=1)
    figures = evaluate_points(LIMB_JOINTS, truth, modes, np.arange(5.0), Reference(LIMB_JOINTS, truth))
    assert figures["mpjpe"] == 0.0
    assert figures["best_of_k_mpjpe"] == pytest.approx(mpjpe(truth * 1.1, truth, HIPS).mean())
    assert figures["best_of_k_mpjpe"] > 0.01


def test_limb_joints_alone_count_where_there_are_three(truth: np.ndarray) -> None:
    names = (*LIMB_JOINTS, "nose")
    points = np.concatenate([truth, truth[:, :1] + 5.0], axis=1)
    reference = Reference(names, np.concatenate([truth, truth[:, :1]], axis=1))
    figures = evaluate_points(names, points, points[:, None], np.arange(5.0), reference)
    assert (figures["joints"], figures["aligned"], figures["mpjpe"]) == (LIMB_JOINTS, "hips aligned", 0.0)


def robot() -> Body:
    """A turning joint with limits, one without, a sliding one; a landmark on each link."""
    limits = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
    kinds = (("bend", "revolute", "a", "b"), ("spin", "continuous", "b", "c"), ("lift", "prismatic", "c", "d"))
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
        f'<origin xyz="0.3 0.1 0.2"/>{limits}</joint>'
        for name, kind, parent, child in kinds
    )
    links = "".join(f'<link name="{n}"/>' for n in "abcd")
    marks = "".join(f'<landmark name="on_{n}" link="{n}" xyz="0.1 0 0"/>' for n in "abcd")
    return Body(subject_from_text(f'<robot name="r">{links}{joints}{marks}</robot>', source="test", base="fixed"))


def run_of(body: Body, q: np.ndarray) -> Any:
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    time = np.arange(len(q)) / 10.0
    return SimpleNamespace(body=body, q=q, time=time, landmarks=points, mode_landmarks=points[:, None])


def test_a_robot_is_compared_by_its_own_landmarks_and_joints(tmp_path: Path) -> None:
    body = robot()
    assert body.q_names == ("bend", "spin_cos", "spin_sin", "lift")
    true = np.array([pin.integrate(body.model, body.neutral, np.array([0.1 * t, 3.0, 0.05 * t])) for t in range(6)])
    write_truth(tmp_path / "truth.npz", body, true, np.arange(6) / 10.0)
    reference = Reference.load(tmp_path / "truth.npz")
    exact = evaluate(run_of(body, true), reference)
    assert exact.joints == ("on_a", "on_b", "on_c", "on_d")
    assert exact.aligned == "centred"
    assert exact.mpjpe == pytest.approx(0.0, abs=1e-12)
    assert exact.frames_compared == 6
    off = np.array([pin.integrate(body.model, q, np.array([-0.2, 0.5, 0.03])) for q in true])  # spin: 3 to 3.5 > pi
    figures = evaluate(run_of(body, off), reference)
    assert figures.angle_errors == pytest.approx({"bend": np.rad2deg(0.2), "spin": np.rad2deg(0.5)})
    assert figures.slide_errors == pytest.approx({"lift": 0.03})
    assert figures.joint_scores["spin"].bias == pytest.approx(np.rad2deg(0.5))
    assert figures.mpjpe > 0.01
    names, values = opensim_coordinates(body, true)
    write_mot(tmp_path / "truth.mot", names, values, np.arange(6) / 10.0, title="truth")
    angles = evaluate(run_of(body, off), Reference.load(tmp_path / "truth.mot"))
    assert angles.angle_errors == pytest.approx(figures.angle_errors, abs=1e-6)
    assert angles.slide_errors == pytest.approx(figures.slide_errors, abs=1e-6)
    assert (angles.joints, angles.frames_compared, angles.frames_missing) == ((), 6, 0)
    assert np.isnan(angles.mpjpe)


def test_scores_of_joints_are_means_of_differences_the_shorter_way_round() -> None:
    """Also where joints have limits, and the reference is a whole turn off, or lacks a frame."""
    body = robot()
    off, turns = np.array([0.1, -0.3, 0.2, 0.4]), 2.0 * np.pi * np.array([0, 1, -1, 0])
    q = np.array([pin.integrate(body.model, body.neutral, np.array([x, x + 3.0, x / 10.0])) for x in off])
    true = np.stack([turns, turns + 3.0, 0.0 * off, 0.0 * off], axis=1)
    true[3, 0] = np.nan
    reference = Reference((), np.zeros((4, 0, 3)), None, Coordinates(("bend", "spin", "lift", "other"), true))
    scores = evaluate(run_of(body, q), reference).joint_scores
    assert list(scores) == ["bend", "spin", "lift"]
    for name, known, unit, kind in (("bend", 3, 180.0 / np.pi, "deg"), ("spin", 4, 180.0 / np.pi, "deg"),
                                    ("lift", 4, 0.1, "m")):  # fmt: skip
        here, score = unit * off[:known], scores[name]
        assert (score.unit, score.frames) == (kind, known)
        assert score.mean_absolute == pytest.approx(np.mean(np.abs(here)))
        assert score.rms == pytest.approx(np.sqrt(np.mean(here**2)))
        assert score.bias == pytest.approx(np.mean(here))
    long = subject_from_text(body.subject.urdf.replace('lower="-2" upper="2"', 'lower="-5" upper="5"'), source="test")
    there = Reference((), np.zeros((1, 0, 3)), None, Coordinates(("bend",), np.array([[-4.0]])))
    far = evaluate(run_of(Body(long), q[:1]), there)
    assert far.angle_errors["bend"] == pytest.approx(np.rad2deg(4.1))  # nearly a turn apart, both within limits


def test_the_table_of_joints_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    body = robot()
    q = np.array([pin.integrate(body.model, body.neutral, np.array([x, 0.0, 0.0])) for x in np.deg2rad([3.0, -1.0])])
    zero = Reference((), np.zeros((2, 0, 3)), None, Coordinates(("bend", "spin"), np.zeros((2, 2)), in_degrees=True))
    result = evaluate(run_of(body, q), zero)
    report.print_evaluation(result)
    rows = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines() if line.split()}
    assert rows["bend"] == ["2.00", "deg", "2.24", "deg", "+1.00", "deg", "2.00", "deg", "2.00", "deg", "2"]
    assert rows["spin"] == ["0.00", "deg", "0.00", "deg", "+0.00", "deg", "0.00", "deg", "0.00", "deg", "2"]
    assert rows["mean"] == ["of", "all", "1.00", "deg", "1.12", "deg", "-", "1.00", "deg", "1.00", "deg", "2"]
    assert "bend" in result._repr_html_()
    assert repr(result).startswith("<Evaluation: frames 2, mean error of 2 joint angles 1.00 deg")


def test_what_was_compared_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    body = robot()
    q = np.tile(body.neutral, (3, 1))
    names = body.landmark_names
    reference = Reference(names, run_of(body, q).landmarks, None, Coordinates(("lift",), q[:, 3:] + 0.002))
    report.print_evaluation(evaluate(run_of(body, q), reference))
    printed = capsys.readouterr().out
    for text in ("4 shared landmarks", "MPJPE (centred)", "on_a", "2.0 mm"):
        assert text in printed
    assert "hips" not in printed.replace("without hips", "")


def test_fewer_than_three_landmarks_are_not_aligned() -> None:
    body = robot()
    run = run_of(body, np.tile(body.neutral, (3, 1)))
    figures = evaluate(run, Reference(("on_d",), run.landmarks[:, 3:] + [0.0, 0.0, 0.01]))
    assert (figures.joints, figures.aligned) == (("on_d",), "nothing aligned")
    assert figures.mpjpe == pytest.approx(0.01)
    assert np.isnan(figures.pa_mpjpe)


def test_both_lists_are_printed_where_nothing_is_shared(tmp_path: Path) -> None:
    body = robot()
    run = run_of(body, np.tile(body.neutral, (3, 1)))
    other = Reference(("tail",), np.zeros((3, 1, 3)), None, Coordinates(("knee",), np.zeros((3, 1))))
    with pytest.raises(InputError, match=r"run: on_a.*reference: tail.*run: bend, spin, lift; of the reference: knee"):
        evaluate(run, other)
    write_mot(tmp_path / "a.mot", ("knee",), np.zeros((3, 1)), np.arange(3) / 10.0, title="a")
    with pytest.raises(InputError, match=r"landmarks of the run: on_a.*of the reference: none"):
        evaluate(run, Reference.load(tmp_path / "a.mot"))


def test_files_that_are_not_motions(tmp_path: Path) -> None:
    good = "a\nnRows=1\nendheader\ntime knee\n0.0 1.5\n"
    bad = {
        "endheader": good.replace("endheader\n", ""),
        "first column": good.replace("time ", "t "),
        "2 are expected": good.replace("0.0 1.5", "0.0"),
        "not a number": good.replace("1.5", "x"),
        "rising": good + "0.0 1.0\n",
    }
    path = tmp_path / "a.mot"
    path.write_text(good)
    assert not read_mot(path)[0].in_degrees
    for message, text in bad.items():
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            Reference.load(path)


def test_reference_from_a_file(tmp_path: Path, truth: np.ndarray) -> None:
    np.savez(tmp_path / "a.npz", landmarks=truth, landmark_names=LIMB_JOINTS, time=np.arange(5) / 25.0)
    reference = Reference.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(reference.points, truth)
    np.testing.assert_allclose(reference.time, np.arange(5) / 25.0)
    assert reference.names == LIMB_JOINTS
