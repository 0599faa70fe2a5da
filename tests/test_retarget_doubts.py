"""Frames in which a motion departs from its source are hard: where the source jumps, or the body is elsewhere."""

from __future__ import annotations

import re
import warnings
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinemode as km
from estimator.retargeting.doubts import doubts_of, is_mirrored, turns_round, without_mirrored_parts
from estimator.retargeting.leaps import leap_frames, leaps_of, without_rest_pose
from estimator.retargeting.motion import RetargetedMotion, retarget_motion
from estimator.retargeting.problem import RetargetSettings
from estimator.retargeting.source import SourceMotion, filled
from humanoid.subject.landmarks import mirror_index
from tests.builders import body_of
from tests.test_retargeting import HUMAN, part_of, steps

QUICK = RetargetSettings(starts=1).frame_by_frame


def posed_apart(rate: float, frames: int, away: float) -> SourceMotion:
    """Steps whose first frames are a person at rest, so many metres away; at a rate [1/s]."""
    body = body_of(HUMAN)
    rest = body.landmarks(body.at(body.neutral))
    hips = [steps().names.index(f"{side}_hip") for side in ("left", "right")]
    rest = rest + (steps().points[0, hips] - rest[hips]).mean(axis=0) + np.array([away, 0.0, 0.0])
    points = np.concatenate([np.repeat(rest[None], frames, axis=0), steps().points])
    return SourceMotion(steps().names, points, np.arange(len(points)) / rate, "walk.npz")


@pytest.mark.parametrize(("rate", "frames", "away"), [(30.0, 1, 1.5), (60.0, 2, 0.7), (25.0, 3, -4.0)])
def test_a_rest_pose_before_the_motion_is_left_out(rate: float, frames: int, away: float) -> None:
    read = without_rest_pose(posed_apart(rate, frames, away))
    assert np.isnan(read.points[:frames]).all()
    assert np.isfinite(read.points[frames:]).all()
    assert f"leaps {abs(away):.1f} m between frames {frames - 1} and {frames}" in read.notes[0]
    assert leaps_of(read) == ()
    assert filled(read, 0.5).points[0] == pytest.approx(steps().points[0])


def test_arms_alone_are_a_rest_pose_too() -> None:
    points = steps().points.copy()
    for name, y in (("left_wrist", 0.9), ("right_wrist", -0.9)):
        points[0, steps().names.index(name), 1:] = y, 1.4
    read = without_rest_pose(replace(steps(), points=points))
    assert np.isnan(read.points[0]).all()


def test_human_motion_is_not_a_leap() -> None:
    """A sprint, an arm that throws, noise of triangulated joints."""
    rng = np.random.default_rng(0)
    for rate in (15.0, 30.0, 120.0):
        times = np.arange(60) / rate
        sprint = steps().points[:60] + np.stack([11.0 * times, 0.0 * times, 0.0 * times], axis=1)[:, None]
        throw = steps().points[:60].copy()
        angle = np.pi * np.clip((times - times[30]) / 0.15 + 0.5, 0.0, 1.0)
        arm = 0.6 * np.stack([np.sin(0.5 * np.pi - angle), 0.0 * angle, np.cos(0.5 * np.pi - angle)], axis=1)
        throw[:, steps().names.index("right_wrist")] = throw[:, steps().names.index("right_shoulder")] + arm
        noisy = np.repeat(steps().points[:1], 60, axis=0) + 0.02 * rng.normal(size=steps().points[:60].shape)
        for points in (sprint, throw, noisy):
            source = SourceMotion(steps().names, points, times, "run.npz")
            assert leaps_of(source) == ()
            assert without_rest_pose(source) is source


@pytest.mark.parametrize(("at", "away"), [(20, 2.5), (40, 4.0)])
def test_a_leap_inside_a_motion_makes_its_frames_hard(tmp_path: Path, at: int, away: float) -> None:
    points = steps().points[:50].copy()
    points[at:] += [away, 0.0, 0.0]
    points[at - 4 : at] = np.nan
    source = SourceMotion(steps().names, points, steps().times[:50], "cut.npz")
    with pytest.warns(km.InputWarning, match=rf"leaps {away:.1f} m between frames {at - 5} and {at}"):
        run = km.retarget(source, HUMAN, method="frames", out=tmp_path / "a.run")
    assert (run.status[at - 5 : at + 1] == "hard").all()
    assert (run.status[: at - 15] == "tracked").all()
    assert "faster than anybody moves" in run.header.findings[0]


