"""Unmeasured values are missing: zeros, repeated pictures, gaps filled with the last place."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from builders import body_of

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.markers.load import load_points
from estimator.data.repeats import filled_places, frames_elsewhere, measured_keypoints, repeated_frames, stuck_points
from estimator.synthesis.motion import authored_motion

COUNT = 40


def walk(fps: float) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Landmarks (T, L, 3) of a moving person, and times."""
    body, times = body_of("human34"), np.arange(COUNT) / fps
    points = body.landmarks_of(body.placed(authored_motion(body, 0.3 + times)))
    return body.landmark_names, points, times


def marked(frames: slice, k: int, points: np.ndarray) -> np.ndarray:
    expected = np.zeros(points.shape[:2], dtype=bool)
    expected[frames, k] = True
    return expected


@pytest.mark.parametrize(("first", "after", "fps"), [(6, 26, 30.0), (12, 20, 50.0), (20, COUNT, 25.0), (0, 15, 30.0)])
def test_a_gap_filled_with_a_neighbour_is_missing(first: int, after: int, fps: float) -> None:
    names, points, times = walk(fps)
    wrist = names.index("left_wrist")
    points[first:after, wrist] = points[first, wrist]
    points[first:after, wrist, 0] += 0.1 * (first == 0)  # the value before the file begins
    filled = filled_places(points, times)
    np.testing.assert_array_equal(filled, marked(slice(first + 1, after), wrist, points))


def test_what_rests_is_kept() -> None:
    """Feet in exact stances, and a motionless person, also repeat to the last digit."""
    names, points, times = walk(30.0)
    heel, arm = names.index("left_heel"), names.index("right_wrist")
    share = np.clip((times - 0.8) / 0.4, 0.0, 1.0) ** 2  # it leaves its place smoothly
    points[:, heel] = points[0, heel] + share[:, None] * [0.3, 0.0, 0.1]
    assert not filled_places(points, times).any()
    still = np.repeat(points[:1], COUNT, axis=0)
    still[:, arm] = points[:, arm]
    assert not filled_places(still, times).any()
    assert not repeated_frames(still).any()
    for digits in (2, 1):  # a centimetre, and whole pixels of a small person
        assert filled_places(np.round(points, digits), times).mean() < 0.01
    landing = points.copy()
    landing[20:, heel] = landing[20, heel]  # a foot in whole pixels stops abruptly, then leaves
    landing[30:, heel] += (0.03 * np.arange(10)[:, None]) ** 1.5
    assert not filled_places(np.round(landing, 2), times)[:, heel].any()


@pytest.mark.parametrize("every", [2, 3, 5])
def test_pictures_twice_are_missing_once(every: int) -> None:
    _, points, _ = walk(30.0)
    twice = points[np.repeat(np.arange(COUNT), np.where(np.arange(COUNT) % every == every - 1, 2, 1))]
    expected = np.zeros(len(twice), dtype=bool)
    expected[1:] = (twice[1:] == twice[:-1]).all(axis=(1, 2))
    np.testing.assert_array_equal(repeated_frames(twice)[1:-1], expected[1:-1])


def test_points_at_zero_and_held_keypoints_are_missing() -> None:
    names, points, times = walk(30.0)
    pixels, sure = 600.0 + 300.0 * points[..., :2], np.ones(points.shape[:2])
    track = KeypointTrack("coco17", names, pixels, sure, (1920, 1080), 30.0)
    assert measured_keypoints(track, times) is track
    wrong = pixels.copy()
    wrong[7:9] = 0.0
    knee = names.index("right_knee")
    wrong[15:25, knee] = wrong[15, knee]
    wrong[30] = wrong[29]
    seen = measured_keypoints(KeypointTrack("coco17", names, wrong, sure, (1920, 1080), 30.0), times)
    expected = np.zeros(sure.shape, dtype=bool)
    expected[7:9] = expected[30] = expected[16:25, knee] = True
    np.testing.assert_array_equal(seen.confidence == 0.0, expected)
    np.testing.assert_array_equal(np.isnan(seen.pixels).all(axis=2), expected)
    assert [note.split()[0] for note in seen.notes] == [str(2 * len(names)), "1", "9"]
    clicked = measured_keypoints(KeypointTrack("landmarks", names, wrong, sure, (1920, 1080), 30.0), times)
    assert np.flatnonzero(np.isnan(clicked.pixels).any(axis=(1, 2))).tolist() == [7, 8]
    assert np.isnan(clicked.pixels[7:9]).all()
    assert len(clicked.notes) == 1
    clicked = KeypointTrack("landmarks", names, pixels[[0, 1, 1, 1]], sure[:4], (1920, 1080), 30.0)
    assert measured_keypoints(clicked, times) is clicked


