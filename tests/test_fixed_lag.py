"""Smoothing some frames behind a live track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from builders import body_of, camera_at, inside, observe, random_pose

from estimator.data.observation import Observation
from estimator.search.mode_search import ModeSearch
from estimator.synthesis.motion import authored_motion
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from estimator.tracking.smoothing import FixedLag, SmoothSettings, fixed_lag, smooth_track
from estimator.tracking.smoothing.chain import REACH, FrameChain
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body
from humanoid.subject.example_robots import PREFIX, installed
from humanoid.subject.subject import load_subject
from tests.tiny_clip import FEW_STARTS

FPS, FRAMES, LAG = 25.0, 12, 4
FEW = {"samples": 4, "budget": {"searches": 12}}
GAP = (5, 6)
Given = list[tuple[int, np.ndarray]]


class Track(NamedTuple):
    """A track with its search, its observations and the true poses."""

    search: ModeSearch
    seen: list[Observation]
    results: list[FrameResult]
    truth: np.ndarray

    @property
    def body(self) -> Body:
        return self.search.body

    def first(self, count: int) -> Track:
        return self._replace(seen=self.seen[:count], results=self.results[:count], truth=self.truth[:count])


def tracked(body: Body, truth: np.ndarray, cameras: Sequence[int], changes: dict[str, object]) -> Track:
    rng = np.random.default_rng(3)
    views = [camera_at(a, distance=3.5, height=1.0, aim=(0.0, 0.0, 0.9)) for a in cameras]
    seen = [observe(body, q, views, noise=3.0, rng=rng, index=i, time=i / FPS) for i, q in enumerate(truth)]
    tracker = make_tracker(
        "css", body, settings_for("css", modes=3, changes={"css": FEW, "search": FEW_STARTS, **changes})
    )
    return Track(tracker.search, seen, [r for r, _ in run(tracker, seen, 0)], truth)


@pytest.fixture(scope="module")
def track() -> Track:
    """A person before one camera; in the gap nothing is seen."""
    body = body_of("human34")
    whole = tracked(body, authored_motion(body, 0.4 + np.arange(FRAMES) / FPS), (40,), {})
    seen = [replace(o, confidence=0.0 * o.confidence) if o.index in GAP else o for o in whole.seen]
    tracker = make_tracker("css", body, settings_for("css", modes=3, changes={"css": FEW, "search": FEW_STARTS}))
    return whole._replace(seen=seen, results=[r for r, _ in run(tracker, seen, 0)])


def given_by(track: Track, settings: SmoothSettings) -> tuple[list[Given], Given]:
    """The results of every push and of the flush."""
    lag = FixedLag(track.search, settings)
    pushed = [lag.push(o, r) for o, r in zip(track.seen, track.results, strict=True)]
    return pushed, lag.flush()


def poses(track: Track, settings: SmoothSettings) -> np.ndarray:
    pushed, rest = given_by(track, settings)
    given = [pair for pairs in (*pushed, rest) for pair in pairs]
    assert [i for i, _ in given] == list(range(len(track.seen)))
    return np.array([q for _, q in given])


def distances(body: Body, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distances of the landmarks (T, L) [m]."""
    points = [np.array([body.landmarks(body.at(x)) for x in path]) for path in (q, other)]
    return np.asarray(np.linalg.norm(points[0] - points[1], axis=2))


def heaviest(track: Track) -> np.ndarray:
    return np.array([r.q[0] for r in track.results])


@pytest.mark.parametrize("lag", [0, 1, LAG, FRAMES, 100])
def test_every_frame_comes_once_in_order_and_so_many_frames_late(track: Track, lag: int) -> None:
    settings = SmoothSettings(lag=lag, lag_iterations=1)
    pushed, rest = given_by(track, settings)
    assert [[i for i, _ in pairs] for pairs in pushed] == [[k - lag] if k >= lag else [] for k in range(FRAMES)]
    assert [i for i, _ in rest] == list(range(max(0, FRAMES - lag), FRAMES))
    again = FixedLag(track.search, settings)
    assert again.flush() == []  # nothing is left