@cache
def followed() -> tuple[RetargetedMotion, SourceMotion]:
    source = part_of(steps(), 10, 25)
    return retarget_motion(body_of(HUMAN), source, settings=QUICK), source


def test_a_good_motion_has_no_doubts(tmp_path: Path) -> None:
    doubts = doubts_of(body_of(HUMAN), *followed())
    assert doubts.findings == ()
    assert not doubts.frames.any()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", km.InputWarning)
        run = km.retarget(followed()[1], HUMAN, method="frames", out=tmp_path / "a.run")
    assert run.header.findings == ()
    assert (run.status == "tracked").all()


@pytest.mark.parametrize(
    ("joint", "limb", "frames"), [("left_hip_flexion", "left thigh", 4), ("right_elbow_flexion", "right forearm", 1)]
)
def test_a_limb_that_points_elsewhere(joint: str, limb: str, frames: int) -> None:
    motion, source = followed()
    q = motion.q.copy()
    q[3 : 3 + frames, body_of(HUMAN).q_names.index(joint)] += np.radians(90.0)
    doubts = doubts_of(body_of(HUMAN), replace(motion, q=q), source)
    assert np.flatnonzero(doubts.frames).tolist() == list(range(3, 3 + frames))
    assert limb in doubts.findings[0]
    assert f"in {frames} frame" in doubts.findings[0]


@pytest.mark.parametrize("away", [0.5, 2.0])
def test_a_body_off_the_path(away: float) -> None:
    motion, source = followed()
    q = motion.q.copy()
    q[5:, 0] += away
    doubts = doubts_of(body_of(HUMAN), replace(motion, q=q), source)
    assert np.flatnonzero(doubts.frames).tolist() == list(range(5, len(q)))
    assert f"the hips are up to {away:.1f} m off" in doubts.findings[0]


def test_frames_without_information() -> None:
    points = part_of(steps(), 0, 60).points.copy()
    points[20:50] = np.nan
    source = SourceMotion(steps().names, points, steps().times[:60], "gap.npz")
    motion = retarget_motion(body_of(HUMAN), source, settings=QUICK)
    doubts = doubts_of(body_of(HUMAN), motion, source)
    assert doubts.frames[20:50].all()
    assert "the source is entirely missing in 30 frames" in doubts.findings[-1]


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_source_is_hard(axis: int) -> None:
    """A source with left and right exchanged is mirrored, too."""
    motion, source = followed()
    points = source.points.copy()
    points[..., axis] *= -1.0
    exchanged = tuple(_other_side(name) for name in source.names)
    for other in (replace(source, points=points), replace(source, names=exchanged)):
        doubts = doubts_of(body_of(HUMAN), motion, other)
        assert doubts.frames.all()
        assert "toes point backwards" in doubts.findings[-1]
    assert not is_mirrored(replace(source, points=points, names=exchanged))


@pytest.mark.parametrize("angles", [(0.0, 100.0, 0.0), (90.0, 0.0, 0.0), (180.0, 30.0, 70.0)])
def test_bending_or_lying_is_not_mirroring(angles: tuple[float, float, float]) -> None:
    source = part_of(steps(), 0, 30)
    R = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    assert not is_mirrored(replace(source, points=source.points @ R.T))


@pytest.mark.parametrize(("first", "after"), [(6, 12), (0, 8), (11, 15)])
def test_sides_exchanged_in_a_stretch_make_it_hard(first: int, after: int) -> None:
    motion, source = followed()
    points = source.points.copy()
    points[first:after] = points[first:after][:, mirror_index(source.names)]
    doubts = doubts_of(body_of(HUMAN), motion, replace(source, points=points))
    beside = [t for cut in (first, after) if 0 < cut < len(points) for t in (cut - 1, cut)]
    assert np.flatnonzero(doubts.frames).tolist() == sorted({*range(first, after), *beside})
    assert "turn round faster than anybody" in doubts.findings[0]
    assert "toes point backwards" in doubts.findings[-1]