def test_a_file_of_points_notes_what_was_filled(tmp_path: Path) -> None:
    names, points, _ = walk(30.0)
    points += np.array([0.4, 0.7, 1.0])
    points[6:26, names.index("left_wrist")] = points[6, names.index("left_wrist")]
    np.savez(tmp_path / "a.npz", points=points, names=np.array(names), fps=30.0, unit="m", up="z")
    track = load_points(tmp_path / "a.npz")
    assert np.isnan(track.points).all(axis=2).sum() == 19
    assert "19 places repeat to the last digit" in track.notes[0]
    assert "left_wrist" in track.notes[0]


@pytest.mark.parametrize(("first", "away"), [(1, 1.5), (2, 0.9), (3, 4.0), (1, 0.3)])
def test_a_rest_pose_before_the_motion_is_missing(first: int, away: float, tmp_path: Path) -> None:
    names, points, times = walk(30.0)
    points += np.array([0.4, 0.7, 1.0])
    points[:first] = points[0] + np.array([away, 0.0, 0.0])
    leapt = away > 0.5  # people can run at 9 m/s
    assert frames_elsewhere(points, times) == (first if leapt else 0)
    np.savez(tmp_path / "a.npz", points=points, names=np.array(names), fps=30.0, unit="m", up="z")
    track = load_points(tmp_path / "a.npz")
    assert np.isnan(track.points[:first]).all() == leapt
    assert np.isfinite(track.points[3:]).all()
    assert any("at the beginning are elsewhere" in note for note in track.notes) == leapt
    later = np.concatenate([points[5:], points[:first]])
    assert frames_elsewhere(later, times[: len(later)]) == 0  # a later jump is not a rest pose


def test_turning_round_repeats_a_place() -> None:
    names, points, _ = walk(30.0)
    there = np.concatenate([points[:20], points[19::-1]])
    assert not repeated_frames(there).any()
    assert len(names) == there.shape[1]


@pytest.mark.parametrize(("first", "after"), [(10, 14), (15, 25)])
def test_a_frozen_stretch_is_missing_though_the_person_turns_round_meanwhile(first: int, after: int) -> None:
    _, points, _ = walk(30.0)
    held = np.repeat(points[first : first + 1], after - first, axis=0)
    frozen = np.concatenate([points[:first], held, points[first - 1 :: -1]])
    expected = np.zeros(len(frozen), dtype=bool)
    expected[first + 1 : after] = True
    for part in (slice(None), slice(first - 1, None), slice(after + 1)):  # from just before, and until just afterwards
        np.testing.assert_array_equal(repeated_frames(frozen[part]), expected[part])


@pytest.mark.parametrize(("first", "after", "power"), [(10, 14, 2.0), (15, 25, 3.0)])
def test_resting_and_returning_is_kept(first: int, after: int, power: float) -> None:
    names, points, _ = walk(30.0)
    frames = np.arange(COUNT)
    away = np.maximum(first - frames, np.maximum(frames - after + 1, 0)) ** power / first**power
    resting = points[:1] + away[:, None, None] * np.arange(1.0, len(names) + 1)[:, None] * [0.02, 0.0, 0.01]
    assert (np.diff(resting[first:after], axis=0) == 0.0).all()
    assert not repeated_frames(resting).any()


@pytest.mark.parametrize(("stuck", "seed"), [(("left_wrist",), 0), (("right_knee", "nose", "left_heel"), 1)])
def test_a_keypoint_that_never_moves_is_missing(stuck: tuple[str, ...], seed: int) -> None:
    names, points, times = walk(30.0)
    pixels = 600.0 + 300.0 * points[..., :2] + np.random.default_rng(seed).normal(size=(*points.shape[:2], 2))
    chosen = [names.index(name) for name in stuck]
    pixels[:, chosen] = pixels[0, chosen]
    pixels[25] = pixels[24]  # a repeated picture does not affect the others
    sure = np.ones(points.shape[:2])
    seen = measured_keypoints(KeypointTrack("coco17", names, pixels, sure, (1920, 1080), 30.0), times)
    assert np.isnan(seen.pixels[:, chosen]).all()
    assert np.isfinite(seen.pixels[np.arange(COUNT) != 25][:, [k for k in range(len(names)) if k not in chosen]]).all()
    assert set(stuck) <= set(re.findall(r"[a-z]+_[a-z]+|nose", seen.notes[-1]))


def test_keypoints_that_rest_with_others_are_kept() -> None:
    """As in whole pixels of a nearly still person, in a short clip, and where most keypoints never move."""
    names, points, _ = walk(30.0)
    pixels = 600.0 + 300.0 * points[..., :2] + np.random.default_rng(0).normal(size=(*points.shape[:2], 2))
    pixels[:, 0] = pixels[0, 0]
    assert stuck_points(pixels).tolist() == [True] + [False] * (len(names) - 1)
    assert not stuck_points(pixels[:9]).any()
    assert not stuck_points(np.concatenate([pixels[:, :1], np.round(0.05 * pixels[:, 1:])], axis=1)).any()
    pixels[:, : len(names) // 2] = pixels[0, : len(names) // 2]
    assert not stuck_points(pixels).any()