def test_what_was_given_does_not_depend_on_what_comes(track: Track) -> None:
    settings = SmoothSettings(lag=LAG)
    whole, _ = given_by(track, settings)
    for count in (LAG + 1, FRAMES - 2):
        part, _ = given_by(track.first(count), settings)
        ours, theirs = ([pair for pairs in some for pair in pairs] for some in (part, whole[:count]))
        assert [i for i, _ in ours] == [i for i, _ in theirs] == list(range(count - LAG))
        assert all(np.array_equal(p, q) for (_, p), (_, q) in zip(ours, theirs, strict=True))


def test_it_lies_between_filter_and_truth(track: Track) -> None:
    q = poses(track, SmoothSettings(lag=LAG))
    assert inside(track.body, q)
    filtered = distances(track.body, heaviest(track), track.truth).mean()
    assert distances(track.body, q, track.truth).mean() < filtered
    jerk, filters = (np.abs(np.diff(path[:, 7:], 3, axis=0)).mean() for path in (q, heaviest(track)))
    assert jerk < 0.6 * filters


def test_without_lag_and_with_every_motion_alike_it_is_the_filter() -> None:
    """The least of a frame's energy alone is its lowest mode; an uninformative motion prior leaves it there."""
    body = body_of("arm8")
    rng = np.random.default_rng(1)
    start, end = (random_pose(body, rng, share=0.4) for _ in range(2))
    truth = start + np.linspace(0.0, 0.4, 6)[:, None] * (end - start)
    free = {"cost": {"turn_speed": 1e5, "root_turn_speed": 1e5, "root_slide_speed": 1e5}}
    track = tracked(body, truth, (20, 80), free)
    settings = SmoothSettings(lag=0, turn_acceleration=1e6, root_turn_acceleration=1e6, root_slide_acceleration=1e6)
    lowest = np.array([r.q[np.argmin(r.energy)] for r in track.results])
    np.testing.assert_allclose(poses(track, settings), lowest, atol=1e-5)
    # and with an informative prior it does not
    assert np.abs(poses(track, SmoothSettings(lag=0)) - lowest).max() > 1e-3


def test_where_no_foot_is_seen_the_smoother_leaves_feet_alone() -> None:
    """To the last bit: a body without feet is not smoothed again for them."""
    body, rng = body_of("arm8"), np.random.default_rng(4)
    start, end = (random_pose(body, rng, share=0.4) for _ in range(2))
    arm = tracked(body, start + np.linspace(0.0, 0.4, 6)[:, None] * (end - start), (20, 80), {})
    held, free = (
        smooth_track(arm.search, arm.seen, arm.results, SmoothSettings(stance=stance)).q for stance in (0.015, 0.0)
    )
    np.testing.assert_array_equal(held, free)


def test_with_all_of_the_clip_in_hand_it_is_the_smoother(track: Track) -> None:
    """Taking as many steps as needed: both are minima of one energy over one path of modes, within half a millimetre,
    except for what only the offline smoother does: it holds standing feet, on a floor, remembers accelerations,
    estimates the pace, and removes lasting errors."""
    whole = {"stance": 0.0, "lasting": 0.0, "memory": 0.0, "pace_rounds": 0, "iterations": 60, "tolerance": 1e-9}
    settings = SmoothSettings(lag=FRAMES, lag_iterations=40, even_pace=1.0, **whole)
    offline = smooth_track(track.search, track.seen, track.results, settings, floor="off").q
    apart = distances(track.body, poses(track, settings), offline)
    assert apart.max() < 5e-4
    assert distances(track.body, heaviest(track), offline).max() > 5e-3  # smoothing has an effect


