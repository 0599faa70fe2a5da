"""Uncertainty of a smoothed trajectory: known covariances, unseen stretches, other hypotheses, and run files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, random_pose
from test_fixed_lag import FEW, FPS, Track, tracked
from test_run_file import header, state_of

from estimator.data.formats.checked_arrays import DamageError
from estimator.energy.cost import Cost
from estimator.energy.priors import Transition
from estimator.inference.motion import MotionPrior, frame_shares
from estimator.runs import run_arrays, run_reader
from estimator.runs.posterior import Posterior, PosteriorCalibration
from estimator.runs.run_arrays import check_smoothed, joined, smoothed_in, smoothed_parts
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from estimator.synthesis.motion import authored_motion
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from estimator.tracking.smoothing import Smoothed, smooth_track
from estimator.tracking.smoothing.chain import FrameChain
from humanoid.kinematics.body import ROOT_PLACE_V
from tests.tiny_clip import FEW_STARTS

AS_IT_IS = PosteriorCalibration(1.0, 0.0, 1.0, 1.0, size_std=0.0, landmark_std=0.0)
BODY = body_of("arm8")
FRAMES, GAP = 26, range(7, 19)
TIMES = np.arange(5) * 0.04
LOOSE = MotionPrior(np.full(BODY.nv, 1e6), np.full(BODY.nv, 1e6))


def drawn_to(std: float) -> Cost:
    return Cost(BODY, [Transition(BODY, BODY.neutral, np.full(BODY.nv, std))])


def test_covariances_come_from_the_whole_hessian() -> None:
    motion = MotionPrior(np.full(BODY.nv, 0.5), np.full(BODY.nv, 4.0))
    rng, n = np.random.default_rng(2), 5 * BODY.nv
    costs = [drawn_to(std) for std in rng.uniform(0.1, 1.0, 5)]
    q = np.array([random_pose(BODY, rng) for _ in range(5)])
    chain = FrameChain(BODY, costs, TIMES, motion, 1e-3)
    blocks, whole = chain._model(q).blocks, np.zeros((n, n))
    for k in range(3):
        for t in range(5 - k):
            rows, columns = slice(t * BODY.nv, (t + 1) * BODY.nv), slice((t + k) * BODY.nv, (t + k + 1) * BODY.nv)
            whole[rows, columns] = blocks[k, t]
            whole[columns, rows] = blocks[k, t].T
    inverse = np.linalg.inv(whole).reshape(5, BODY.nv, 5, BODY.nv)
    np.testing.assert_allclose(chain.covariances(q, 0.0), np.einsum("tatb->tab", inverse), rtol=1e-3, atol=1e-9)


def test_a_prior_counts_once_and_what_lasts_less_often() -> None:
    """Frames without ties each have their own likelihood and prior. Firmly tied they share their likelihoods, counted
    once per independent frame, but not their priors."""
    seen, prior, q = 0.2, 0.3, np.tile(BODY.neutral, (5, 1))
    hessian = np.array([drawn_to(prior).at(pose).hessian for pose in q])
    cost = drawn_to(seen).plus(drawn_to(prior).terms)

    def std(motion: MotionPrior, lasting: float) -> np.ndarray:
        chain = FrameChain(BODY, [cost] * 5, TIMES, motion, 1e-3)
        return np.sqrt(np.einsum("tii->ti", chain.covariances(q, lasting, hessian)))

    alone = (seen**-2 + prior**-2) ** -0.5
    np.testing.assert_allclose(std(LOOSE, 0.0), alone, rtol=1e-4)
    firm = MotionPrior(np.full(BODY.nv, 1e-3), np.full(BODY.nv, 1e-3))
    np.testing.assert_allclose(std(firm, 0.0), (5 * seen**-2 + prior**-2) ** -0.5, rtol=1e-3)
    shares = frame_shares(np.diff(TIMES), 0.08)
    np.testing.assert_allclose(shares, [0.25, 0.5, 0.5, 0.5, 0.25])
    np.testing.assert_allclose(std(firm, 0.08), (shares.sum() * seen**-2 + prior**-2) ** -0.5, rtol=1e-3)


@pytest.fixture(scope="module")
def track() -> Track:
    """A person before two cameras, who is unseen in the gap."""
    body, few = body_of("human34"), {"css": FEW, "search": FEW_STARTS}
    whole = tracked(body, authored_motion(body, 0.4 + np.arange(FRAMES) / FPS), (15, 80), {})
    seen = [replace(o, confidence=0.0 * o.confidence) if o.index in GAP else o for o in whole.seen]
    tracker = make_tracker("css", body, settings_for("css", modes=3, changes=few))
    return whole._replace(search=tracker.search, seen=seen, results=[r for r, _ in run(tracker, seen, 0)])


@pytest.fixture(scope="module")
def smoothed(track: Track) -> Smoothed:
    return smooth_track(track.search, track.seen, track.results)


def test_uncertainty_grows_with_the_distance_from_seen_frames(track: Track, smoothed: Smoothed) -> None:
    assert smoothed.covariance is not None
    std = np.sqrt(np.einsum("tii->ti", smoothed.covariance))
    middle, edge = std[[12, 13]].min(axis=0), std[[GAP[0] - 2, GAP[-1] + 2]].max(axis=0)
    assert (middle[ROOT_PLACE_V] > 1.25 * edge[ROOT_PLACE_V]).all()  # joints have a prior, which widens no further
    assert np.median(middle / edge) > 1.0
    assert np.einsum("tii->ti", smoothed.covariance).min() >= 0.0


def test_modes_are_weighed_with_all_frames_in_mind(track: Track, smoothed: Smoothed) -> None:
    assert smoothed.mode is not None
    assert smoothed.weight is not None
    for t, result in enumerate(track.results):
        assert np.isfinite(smoothed.weight[t]).sum() == len(result.weight)
        assert np.nansum(smoothed.weight[t]) == pytest.approx(1.0)
    assert np.mean(smoothed.weight[np.arange(FRAMES), smoothed.mode]) > 0.5
    some = smoothed.frames([2, 9])
    np.testing.assert_array_equal(some.mode, smoothed.mode[[2, 9]])
    np.testing.assert_array_equal(some.q, smoothed.q[[2, 9]])


def test_the_posterior_is_around_the_trajectory_and_its_other_modes() -> None:
    """Two modes that differ in one joint, at a smoothed pose between them."""
    body = body_of("human34")
    joint = body.q_names.index("left_knee_flexion")
    first, second = body.neutral.copy(), body.neutral.copy()
    first[joint], second[joint] = 0.4, 1.2
    pose = first.copy()
    pose[joint] = 0.5
    known, zero = 1e-4 * np.eye(body.nv), np.zeros(2)
    result = FrameResult(
        0, 0.0, "tracked", np.array([first, second]), np.array([0.9, 0.1]), zero, np.array([known, 2.0 * known]),
        np.full(2, -1), zero, zero, ("as_detected",) * 2,
    )  # fmt: skip
    smoothed = Smoothed(pose[None], None, known[None], np.array([0]), np.array([[0.75, 0.25]]))
    posterior = Posterior.of_trajectory(body, result, smoothed, 0, AS_IT_IS)
    np.testing.assert_allclose(posterior.q[:, joint], [0.5, 1.3])
    np.testing.assert_allclose(posterior.weight, [0.75, 0.25])
    np.testing.assert_array_equal(posterior.best, pose)
    np.testing.assert_allclose(posterior.covariance, [known, known], atol=1e-12)
    alone = Posterior.of_trajectory(body, result, Smoothed(pose[None], None, known[None]), 0, AS_IT_IS)
    np.testing.assert_array_equal(alone.q, pose[None])


def written(file: Path, track: Track, smoothed: Smoothed) -> Run:
    with RunWriter.create(file, header(FRAMES, times=np.arange(FRAMES) / FPS)) as writer:
        for result in track.results:
            writer.append(result, state_of(result))
        writer.put_smoothed(smoothed)
        writer.finish()
    return Run.open(file)


def test_a_run_has_the_smoothed_trajectory(tmp_path: Path, track: Track, smoothed: Smoothed) -> None:
    stored = written(tmp_path / "a.run", track, smoothed)
    assert stored.smoothed is not None
    assert smoothed.covariance is not None
    assert stored.smoothed.covariance is not None
    np.testing.assert_allclose(stored.smoothed.covariance, smoothed.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(stored.smoothed.weight, smoothed.weight)
    np.testing.assert_array_equal(stored.posterior(3).best, stored.q[3])
    np.testing.assert_array_equal(stored.posterior(3, filtered=True).best, track.results[3].q[0])
    joint = stored["left_knee_flexion"]
    assert ((joint.low <= joint.value) & (joint.value <= joint.high)).all()
    assert joint.std[[12, 13]].min() > joint.std[[GAP[0] - 2, GAP[-1] + 2]].max()
    assert set(stored.status[list(GAP)]) == {"unobserved"}


def test_a_long_run_is_written_and_read_by_parts(
    tmp_path: Path, track: Track, smoothed: Smoothed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the values of a short one; its frames are released after reading."""
    names = ("q", "filtered_q", "time", "index", "status", "path", "weight", "energy", "mode_association", "mode_q")
    short = written(tmp_path / "short.run", track, smoothed)
    expected = {name: getattr(short, name) for name in names}
    monkeypatch.setattr(run_arrays, "_PART", 7)
    monkeypatch.setattr(run_reader, "_FEW", 7)
    long = written(tmp_path / "long.run", track, smoothed)
    for name in names:
        np.testing.assert_array_equal(expected[name], getattr(long, name))
    assert long.hypothesis_count == short.hypothesis_count
    assert "_frames" in vars(short)
    assert "_frames" not in vars(long)
    assert "covariance" not in long._smoothed
    assert short.smoothed is not None
    assert long.smoothed is not None
    for field in ("q", "covariance", "mode", "weight"):
        np.testing.assert_array_equal(getattr(short.smoothed, field), getattr(long.smoothed, field))
    monkeypatch.undo()
    np.testing.assert_array_equal(Run.open(long.file).posterior(3).covariance, short.posterior(3).covariance)


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("covariance", np.zeros((FRAMES, 3), dtype=np.float32), "covariance"),
        ("covariance", np.full((FRAMES, 595), -1.0, dtype=np.float32), "invalid numbers"),
        ("mode", np.full(FRAMES, 9), "not one of a frame"),
        ("weight", np.full((FRAMES, 3), 0.5), "sum to one"),
        ("weight", None, "not both"),
    ],
)  # fmt: skip
def test_damage_is_reported(
    track: Track, smoothed: Smoothed, name: str, wrong: np.ndarray | None, message: str
) -> None:
    arrays = joined(smoothed_parts(smoothed))
    check_smoothed(arrays, track.body)
    assert smoothed_in({"q": arrays["q"]}, track.body).covariance is None
    damaged = {key: value for key, value in arrays.items() if key != name}
    with pytest.raises(DamageError, match=message):
        check_smoothed(damaged if wrong is None else {**arrays, name: wrong}, track.body)
