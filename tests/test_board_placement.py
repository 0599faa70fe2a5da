"""Cameras placed by a board that is small or far, so that its mirrored solutions fit nearly as well."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.robustness.boards import FLOOR, BoardRig, draw_rig, judge_rig
from estimator.data.boards.adjustment import Pose, adjust, angle_between, chained, inverse
from estimator.data.boards.lens import board_poses
from estimator.data.boards.placement import floor_notes, place_cameras, placements


def rig_of(seed: int) -> BoardRig:
    return draw_rig(np.random.default_rng([0, seed]), 1 + seed % 4)


def exact(rig: BoardRig) -> tuple[dict[str, Pose], dict[int, Pose], BoardRig]:
    """The rig in its first camera's frame, with boards where that camera sees them and corners without noise."""
    first = rig.cameras["cam0"]
    cameras = {
        name: chained((c.R_camera_world, c.t_camera_world), inverse((first.R_camera_world, first.t_camera_world)))
        for name, c in rig.cameras.items()
    }
    boards = {v.frame: board_poses(first, rig.board, v)[0][:2] for v in rig.views if v.camera == "cam0"}
    views = []
    for view in rig.views:
        if view.frame in boards:
            R, t = chained(cameras[view.camera], boards[view.frame])
            camera = replace(rig.cameras[view.camera], R_camera_world=R, t_camera_world=t)
            views.append(replace(view, pixels=camera.project(rig.board.points)))
    return cameras, boards, replace(rig, views=views)


@pytest.mark.parametrize("seed", [4, 24, 25])  # mirrored if the best solution of each view is used
def test_the_mirrored_solution_is_seen_through(seed: int) -> None:
    rig = rig_of(seed)
    cameras, _, notes = place_cameras(rig.fits(), rig.board, rig.views, FLOOR)
    placed = judge_rig(rig.cameras, cameras, notes)
    assert max(placed.turn, placed.floor) < 4.0  # mirrored ones are off by 20 degrees and more
    assert len(rig.cameras) > 1 or placed.doubted  # alone, the other solution cannot be ruled out


def test_a_view_has_two_solutions_the_true_one_first() -> None:
    _, boards, rig = exact(rig_of(1))
    view = rig.views[0]
    first, mirrored = board_poses(rig.cameras["cam0"], rig.board, view)
    assert angle_between(first[:2], boards[view.frame]) < 0.01 < mirrored.error
    assert angle_between(first[:2], mirrored[:2]) > 2.0
    assert first.error < 1e-3


def test_adjustment_finds_the_poses_again() -> None:
    cameras, boards, rig = exact(rig_of(5))
    rng = np.random.default_rng(0)

    def disturbed(pose: Pose) -> Pose:
        return cv2.Rodrigues(rng.normal(0.0, 0.02, 3))[0] @ pose[0], pose[1] + rng.normal(0.0, 0.02, 3)

    moved = ["cam1", *boards]
    start = {"cam0": cameras["cam0"], "cam1": disturbed(cameras["cam1"])}
    at = adjust(rig.cameras, rig.board, rig.views, start, {f: disturbed(p) for f, p in boards.items()}, moved=moved)
    assert at.cost < 1e-6
    for pose, true in [(at.cameras["cam1"], cameras["cam1"]), *((at.boards[f], boards[f]) for f in boards)]:
        assert angle_between(pose, true) < 1e-2
        np.testing.assert_allclose(pose[1], true[1], atol=1e-3)


def test_the_placement_that_most_frames_support_comes_first() -> None:
    """A mirrored solution that is best in some frames is outvoted; another cluster is kept."""
    rng = np.random.default_rng(2)
    true = cv2.Rodrigues(np.array([0.1, 0.9, 0.0]))[0], np.array([-2.0, 0.1, 1.0])
    _, _, rig = exact(rig_of(1))
    some = [board_poses(rig.cameras["cam0"], rig.board, v)[0] for v in rig.views if v.camera == "cam0"]
    a = {i: [pose] for i, pose in enumerate(some)}
    b = {}
    for i, pose in enumerate(some):
        R, t = chained(inverse(true), pose[:2])
        wrong = pose._replace(R=cv2.Rodrigues(rng.normal(0.0, 1.0, 3))[0] @ R, t=t)
        b[i] = [wrong, pose._replace(R=R, t=t)] if i % 2 else [pose._replace(R=R, t=t), wrong]
    placement, support = placements(a, b)[0]
    assert angle_between(placement, true) < 1.0
    assert support > 0.9 * len(some)


@pytest.mark.parametrize(
    ("R", "texts"),
    [
        (np.diag([1.0, -1.0, -1.0]), ["below the floor", "up along -z"]),
        (cv2.Rodrigues(np.array([-np.pi / 2.0, 0.0, 0.0]))[0], ["below the floor", "track with --up="]),
        (np.eye(3), []),
    ],
)
def test_a_floor_that_contradicts_the_cameras_is_reported(R: np.ndarray, texts: list[str]) -> None:
    level = rig_of(3).cameras
    turned = {name: replace(c, R_camera_world=c.R_camera_world @ R.T) for name, c in level.items()}
    notes = floor_notes(turned, 7)
    for word in texts:
        assert any(word in note for note in notes), (word, notes)
    assert all("picture 7" in note for note in notes)
    assert bool(notes) == bool(texts)
