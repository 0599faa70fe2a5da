"""The parts of retargeting in isolation: the constrained step, stances, runs and their figures, a fixed base."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from estimator.retargeting.correspondence import load_match
from estimator.retargeting.doubts import doubts_of
from estimator.retargeting.motion import RetargetedMotion, retarget_motion
from estimator.retargeting.problem import RetargetSettings, StepRows, constrained_step
from estimator.retargeting.run_of import source_of, write_motion_run
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.stances import (
    HEEL,
    LIFT,
    TOE,
    Foot,
    FootStances,
    feet_of,
    foot_rotation,
    stances_at,
    stretches,
)
from estimator.runs.run_header import RETARGETED, RunHeader
from estimator.runs.run_reader import Run
from humanoid.subject.example_robots import installed
from humanoid.support.errors import InputError
from kinemode import __version__
from kinemode.reporting import motion_figures, write_figures
from tests.builders import body_of
from tests.made_runs import made_run
from tests.test_retargeting import HUMAN, PANDA, RATE, part_of, steps

FREE = np.full((2, 3), 9.0) * [[-1.0], [1.0]]
NONE = np.zeros((0, 3)), np.zeros(0)


def solved(box: np.ndarray, equal: tuple, above: tuple) -> tuple[np.ndarray, bool]:
    """The nearest step to (1, 2, 3)."""
    wanted = np.array([1.0, 2.0, 3.0])
    return constrained_step(np.eye(3), -wanted, box, StepRows(*equal, *above))


def test_a_step_that_is_known() -> None:
    """On the plane of a sum of 3, nearest to (1, 2, 3); with x at least 1, the others share the rest equally."""
    plane = np.ones((1, 3)), np.array([3.0])
    x, met = solved(FREE, plane, NONE)
    assert (met, x.tolist()) == (True, pytest.approx([0.0, 1.0, 2.0], abs=1e-5))
    x, met = solved(FREE, plane, (np.eye(3)[:1], np.array([1.0])))
    assert (met, x.tolist()) == (True, pytest.approx([1.0, 0.5, 1.5], abs=1e-5))


def test_an_infeasible_equality_is_reported() -> None:
    box = FREE.copy()
    box[1, 0] = 0.1
    x, met = solved(box, (np.eye(3)[:1], np.array([1.0])), NONE)
    assert not met
    assert x == pytest.approx([0.1, 2.0, 3.0], abs=1e-4)


def test_infeasible_rows_fall_short_by_the_least() -> None:
    """x >= 1 cm within x <= 1 mm is short by 9 mm; y >= 4 cm may be short by as much, but not more."""
    box = FREE.copy()
    box[1, 0] = 0.001
    above = np.eye(3)[:2], np.array([0.01, 0.04])
    x, met = constrained_step(1e3 * np.eye(3), -1e3 * np.array([0.01, 0.02, 0.03]), box, StepRows(*NONE, *above))
    assert not met
    assert x == pytest.approx([0.001, 0.031, 0.03], abs=1e-5)


def test_bounds_hold_to_the_last_bit() -> None:
    """Also where the demand presses the step against them."""
    rng = np.random.default_rng(1)
    at_bounds = 0
    for _ in range(30):
        root, low = rng.normal(size=(5, 5)), -rng.uniform(0.0, 0.3, 5)
        box = np.stack([low, low + rng.uniform(0.0, 0.4, 5)])
        above = rng.normal(size=(3, 5)), rng.normal(size=3)
        equal = rng.normal(size=(1, 5)), 0.1 * rng.normal(size=1)
        x, _ = constrained_step(root @ root.T + np.eye(5), 3.0 * rng.normal(size=5), box, StepRows(*equal, *above))
        assert ((box[0] <= x) & (x <= box[1])).all()
        at_bounds += int(((x == box[0]) | (x == box[1])).sum())
    assert at_bounds > 30


# --- stances ---

T = 40
TIMES = np.arange(T) / RATE


@cache
def foot() -> Foot:
    return feet_of(body_of(HUMAN))[0]


def free_places(seed: int = 0) -> np.ndarray:
    """Places (T, 1, 3, 3) of a foot that wanders, turns and pitches, a few centimetres above and below a floor."""
    rng = np.random.default_rng(seed)
    sine = np.sin(TIMES[:, None] * rng.uniform(1.0, 6.0, 5) + rng.uniform(0.0, 6.0, 5))
    places = []
    for t in range(T):
        heading, pitch = 0.6 * sine[t, 0], 0.4 * sine[t, 1]
        R_world_foot = foot_rotation(np.array([np.cos(heading), np.sin(heading), 0.0]), pitch)
        ankle = [0.3 * TIMES[t] + 0.05 * sine[t, 2], 0.1 * sine[t, 3], 0.09 + 0.04 * sine[t, 4]]
        places.append(ankle + foot().level @ R_world_foot.T)
    return np.array(places)[:, None]


def held(stands: np.ndarray, seed: int = 0) -> FootStances:
    return stances_at((foot(),), free_places(seed), stands[:, None], TIMES)


def pattern(*runs: tuple[int, bool, bool]) -> np.ndarray:
    """Whether heel and toe stand (T, 2), given numbers of frames; in the air afterwards."""
    rows = [pair for count, *pair in runs for _ in range(count)]
    return np.array(rows + [[False, False]] * (T - len(rows)), dtype=bool)


def check_held(stances: FootStances) -> None:
    """Standing points do not move and lie on the floor; nothing is below it."""
    assert stances.place[..., 2].min() >= 0.0
    for point in (HEEL, TOE):
        for first, after in stretches(stances.stands[:, 0, point]):
            where = stances.place[first:after, 0, point]
            assert np.abs(where[:, 2] - LIFT).max() < 1e-9
            assert np.ptp(where, axis=0).max() < 1e-9


AIR, FLAT, ON_HEEL, ON_TOE = (False, False), (True, True), (True, False), (False, True)
PATTERNS = {
    "flat": [(5, *AIR), (10, *FLAT)],
    "heel, flat, toe": [(5, *AIR), (6, *ON_HEEL), (8, *FLAT), (6, *ON_TOE)],
    "toe between": [(5, *AIR), (6, *FLAT), (9, *ON_TOE), (6, *FLAT)],
    "heel between": [(5, *AIR), (6, *FLAT), (9, *ON_HEEL), (6, *FLAT)],
    "toe alone": [(8, *AIR), (9, *ON_TOE)],
    "heel then toe": [(4, *AIR), (8, *ON_HEEL), (8, *ON_TOE)],
    "rocks": [(3, *FLAT), (3, *ON_HEEL), (3, *ON_TOE), (4, *FLAT), (8, *ON_TOE), (3, *ON_HEEL), (4, *FLAT)],
    "two steps": [(8, *FLAT), (8, *AIR), (4, *ON_HEEL), (8, *FLAT)],
}


@pytest.mark.parametrize("name", PATTERNS)
def test_what_stands_does_not_move(name: str) -> None:
    for seed in range(4):
        check_held(held(pattern(*PATTERNS[name]), seed))


def test_a_flat_foot_keeps_its_shape() -> None:
    """Heel and toe keep their distance, and its side is as high as its heel."""
    stances = held(pattern((5, *AIR), (10, *FLAT)))
    heel, toe, side = (stances.place[5:15, 0, k] for k in range(3))
    own = foot().level - foot().level[HEEL]
    assert np.linalg.norm(toe - heel, axis=1) == pytest.approx(np.linalg.norm(own[TOE]))
    assert np.linalg.norm(side - heel, axis=1) == pytest.approx(np.linalg.norm(own[2]))
    assert np.abs(side[:, 2] - LIFT).max() < 1e-9


def test_between_two_flat_stretches_it_turns_on_what_stands() -> None:
    """The toe keeps one place throughout the three, while the heel rises as before."""
    stances = held(pattern(*PATTERNS["toe between"]))
    assert np.ptp(stances.place[5:26, 0, TOE], axis=0).max() < 1e-9
    between, free = stances.place[11:20, 0], free_places()[11:20, 0]
    way, own = (p[:, HEEL] - p[:, TOE] for p in (between, free))
    up = own[:, 2] >= 0.0
    assert way[up] == pytest.approx(own[up], abs=1e-9)
    assert np.linalg.norm(stances.place[5, 0, HEEL] - stances.place[25, 0, HEEL]) > 0.005


def test_swings_meet_both_ends() -> None:
    """Their displacement goes from that of one stance to that of the next, in equal steps per frame."""
    stands = pattern(*PATTERNS["two steps"])
    place, free = held(stands).place[:, 0], free_places()[:, 0]
    moved = place - free
    swing = moved[7:17, 0, :2]  # z may be lifted to the floor
    steps = np.diff(swing, axis=0)
    assert steps == pytest.approx(np.repeat(steps[:1], len(steps), axis=0), abs=1e-9)
    assert np.linalg.norm(moved[7] - moved[16]) > 0.01
    assert moved[-1, 0, :2] == pytest.approx(moved[27, 0, :2])  # after the last stance as at its end


# --- runs and figures ---


@cache
def short() -> tuple[RetargetedMotion, SourceMotion]:
    source = part_of(steps(), 0, 12)
    return retarget_motion(body_of(HUMAN), source), source


def written(path: Path, motion: RetargetedMotion, source: SourceMotion) -> Run:
    subject = body_of(HUMAN).subject
    header = RunHeader(
        subject_urdf=subject.urdf, subject_source=subject.source, subject_base=subject.base, cameras=(), clips={},
        image_sizes={}, times=motion.times, tracker=RETARGETED, settings={}, seed=0, version=__version__,
        points=(source.source,), floor=0.0,
    )  # fmt: skip
    write_motion_run(
        path, header, body_of(HUMAN), motion, source, doubts=doubts_of(body_of(HUMAN), motion, source), overwrite=False
    )
    return Run.open(path)


def test_a_run_has_the_motion_and_its_source(tmp_path: Path) -> None:
    motion, source = short()
    source = replace(source, points=source.points.copy())
    source.points[3, 2] = np.nan
    run = written(tmp_path / "a.run", motion, source)
    assert run.q.tobytes() == motion.q.tobytes()
    read, contacts = source_of(run)
    floor = np.array([0.0, 0.0, motion.contacts.floor])
    assert read.names == source.names
    assert read.points == pytest.approx(motion.targets.scale * (source.points - floor), nan_ok=True)
    assert contacts.names == motion.contacts.names
    assert (contacts.standing == motion.contacts.standing).all()
    with pytest.raises(InputError, match="exists already"):
        written(tmp_path / "a.run", motion, source)


def test_figures_of_what_is_made_wrong(tmp_path: Path) -> None:
    """One jumping frame: a joint too fast into and out of it, feet that slip, and a frame that is hard."""
    motion, source = short()
    body = body_of(HUMAN)
    q, keeps = motion.q.copy(), motion.keeps.copy()
    q[6, body.q_names.index("left_elbow_flexion")] += 0.7
    q[6, 0] += 0.05
    keeps[6] = False
    figures = motion_figures(written(tmp_path / "a.run", replace(motion, q=q, keeps=keeps), source))
    right = motion_figures(written(tmp_path / "b.run", motion, source)).metrics
    assert (right.too_fast, figures.metrics.too_fast) == (0.0, pytest.approx(2 / 11))
    assert figures.metrics.speed_ratio == pytest.approx(0.7 * RATE / 10.0, rel=0.1)
    assert right.slip < 0.002
    assert figures.metrics.slip == pytest.approx(0.05, abs=0.003)
    assert figures.hard == pytest.approx(1 / 12)
    assert ("frames", "12, 8.3% of them hard") in figures.rows()
    write_figures(figures, tmp_path / "a.csv")
    rows = dict(csv.reader((tmp_path / "a.csv").open(encoding="utf-8")))
    assert float(rows["too_fast"]) == pytest.approx(2 / 11, abs=1e-5)
    assert (rows["figure"], rows["frames"]) == ("value", "12")


def test_a_tracked_run_has_no_figures(tmp_path: Path) -> None:
    body = body_of(HUMAN)
    run = made_run(tmp_path / "a.run", body.subject, np.tile(body.neutral, (2, 1, 1)))
    with pytest.raises(InputError, match="was tracked, not made"):
        motion_figures(run)
    with pytest.raises(InputError, match="has no motion that it was made from"):
        source_of(run)


# --- a fixed base ---


def test_an_arm_follows_a_wrist(tmp_path: Path) -> None:
    """The hand relative to the base follows the wrist relative to the shoulder, scaled."""
    if "panda" not in installed():
        pytest.skip("example-robot-data is not installed")
    (tmp_path / "match.toml").write_text(
        "[match]\nscale = 1.2\n[places]\n"
        'panda_hand_tcp = {source = "right_wrist", about = "panda_joint1", source_about = "right_shoulder"}\n'
    )
    body, angle = body_of(PANDA), np.linspace(0.0, 4.0, 30)
    shoulder = np.tile([3.0, 1.0, 1.4], (30, 1))
    way = np.stack([np.full(30, 0.4), 0.2 * np.sin(angle), 0.35 + 0.15 * np.cos(angle)], axis=1)
    points = np.stack([shoulder, shoulder + way], axis=1)
    source = SourceMotion(("right_shoulder", "right_wrist"), points, np.arange(30) / RATE, "a.npz")
    motion = retarget_motion(body, source, load_match(tmp_path / "match.toml"), settings=RetargetSettings(rest=3.0))
    tcp, base = (body.landmark_names.index(name) for name in ("panda_hand_tcp", "panda_joint1"))
    landmarks = np.array([body.landmarks(body.at(q)) for q in motion.q])
    off = landmarks[:, tcp] - landmarks[:, base] - 1.2 * way
    assert np.linalg.norm(off, axis=1).max() < 0.01
    assert motion.keeps.all()
    assert motion.stands.shape[1:] == (0, 2)
