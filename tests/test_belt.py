"""A moving floor: walking on a treadmill has the contact and strides of walking on a floor seen from the belt, and
motions without a treadmill have no belt."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_gait import NAMES, stepping

from benchmarks.accuracy.foot_contact import RUNNER_MARKERS, agreements
from estimator.inference import contacts as foot_contact_module
from estimator.inference.belt import belt_under
from estimator.retargeting.metrics import footing_by_depth
from estimator.runs.contact import Contact, contact_of_points
from estimator.runs.gait import Gait, gait_of_landmarks
from estimator.tracking.smoothing.stances import held_places
from kinemode.terminal.report import print_contact, print_gait
from viz.pictures.contact_plot import contact_drawing
from viz.report.tables import gait_part

UP = np.array([0.0, 0.0, 1.0])
KIND = np.array([0, 1, 0, 1])
WALK, RUN, SHUFFLE = (1.1, 0.42, 1.3), (0.72, 0.48, 3.0), (1.4, 0.5, 0.5)  # s of a stride, s of a swing, m/s


def contact_and_gait(time: np.ndarray, points: np.ndarray) -> tuple[Contact, Gait]:
    contact = contact_of_points(time, NAMES[1:], points[:, 1:])
    return contact, gait_of_landmarks(time, NAMES, points, contact=contact)


def on_belt(time: np.ndarray, points: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Points of a walk on a floor, placed on one that moves with a velocity (3,) [m/s]."""
    return points + (time - time[0])[:, None, None] * velocity


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T)


def cranks(radius: float, height: float, per_second: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and landmarks of feet that move along ellipses in turn."""
    time = np.arange(240) / 60.0
    points = np.zeros((len(time), 5, 3))
    points[:, 0, 2] = 1.0
    for side in (0, 1):
        phase = 2.0 * np.pi * per_second * time + np.pi * side
        for k, ahead in enumerate((-0.05, 0.15)):
            row = points[:, 1 + 2 * side + k]
            row[:, 0], row[:, 1] = ahead + radius * np.cos(phase), 0.2 * side
            row[:, 2] = height * (1.0 + np.sin(phase))
    return time, points


@pytest.mark.parametrize(
    ("steps", "fps", "angle", "share"),
    [(WALK, 60.0, 0.0, 1.0), (WALK, 25.0, 2.2, 0.9), (RUN, 60.0, 2.2, 0.9), (SHUFFLE, 50.0, 0.0, 1.0)],
)
def test_a_constant_velocity_changes_no_event(
    steps: tuple[float, float, float], fps: float, angle: float, share: float
) -> None:
    """Whatever its direction, and though the body moves on a little."""
    time, points = stepping(*steps, fps)
    points = turned(points, angle)
    velocity = turned(np.array([-share * steps[2], 0.0, 0.0]), angle)
    (floor, walks), (belt, treads) = (
        contact_and_gait(time, each) for each in (points, on_belt(time, points, velocity))
    )
    assert floor.belt is walks.belt is None
    assert belt.belt is not None
    np.testing.assert_allclose(belt.belt.velocity, velocity, atol=0.03 * steps[2])
    assert np.mean((belt.standing > 0.5) != (floor.standing > 0.5)) < 0.01
    for ours, theirs in ((belt.events, floor.events), (treads.events, walks.events)):
        assert [(e.side, e.kind) for e in ours] == [(e.side, e.kind) for e in theirs]
        np.testing.assert_allclose([e.time for e in ours], [e.time for e in theirs], atol=0.01)
    assert len(treads.strides) == len(walks.strides) > 2
    assert treads.remark == walks.remark == ""
    for ours, theirs in zip(treads.strides, walks.strides, strict=True):
        assert ours.length == pytest.approx(theirs.length, rel=0.03)
        assert ours.speed == pytest.approx(theirs.speed, rel=0.03)
        assert ours.width == pytest.approx(theirs.width, abs=0.01)


def test_a_stride_is_as_long_as_the_belt_moves_and_the_foot() -> None:
    time, points = stepping(*WALK)
    treads = on_belt(time, points, np.array([-1.2, 0.1, 0.0]))
    contact, gait = contact_and_gait(time, treads)
    assert contact.belt is not None
    assert gait.belt == contact.belt.speed
    for stride in gait.strides:
        heel = treads[:, NAMES.index(f"{stride.side}_heel"), :2]
        first, last = (np.array([np.interp(t, time, c) for c in heel.T]) for t in (stride.start, stride.end))
        way = last - first - contact.belt.velocity[:2] * stride.seconds
        assert stride.length == pytest.approx(float(np.linalg.norm(way)), abs=0.02)


@pytest.mark.parametrize(("steps", "slope"), [(WALK, 0.1), (RUN, 0.05)])
def test_a_belt_may_slope(steps: tuple[float, float, float], slope: float) -> None:
    time, points = stepping(*steps)
    level = contact_of_points(time, NAMES[1:], points[:, 1:])
    hill = points + slope * points[..., :1] * UP
    belt = contact_of_points(time, NAMES[1:], on_belt(time, hill, -steps[2] * np.array([1.0, 0.0, slope]))[:, 1:])
    assert belt.belt is not None
    assert belt.belt.speed == pytest.approx(steps[2], rel=0.03)
    assert [(e.side, e.kind) for e in belt.events] == [(e.side, e.kind) for e in level.events]
    np.testing.assert_allclose([e.time for e in belt.events], [e.time for e in level.events], atol=0.02)


def paced(steps: tuple[float, float, float], pace: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks of a walk on a floor at a share `pace` (T,) of the full pace, and the displacements (T, 3) of a belt
    that keeps the walker in place."""
    fine, points = stepping(*steps, 240.0)
    elapsed = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) / fps)])
    columns = [np.interp(elapsed, fine, column) for column in points.reshape(len(fine), -1).T]
    return np.stack(columns, axis=1).reshape(len(pace), 5, 3), -steps[2] * elapsed[:, None] * np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize("steps", [WALK, RUN])
