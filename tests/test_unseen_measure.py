"""The measure of people left out of learning is right: known turns, known errors, and what means are taken over."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builders import body_of, random_pose
from scipy.spatial.transform import Rotation

import kinemode as km
from benchmarks.accuracy.unseen import means_of, paired_cell, variant
from benchmarks.accuracy.unseen_clips import (
    ANGLES,
    FrameErrors,
    UnseenRun,
    action_of,
    heading_rate,
    spikes_of,
    turn_bins,
    write_joints,
)
from benchmarks.support.pose_prior_clips import cut_motion, windows_of
from estimator.data.formats.bvh import read_bvh
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.formats.opensim import Coordinates
from estimator.runs.evaluation import LIMB_JOINTS
from estimator.runs.joint_angle import joint_entry
from estimator.runs.reference_motion import Reference
from estimator.tracking.registry import settings_for
from humanoid.support.errors import InputError

BODY = body_of("human34")
FPS = 30.0
LEFT, UP = np.eye(3)[1:]


@pytest.mark.parametrize("rate", [45.0, -120.0])
def test_a_steady_turn_has_its_rate_however_the_person_bends(rate: float) -> None:
    time = np.arange(120) / FPS  # at 120 deg/s more than a whole turn
    turned = Rotation.from_rotvec(np.outer(np.radians(rate) * time, UP))
    for bent in (0.0, 80.0, 170.0):
        quaternion = (turned * Rotation.from_rotvec(math.radians(bent) * LEFT)).as_quat()
        np.testing.assert_allclose(heading_rate(quaternion, FPS), abs(rate), atol=1e-8)


def test_bending_or_standing_is_not_turning() -> None:
    bending = Rotation.from_rotvec(np.outer(math.radians(200.0) * np.arange(30) / FPS, LEFT)).as_quat()
    np.testing.assert_allclose(heading_rate(bending, FPS), 0.0, atol=1e-8)
    assert heading_rate(bending[:1], FPS).tolist() == [0.0]


def test_the_bins_of_turning() -> None:
    assert turn_bins(np.array([0.0, 29.9, 30.0, 89.9, 90.0, 500.0])).tolist() == [0, 0, 1, 1, 2, 2]


def test_actions_are_those_of_the_trials_in_either_folder() -> None:
    figures = {
        "cmu_02_01": "walk", "cmu_02_03": "run", "run_02_03": "run", "punch_02_05": "punch", "cmu_02_06": "bend",
        "cmu_05_01": "walk", "arms_high_05_12": "dance", "jump_16_01": "jump", "cmu_35_16": "walk",
        "cmu_35_17": "run", "cmu_35_26": "run", "cmu_35_28": "walk", "cmu_49_08": "acrobatics", "swim_88_01": "swim",
    }  # fmt: skip
    assert {name: action_of(name) for name in figures} == figures


def test_known_errors_come_out_as_they_are() -> None:
    q = random_pose(BODY, np.random.default_rng(0))
    true = np.repeat(q[None], 4, axis=0)
    ours, off = true.copy(), dict(zip(ANGLES, (2.0, -4.0, 6.0, 6.0, -1.0, 0.0), strict=True))
    for name, degrees in off.items():
        ours[:, joint_entry(BODY, name).start] += math.radians(degrees)
    points = np.repeat(BODY.landmarks(BODY.at(q))[None], 4, axis=0)
    landmarks = points.copy()
    landmarks[1:, BODY.landmark_names.index("left_wrist")] += np.array([[0.12], [3.6], [0.0]])
    ours[3], landmarks[3] = np.nan, np.nan
    run = SimpleNamespace(body=BODY, q=ours, landmarks=landmarks, time=np.arange(4) / FPS)
    truth = Reference(BODY.landmark_names, points, np.arange(4) / FPS, Coordinates(BODY.q_names, true))
    errors = FrameErrors.of(run, truth)  # type: ignore[arg-type]
    np.testing.assert_allclose(errors.aligned, [0.0, 10.0 * math.sqrt(3.0), 300.0 * math.sqrt(3.0), np.nan], atol=1e-9)
    means = errors.means()
    assert means["aligned"] == pytest.approx(310.0 / math.sqrt(3.0))
    assert means["far"] == 0.5  # far off once, without a pose once
    assert (means["hips"], means["knees"], means["elbows"]) == pytest.approx((3.0, 6.0, 0.5))
    assert means["angles"] == pytest.approx(9.5 / 3.0)
    assert means["spikes"] == 1.0  # in the second frame; the one after the third has no pose


def test_a_joint_away_for_one_frame_is_a_spike_and_a_fast_one_is_not() -> None:
    truth = np.zeros((9, 3, 3)) + 0.05 * np.arange(9)[:, None, None]
    points = truth.copy()
    points[4, 2, 1] += 0.13
    assert spikes_of(points, truth, (0, 1)).tolist() == [0, 0, 0, 0, 1, 0, 0, 0, 0]
    assert not spikes_of(points, points, (0, 1)).any()
    points[5:, 2, 1] += 0.13  # it stays there
    assert not spikes_of(points, truth, (0, 1)).any()
    points[4, 2] = np.nan
    assert not spikes_of(points, truth, (0, 1)).any()


def run_of(clip: str, seed: int, folder: str = "a") -> UnseenRun:
    return UnseenRun(Path(folder, f"{clip}.bvh"), 2.0, seed, "joints", "{}", Path(folder, "p.json"), Path(folder))


def figures(error: float, frames: int, rate: float) -> dict[str, object]:
    track = {"aligned": error, "pa": error}
    arrays = {"aligned": [error] * frames, "pa": [error] * frames, "degrees": [[error] * len(ANGLES)] * frames}
    others = {"rate": [rate] * frames, "spikes": [0.0] * frames}
    return {**arrays, **others, "tracks": {"smoothed": track}}


def test_means_are_over_seeds_then_clips_and_turning_frames() -> None:
    clips = [("cmu_07_01", 0, 10.0, 4), ("cmu_07_01", 1, 30.0, 8), ("cmu_35_20", 0, 40.0, 2), ("cmu_07_02", 0, 60.0, 2)]
    done = [(run_of(name, seed), figures(e, count, 100.0 if e > 20.0 else 5.0)) for name, seed, e, count in clips]
    means = means_of(done)
    aligned = {key: {name: of["aligned"] for name, of in table.items()} for key, table in means.items()}
    assert aligned["by clip"] == {"cmu_07_01": 20.0, "cmu_35_20": 40.0, "cmu_07_02": 60.0}
    assert aligned["all"] == {"clips": 40.0}
    assert aligned["by person"] == {"07": 40.0, "35": 40.0}
    assert aligned["by action"] == {"walk": 40.0, "run": 40.0}
    assert aligned["by turning"] == {"0 to 30": 10.0, "over 90": pytest.approx((8 * 30 + 2 * 40 + 2 * 60) / 12)}
    windows = [(replace(run_of("cmu_07_01", 0), start=s), figures(e, 4, 5.0)) for s, e in ((0.0, 10.0), (2.5, 20.0))]
    of = means_of([*windows, (run_of("cmu_35_20", 0), figures(40.0, 4, 5.0))])
    assert {name: m["aligned"] for name, m in of["by person"].items()} == {"07": 15.0, "35": 40.0}
    assert {name: m["aligned"] for name, m in of["by clip"].items()} == {
        "cmu_07_01": 10.0, "cmu_07_01 from 2.5 s": 20.0, "cmu_35_20": 40.0,
    }  # fmt: skip
    less = {name: {"aligned": x} for name, x in {"cmu_07_01": 19.0, "cmu_35_20": 37.0, "cmu_07_02": 58.0}.items()}
    assert paired_cell("aligned", means["by clip"], less) == "-2.0 ± 0.6"


def test_cached_results_depend_on_all_inputs_and_no_folder() -> None:
    assert run_of("cmu_07_01", 0).what == run_of("cmu_07_01", 0, "b").what
    run = run_of("cmu_07_01", 0)
    changes: list[dict[str, Any]] = [{"seconds": 3.0}, {"kind": "detector"}, {"changes": '{"cost": {"nu": 8}}'}]
    others = (run_of("cmu_07_01", 1), run_of("cmu_07_02", 0), *(replace(run, **change) for change in changes))
    later = [replace(run, start=start) for start in (2.0, 4.5)]
    assert len({str(other.what) for other in (run, *others, *later)}) == 8
    assert [of.name for of in (run, *later)] == [f"cmu_07_01{at}_joints_0" for at in ("", "_from_2s", "_from_4.5s")]


@pytest.mark.parametrize("whole", [1.4, 2.0, 3.9, 4.0, 12.5, 20.2])
def test_windows_lie_in_the_clip_and_do_not_overlap(whole: float) -> None:
    for count in (1, 2, 5, 30):
        starts = windows_of(whole, 2.0, count)
        assert len(starts) == max(1, min(count, int(whole / 2.0)))
        assert starts[0] == 0.0
        assert starts[-1] + 2.0 <= max(whole, 2.0) + 1e-9
        assert np.diff(starts).min(initial=np.inf) >= 2.0 - 0.011  # starts are rounded


def test_a_cut_motion_is_the_rest_of_it(shared_data: Path, tmp_path: Path) -> None:
    """Its person at the origin and facing x at first, as every captured motion."""
    path = shared_data / "mocap" / "walk_straight_07_01.bvh"
    whole, rest = read_bvh(path), read_bvh(cut_motion(path, 1.0, tmp_path / "cut" / "rest.bvh"))
    first = round(1.0 / whole.frame_time)
    assert rest.frame_time == whole.frame_time
    np.testing.assert_allclose(rest.positions(), whole.positions()[first:])
    with pytest.raises(InputError, match="no frame after 99 s"):
        cut_motion(path, 99.0, tmp_path / "none.bvh")


@pytest.mark.parametrize(("weight", "named"), [(0.0, False), (0.5, True)])
def test_the_prior_is_the_unseen_one_unless_it_is_off(weight: float, named: bool) -> None:
    run = replace(run_of("cmu_07_01", 0), changes=f'{{"cost": {{"pose_prior_weight": {weight}}}}}')
    cost = run.settings()["cost"]
    assert cost == {"pose_prior_weight": weight, **({"pose_prior_file": str(run.prior)} if named else {})}
    settings_for("css", changes=run.settings())  # refuses what has no effect


@pytest.mark.parametrize("seed", [0, 1])
def test_the_joints_kind_is_the_twelve_limb_joints_with_their_noise(tmp_path: Path, seed: int) -> None:
    clip = km.render(tmp_path, "reach", seconds=2.0, seed=seed, videos=False)
    ((name, path),) = write_joints(clip, tmp_path / "joints.json", seed).items()
    track, truth, camera = load_keypoints(path), Reference.load(clip.truth), load_cameras(clip.cameras)[name]
    assert track.names == LIMB_JOINTS
    off = track.pixels - camera.project(truth.points[:, [truth.names.index(joint) for joint in LIMB_JOINTS]])
    assert off.std(axis=(0, 2)).mean() == pytest.approx(3.0, rel=0.15)  # nan where a joint is missing
    assert np.abs(off).max() < 25.0  # no outlier


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[cost]\npose_prior_file = 'mine.json'\n", "leave it out"),
        ("[cost]\nnuu = 8\n", "nuu"),
        ("[cost\n", "line 1"),
    ],
)
def test_unknown_settings_and_those_with_a_prior_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[cost]\nnu = 8.0\n")
    assert variant(path) == {"cost": {"nu": 8.0}}
    path.write_text(text)
    with pytest.raises(InputError, match=rf"mine\.toml.*{message}"):
        variant(path)
