"""Unobserved joints are not reported as seen: a note, wide intervals, gaps in exports."""

from __future__ import annotations

import csv
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, camera_at, observe

import kinemode as km
from estimator.data.formats.c3d import read_c3d
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.formats.opensim import read_trc
from estimator.runs.run_reader import Run
from estimator.runs.unobserved import unseen_by, unseen_joints
from estimator.synthesis.motion import authored_motion
from humanoid.subject.landmarks import FORMATS

LEGS = ("hip_flexion", "hip_abduction", "hip_rotation", "knee_flexion", "ankle_dorsiflexion")


def all_but(*parts: str) -> np.ndarray:
    """The landmarks of human34 other than these."""
    return np.array([not any(part in name for part in parts) for name in body_of("human34").landmark_names])


@pytest.mark.parametrize(
    ("hidden", "unseen"),
    [
        ((), ()),
        (("knee", "ankle", "heel", "toe"), LEGS),
        (("ankle", "heel", "toe"), LEGS[2:]),
        (("heel", "toe"), LEGS[4:]),
        (("wrist",), ("shoulder_rotation", "elbow_flexion")),
    ],
)
def test_a_joint_that_moves_nothing_seen_is_unseen(hidden: tuple[str, ...], unseen: tuple[str, ...]) -> None:
    body = body_of("human34")
    none = np.zeros(len(body.marker_names), dtype=bool)
    joints = unseen_joints(body, all_but(*hidden), none)
    assert set(joints) == {f"{side}_{name}" for side in ("left", "right") for name in unseen}


def test_a_guess_now_and_then_shows_nothing() -> None:
    body, cameras = body_of("human34"), [camera_at(0.0)]
    seen = [observe(body, q, cameras, index=i) for i, q in enumerate(authored_motion(body, np.arange(60) / 30.0))]
    legs = ~all_but("knee", "ankle", "heel", "toe")
    hidden = [replace(o, confidence=np.where(legs & (o.index != 7), 0.0, o.confidence)) for o in seen]
    assert unseen_by(body, seen) == ()
    assert len(unseen_by(body, hidden)) == 2 * len(LEGS)
    assert unseen_by(body, [replace(o, confidence=np.zeros_like(o.confidence)) for o in seen]) == ()


@pytest.fixture(scope="module")
def sitting(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, np.ndarray, list[str]]:
    """A person sitting behind a desk, in three cameras; the true hip and knee, and the warnings."""
    folder, body = tmp_path_factory.mktemp("desk"), body_of("human34")
    cameras = [camera_at(angle) for angle in (0.0, 60.0, 120.0)]
    q = authored_motion(body, 0.4 + np.arange(8) / 30.0)
    for side in ("left", "right"):
        for joint, angle in (("hip_flexion", 1.45), ("knee_flexion", 1.5)):
            q[:, body.q_names.index(f"{side}_{joint}")] = angle
    names = FORMATS["halpe26"]
    at = [body.landmark_names.index(name) if name in body.landmark_names else -1 for name in names]
    there = np.array([i >= 0 and all_but("knee", "ankle", "heel", "toe")[i] for i in at])
    write_cameras(folder / "cameras.json", cameras)
    for camera in cameras:
        pixels = np.array([camera.project(body.landmarks(body.at(pose)))[at] for pose in q])
        sure = np.broadcast_to(there, pixels.shape[:2]).astype(float)
        track = KeypointTrack("halpe26", names, np.where(there[:, None], pixels, np.nan), sure, camera.image_size, 30.0)
        write_keypoints(folder / f"{camera.name}.json", track)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = km.track(
            "human34", None, cameras=folder / "cameras.json", modes=1, fit="off", out=folder / "desk.run",
            keypoints=[folder / f"{camera.name}.json" for camera in cameras],
        )  # fmt: skip
    return run, q, [str(warning.message) for warning in caught]


def test_legs_behind_a_desk_are_named_and_their_intervals_cover_sitting(
    sitting: tuple[Run, np.ndarray, list[str]],
) -> None:
    run, q, warned = sitting
    assert any("nothing seen depends on left_hip_flexion" in text for text in warned)
    assert not any("invalid value" in text for text in warned)
    assert set(run.unseen_joints) == {f"{side}_{name}" for side in ("left", "right") for name in LEGS}
    for name in ("left_hip_flexion", "right_knee_flexion"):
        joint, truth = run[name], q[:, run.body.q_names.index(name)]
        assert not joint.seen
        assert ((joint.low < truth) & (truth < joint.high)).all()
        np.testing.assert_allclose(joint.high - joint.low, 0.9 * (joint.upper - joint.lower))
    elbow = run["left_elbow_flexion"]
    assert elbow.seen
    assert (elbow.high - elbow.low < 0.7 * (elbow.upper - elbow.lower)).all()


def test_exports_have_gaps_or_a_line(sitting: tuple[Run, np.ndarray, list[str]], tmp_path: Path) -> None:
    run, _, _ = sitting
    for degrees, unit in ((False, "rad"), (True, "deg")):
        with km.export(run, tmp_path / "a.csv", degrees=degrees).open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert {row[f"left_knee_flexion_{unit}"] for row in rows} == {""}
        assert all(row[f"left_elbow_flexion_{unit}"] for row in rows)
        assert {row["left_knee_x_m"] for row in rows} == {""}
        assert all(row["left_hip_x_m"] for row in rows)
    assert "nothing seen depends on left_hip_flexion" in km.export(run, tmp_path / "a.mot").read_text()
    assert "left_knee_flexion" in np.load(km.export(run, tmp_path / "a.npz"))["unseen_joint_names"]
    legs = {name for name in run.body.landmark_names if name.endswith(("knee", "ankle", "heel", "toe"))}
    assert set(run.unseen_landmarks) == legs
    for of_points in (
        read_trc(km.export(run, tmp_path / "a.trc")),
        read_c3d(km.export(run, tmp_path / "a.c3d")),
    ):
        missing = np.isnan(of_points.points).all(axis=(0, 2))
        assert {name for name, gone in zip(of_points.names, missing, strict=True) if gone} == legs
    with pytest.warns(km.InputWarning, match="nothing seen depends on left_hip_flexion"):
        km.export(run, tmp_path / "a.bvh")