@pytest.mark.parametrize(("starts", "ramp", "stops"), [(1.0, 1.0, 9.0), (0.0, 2.5, 9.0), (-2.0, 1.0, 4.0)])
def test_a_belt_may_start_and_stop(steps: tuple[float, float, float], starts: float, ramp: float, stops: float) -> None:
    """Before it starts the person stands."""
    fps = 60.0
    time = np.arange(330) / fps
    pace = np.clip(np.minimum((time - starts) / ramp, stops + ramp - time), 0.0, 1.0)
    walks, way = paced(steps, pace, fps)
    floor, belt = (contact_of_points(time, NAMES[1:], p[:, 1:]) for p in (walks, walks + way[:, None]))
    assert floor.belt is None
    assert belt.belt is not None
    np.testing.assert_allclose(belt.belt.speeds, steps[2] * pace, atol=0.15 * steps[2])
    assert [(e.side, e.kind) for e in belt.events] == [(e.side, e.kind) for e in floor.events]
    np.testing.assert_allclose([e.time for e in belt.events], [e.time for e in floor.events], atol=0.033)
    assert f"to {belt.belt.speeds.max():.2f} m/s" in repr(belt)


@pytest.mark.parametrize(("steps", "starts"), [(WALK, 2.0), (RUN, 1.0)])
def test_a_belt_may_start_during_the_walk(steps: tuple[float, float, float], starts: float) -> None:
    """As when stepping onto it: the floor was at rest for up to two fifths of the clip."""
    time, points = stepping(*steps)
    way = -steps[2] * np.maximum(time - starts, 0.0)
    treads = points + way[:, None, None] * np.array([1.0, 0.0, 0.0])
    floor, belt = (contact_of_points(time, NAMES[1:], each[:, 1:]) for each in (points, treads))
    assert belt.belt is not None
    assert belt.belt.speeds[time < starts - 0.5] == pytest.approx(0.0, abs=0.1)
    assert belt.belt.speeds[time > starts + 0.5] == pytest.approx(steps[2], rel=0.05)
    assert [(e.side, e.kind) for e in belt.events] == [(e.side, e.kind) for e in floor.events]


def test_an_even_belt_has_one_speed() -> None:
    """To the bit, at any noise, even though the speed is not quite constant."""
    fps = 60.0
    time = np.arange(290) / fps
    walks, way = paced(WALK, 1.0 + 0.04 * np.sin(time), fps)
    treads = walks + way[:, None] + np.random.default_rng(2).normal(scale=0.004, size=walks.shape)
    belt = belt_under(treads[:, 1:], time, KIND, UP)
    assert belt is not None
    assert len(np.unique(belt.speeds)) == 1
    assert belt.described == f"{belt.speed:.2f} m/s"


def test_noise_hides_no_belt() -> None:
    time, points = stepping(*WALK)
    treads = on_belt(time, points, np.array([-1.3, 0.0, 0.0]))
    treads += np.random.default_rng(5).normal(scale=0.006, size=treads.shape)
    treads[40:50, 2] = np.nan
    belt = belt_under(treads[:, 1:], time, KIND, UP)
    assert belt is not None
    assert belt.known
    assert belt.speed == pytest.approx(1.3, abs=0.05)


def test_without_a_belt_every_bit_is_as_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    clips = [stepping(*WALK), stepping(*RUN), cranks(0.17, 0.17, 1.3)]
    searched = [contact_of_points(time, NAMES[1:], points[:, 1:]) for time, points in clips]
    monkeypatch.setattr(foot_contact_module, "belt_under", lambda *_: None)
    for ours, (time, points) in zip(searched, clips, strict=True):
        plain = contact_of_points(time, NAMES[1:], points[:, 1:])
        assert ours.standing.tobytes() == plain.standing.tobytes()
        assert ours.heights.tobytes() == plain.heights.tobytes()
        assert repr(ours) == repr(plain)