@pytest.mark.parametrize(("first", "after"), [(6, 12), (0, 8), (11, 15)])
def test_sides_exchanged_in_a_stretch_are_missing(first: int, after: int, tmp_path: Path) -> None:
    motion, source = followed()
    points = source.points.copy()
    points[first:after] = points[first:after][:, mirror_index(source.names)]
    read = without_mirrored_parts(replace(source, points=points))
    assert np.flatnonzero(np.isnan(read.points).all(axis=(1, 2))).tolist() == list(range(first, after))
    assert f"from {source.times[first]:.2f} to {source.times[after - 1]:.2f} s: treated as missing" in read.notes[-1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", km.InputWarning)
        run = km.retarget(replace(source, points=points), HUMAN, method="frames", out=tmp_path / "a.run")
    joints = run.body.bounded_q
    assert np.degrees(np.abs(run.q - motion.q)[:, joints]).mean() < 3.0
    assert read.notes[-1] in run.header.notes
    backwards = replace(source, points=source.points[:, mirror_index(source.names)])
    for other in (source, backwards):
        assert without_mirrored_parts(other) is other


@pytest.mark.parametrize(("limb", "first", "after"), [("left", 4, 8), ("right", 10, 11)])
def test_a_limb_that_leaps_and_returns_is_hard_in_between(limb: str, first: int, after: int) -> None:
    motion, source = followed()
    arm = [source.names.index(f"{limb}_{part}") for part in ("elbow", "wrist")]
    points = source.points.copy()
    points[first:after, arm] += [0.3, 0.6, 0.8]
    wrong = replace(source, points=points)
    doubts = doubts_of(body_of(HUMAN), motion, wrong, leaps_of(wrong))
    assert doubts.frames[first - 1 : after + 1].all()
    apart = part_of(wrong, 0, after)  # unknown while the arm stays
    assert leap_frames(apart, leaps_of(apart)).sum() == 2


@pytest.mark.parametrize(("part", "other"), [("elbow", "ankle"), ("knee", "shoulder")])
def test_names_that_give_limbs_of_no_body(part: str, other: str) -> None:
    motion, source = followed()
    exchanged = {f"left_{part}": f"left_{other}", f"left_{other}": f"left_{part}"}
    wrong = replace(source, names=tuple(exchanged.get(name, name) for name in source.names))
    doubts = doubts_of(body_of(HUMAN), motion, wrong)
    assert doubts.frames.all()
    assert any("limbs are not those of a body" in finding for finding in doubts.findings)
    legs = [i for i, name in enumerate(wrong.names) if "wrist" not in name]
    some = replace(wrong, names=tuple(wrong.names[i] for i in legs), points=wrong.points[:, legs])
    assert not any(
        "limbs are not those of a body" in finding for finding in doubts_of(body_of(HUMAN), motion, some).findings
    )


@pytest.mark.parametrize(("rate", "speed"), [(30.0, 2000.0), (60.0, 2300.0), (120.0, 1500.0)])
def test_a_skater_does_not_turn_round_too_fast(rate: float, speed: float) -> None:
    """Nor does a standing person with noisy joints."""
    source, rng = part_of(steps(), 0, 30), np.random.default_rng(0)
    times = np.arange(30) / rate
    turns = Rotation.from_euler("z", speed * times[:, None], degrees=True).as_matrix()
    for points in (source.points @ turns.swapaxes(1, 2), source.points + 0.03 * rng.normal(size=source.points.shape)):
        assert turns_round(replace(source, points=points, times=times)) == ()


def _other_side(name: str) -> str:
    side, _, part = name.partition("_")
    return {"left": "right_", "right": "left_"}[side] + part if side in ("left", "right") else name


def test_a_subject_whose_toes_are_behind_its_heels() -> None:
    body, (motion, source) = body_of(HUMAN), followed()
    exchanged = {"heel": "big_toe", "big_toe": "heel"}
    other = copy(body)
    other.landmark_names = tuple(
        re.sub("heel|big_toe", lambda match: exchanged[match[0]], name) for name in body.landmark_names
    )
    doubts = doubts_of(other, motion, source)
    assert doubts.frames.all()
    assert "the subject's toes point backwards" in doubts.findings[-1]