def test_the_energy_of_the_window_never_rises_and_what_was_given_stays(
    track: Track, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes: list[float] = []

    class Watched(FrameChain):
        def descend(self, q: np.ndarray, held: np.ndarray, iterations: int) -> np.ndarray:
            before, after = q.copy(), super().descend(q, held, iterations)
            changes.append(self.energy(after) - self.energy(before))
            assert np.array_equal(after[held], before[held])
            assert held.sum() == max(0, min(REACH, len(changes) - 1 - LAG))
            assert len(q) == min(len(changes), LAG + 1) + held.sum()
            return after

    monkeypatch.setattr(fixed_lag, "FrameChain", Watched)
    poses(track, SmoothSettings(lag=LAG))
    assert len(changes) == FRAMES
    assert max(changes) <= 0.0
    assert min(changes) < -0.1


def test_frames_in_which_nothing_was_seen_are_bridged(track: Track) -> None:
    """Their hypotheses were only predicted; motion interpolates between the observations before and after."""
    assert [r.index for r in track.results if r.status == "unobserved"] == list(GAP)
    gap = list(GAP)
    q = poses(track, SmoothSettings(lag=LAG))
    bridged, carried = (distances(track.body, path[gap], track.truth[gap]).mean() for path in (q, heaviest(track)))
    assert bridged < 0.9 * carried
    steps = np.linalg.norm(np.diff([track.body.landmarks(track.body.at(x)) for x in q], axis=0), axis=2).mean(axis=1)
    assert steps[GAP[0] - 1 : GAP[1] + 1].max() < 3.0 * np.median(steps)  # no jump back at its end


def test_frames_without_hypotheses_are_left_out(track: Track) -> None:
    r = track.results[0]
    none = replace(r, q=r.q[:0], weight=r.weight[:0], energy=r.energy[:0], parent=r.parent[:0], association=())
    lag = FixedLag(track.search, SmoothSettings(lag=1))
    assert lag.push(track.seen[0], none) == []
    assert lag.flush() == []
    assert lag.push(track.seen[1], track.results[1]) == []
    ((index, _),) = lag.push(track.seen[2], track.results[2])
    assert index == 1


def test_equal_tracks_are_smoothed_to_equal_bits(track: Track) -> None:
    again = tracked(track.body, track.truth, (15,), {})  # an independent search
    again = again._replace(seen=track.seen, results=track.results)
    assert np.array_equal(poses(track, SmoothSettings(lag=LAG)), poses(again, SmoothSettings(lag=LAG)))


@pytest.mark.parametrize("name", ["arm8", f"{PREFIX}panda"])
def test_a_robot_on_a_fixed_base_is_smoothed(name: str) -> None:
    if name.startswith(PREFIX) and not installed():
        pytest.skip("example-robot-data is not installed")
    body = Body(load_subject(name))
    middle, half = 0.5 * (body.lower + body.upper), 0.5 * (body.upper - body.lower)
    phase = np.arange(8)[:, None] / FPS * 6.0 + np.arange(body.nq)
    track = tracked(body, middle + 0.3 * half * np.sin(phase), (20, 80), {})
    q = poses(track, SmoothSettings(lag=2))
    assert q.shape == (8, body.nq)
    assert inside(body, q)
    smoothed, filtered = (distances(body, path, track.truth).mean() for path in (q, heaviest(track)))
    assert smoothed < filtered


def test_nothing_is_below_a_known_floor(track: Track) -> None:
    """A floor 3 cm too high for the feet is used; one a metre away is not, as it is not theirs."""
    settings = SmoothSettings(lag=LAG)
    free = poses(track, settings)
    up = np.array([0.0, 0.0, 1.0])
    lowest = FloorDistances(track.body, up, 0.0).lowest(track.body.placed(free))
    height = float(np.median(lowest)) + 0.03

    def above(floor: float) -> np.ndarray:
        lag = FixedLag(track.search, settings, floor)
        given = [pair for o, r in zip(track.seen, track.results, strict=True) for pair in lag.push(o, r)]
        return np.array([q for _, q in [*given, *lag.flush()]])

    deep = FloorDistances(track.body, up, height)
    assert np.median(deep.lowest(track.body.placed(free))) == pytest.approx(-0.03, abs=1e-9)
    assert deep.lowest(track.body.placed(above(height))).min() > -0.01
    np.testing.assert_array_equal(above(height - 1.0), free)