def test_no_belt() -> None:
    """Walking on a floor, standing, sitting down, gliding, cycling, or followed by a camera at half the speed."""
    time, points = stepping(*WALK)
    feet = points[:, 1:]
    still = np.tile(feet[:1], (len(time), 1, 1))
    others = {
        "walks": feet,
        "stands": still,
        "glides": on_belt(time, still, np.array([1.5, 0.0, 0.0])),
        "half": on_belt(time, feet, np.array([-0.65, 0.0, 0.0])),
        "one foot": feet[:, :2],
        "unknown": np.full_like(feet, np.nan),
        "one frame": feet[:1],
    }
    for name, each in others.items():
        assert belt_under(each, time[: len(each)], KIND[: each.shape[1]], UP) is None, name
    for rows in ((0.17, 0.17, 1.3), (0.16, 0.17, 0.8)):
        when, cycled = cranks(*rows)
        assert belt_under(cycled[:, 1:], when, KIND, UP) is None


@pytest.mark.parametrize(("radius", "height", "per_second"), [(0.25, 0.05, 0.9), (0.3, 0.03, 0.8)])
def test_feet_without_a_common_speed_have_no_stances(
    radius: float, height: float, per_second: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Strides have times, by the pelvis, and no lengths."""
    time, points = cranks(radius, height, per_second)
    contact, gait = contact_and_gait(time, points)
    assert contact.belt is not None
    assert not contact.belt.known
    assert "as on a treadmill of unknown speed" in contact.remark
    assert np.isnan(contact.standing).all()
    assert contact.events == contact.stances == []
    assert gait.method == "pelvis"
    assert len(gait.strides) >= 3
    for stride in gait.strides:
        assert stride.seconds == pytest.approx(1.0 / per_second, abs=0.02)
        assert np.isnan([stride.length, stride.speed]).all()
    print_contact(contact)
    print_gait(gait)
    printed = capsys.readouterr().out
    assert "nan" not in printed + gait_part(gait)
    assert printed.count("of unknown speed") == 2
    row = next(csv.DictReader(gait.write(tmp_path / "g.csv").open()))
    assert row["length [m]"] == row["speed [m/s]"] == ""


def test_what_stands_on_a_belt_moves_with_it() -> None:
    """A standing foot does not slide or skate, and is held along the belt's path."""
    time, points = stepping(*WALK)
    velocity = np.array([-1.3, 0.0, 0.0])
    treads = on_belt(time, points, velocity)
    contact = contact_of_points(time, NAMES[1:], treads[:, 1:])
    assert contact.belt is not None
    assert contact.stances
    assert np.median([stance.slide for stance in contact.stances]) < 0.02
    assert footing_by_depth(np.zeros(1), contact).skating < 0.2
    assert footing_by_depth(np.zeros(1), replace(contact, belt=None)).skating > 0.9
    seen = np.ones(contact.standing.shape, dtype=bool)
    places, weight = held_places(contact.points, contact.standing, seen, time, contact.belt.way)
    held = (weight[1:] > 0.1) & (weight[:-1] > 0.1)
    steps = np.diff(places, axis=0)[held] / (time[1] - time[0])
    np.testing.assert_allclose(steps, np.tile(contact.belt.velocity, (len(steps), 1)), atol=1e-9)
    assert np.linalg.norm(places - contact.points, axis=2)[weight > 0.1].max() < 0.08


def test_the_belt_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, points = stepping(*WALK)
    floor, walks = contact_and_gait(time, points)
    belt, treads = contact_and_gait(time, on_belt(time, points, np.array([0.0, 0.0, 0.0]) - [1.3, 0.0, 0.0]))
    assert belt.belt is not None
    speed = f"{belt.belt.speed:.2f} m/s"
    assert speed in repr(belt)
    print_contact(belt)
    print_gait(treads)
    assert capsys.readouterr().out.count(f"a belt that moves at {speed}") == 2
    assert f"a belt that moves at {speed}" in gait_part(treads)
    assert f"on a belt of {speed}" in contact_drawing(belt).axes[0].get_title()
    heads = [next(csv.reader(each.write(tmp_path / "c.csv").open())) for each in (floor, belt)]
    assert heads[1] == [*heads[0], "belt [m/s]"]
    rows = list(csv.DictReader((tmp_path / "c.csv").open()))
    assert all(float(row["belt [m/s]"]) == pytest.approx(belt.belt.speed, rel=1e-5) for row in rows)
    assert "belt" not in repr(floor) + gait_part(walks) + contact_drawing(floor).axes[0].get_title()


def test_a_runner_on_a_treadmill_agrees_with_force_plates(shared_data: Path) -> None:
    folder = shared_data / "forces" / "runner"
    if not folder.is_dir():
        pytest.skip("needs forces/runner")
    for agreement in agreements(folder, "run200", RUNNER_MARKERS).values():
        assert agreement.f1 > 0.9
        assert np.nanmax(np.abs(agreement.off)) <= 0.035
        assert np.isfinite(agreement.off).sum() >= 5
