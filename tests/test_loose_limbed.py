"""The loose-limbed tracker on pictures alone: it starts, tracks, recovers, resumes, and reports what it cannot do."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks.papers_loose_limbed.loose_limbed_clips import LimbClip, Markers
from benchmarks.papers_loose_limbed.loose_limbed_runs import true_state
from estimator.data.observation import Observation
from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.mixture import UniformBox
from estimator.inference.beliefs.space import PLACEMENTS
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.loose_limbed.instant import ImportanceSettings, importance_functions
from estimator.trackers.loose_limbed.limbs.window import Instant, PastBeliefs, window
from estimator.trackers.loose_limbed.part_detectors.contract import PartProposals
from estimator.trackers.loose_limbed.state import LimbState
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import FrameByFrame
from humanoid.support.errors import InputError

SMALL: dict[str, Any] = {
    "propagation": {"kernels": 20, "samples": 20, "iterations": 2},
    "start_kernels": 30,
    "start_samples": 25,
    "start_iterations": 3,
    "part_detectors": {"hull": {"places": 500, "poses": 800, "survivors": 50, "tries": 5}},
    "assembly": {"rounds": 2},
    "modes": 2,
}
BEGIN, BLANK, END = 2, (4,), 6
SEED = 3
"""With so few samples every other seed confuses the person's back and front."""


@cache
def clip() -> LimbClip:
    return LimbClip(None, seed=5, begin=0, end=END + 1)


@cache
def observations() -> tuple[Observation, ...]:
    """Frames of the clip; in one the pictures show no person."""
    return tuple(clip().observation(k, blank=k in BLANK) for k in range(BEGIN, END))


def tracker(**changes: Any) -> Any:
    return make_tracker(
        "loose-limbed", clip().body, settings_for("loose-limbed", changes={"loose_limbed": SMALL | changes})
    )


def track(state: LimbState | None = None, first: int = 0, **changes: Any) -> tuple[list[FrameResult], list[LimbState]]:
    frames = FrameByFrame(tracker(**changes), SEED, state=state, before=observations()[:first])
    results, states = [], []
    for observation in observations()[first:]:
        result = frames.push(observation)
        if result is not None:
            results.append(result)
            states.append(frames.state)
    for result in frames.rest():
        results.append(result)
        states.append(frames.state)
    return results, states


@cache
def from_nothing() -> tuple[list[FrameResult], list[LimbState]]:
    return track()


def error(result: FrameResult) -> float:
    """Mean of the markers of the best pose [mm]."""
    markers, body, graph = Markers.of(clip().graph), clip().body, clip().graph
    assert len(markers.limb) == 15
    at = [markers.of_poses(graph, body, q) for q in (result.q[0], clip().q[result.index])]
    return float(1e3 * np.linalg.norm(at[0] - at[1], axis=1).mean())


def test_it_starts_from_pictures_alone_and_finds_a_person_again() -> None:
    results, _ = from_nothing()
    assert [r.status for r in results] == ["tracked", "tracked", "unobserved", "tracked"]
    assert max(error(r) for r in results if r.status == "tracked") < 80.0
    body = clip().body
    for r in results:
        assert (r.q[:, body.bounded_q] >= body.lower[body.bounded_q]).all()
        assert (r.q[:, body.bounded_q] <= body.upper[body.bounded_q]).all()
        assert (r.penetration <= 0.01).all()


def test_it_reports_its_limb_beliefs() -> None:
    results, states = from_nothing()
    stored = results[1].extra
    assert tuple(stored["limb_names"]) == clip().graph.names
    assert stored["limb_points"].shape == states[1].arrays()["limb_points"].shape
    np.testing.assert_allclose(stored["limb_weights"].sum(axis=1), 1.0)
    assert not results[2].extra  # no search


def test_resumed_is_uninterrupted() -> None:
    results, states = from_nothing()
    body_tracker = tracker()
    again, _ = track(body_tracker.state_from(states[1].arrays()), first=2)
    for a, b in zip(results[2:], again, strict=True):
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(a.weight, b.weight)


@pytest.mark.thorough  # the graph of three frames is tested below
def test_with_smoothing_the_frame_before_is_inferred_again() -> None:
    """The stored beliefs are those of the previous frame once it has a past; after a blank frame they stay. Resumed is
    uninterrupted."""
    known = true_state(clip(), BEGIN - 1, 40)
    results, states = track(known, smoothing=True)
    frame = 1.0 / 30.0
    assert [round((s.time - s.believed) / frame) for s in states] == [1, 1, 2, 3]
    assert [r.status for r in results] == ["tracked", "tracked", "unobserved", "tracked"]
    assert error(results[1]) < 40.0
    stored = tracker(smoothing=True).state_from(states[0].arrays())
    again, _ = track(stored, first=1, smoothing=True)
    for a, b in zip(results[1:], again, strict=True):
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(a.weight, b.weight)


def test_damaged_states_are_refused() -> None:
    arrays = from_nothing()[1][0].arrays()
    for name, value in {
        "limb_points": arrays["limb_points"][:-1],
        "limb_weights": 2.0 * arrays["limb_weights"],
        "limb_status": np.full(len(arrays["limb_status"]), "fine"),
        "seen": np.array(99.0),
        "believed": np.array(99.0),
    }.items():
        with pytest.raises(ValueError, match=r"limb|seen"):
            tracker().state_from(arrays | {name: value})


def test_a_known_pose_is_followed_more_closely_than_without_past() -> None:
    frames = FrameByFrame(tracker(), 0, state=true_state(clip(), BEGIN - 1, 40))
    first = frames.push(observations()[0]) or frames.push(observations()[1])
    assert first is not None
    assert error(first) < 40.0


def test_three_frames_of_ten_limbs_have_the_paper_s_graph() -> None:
    potentials, box = tracker().potentials, np.array([[-1.0] * 3, [1.0] * 3])
    instants = [Instant(k / 30.0, None, (UniformBox(PLACEMENTS, *box),) * 10, box) for k in (1, 2)]
    believed = tuple(Belief(PLACEMENTS, np.eye(7)[[6]], np.ones(1)) for _ in range(10))
    graph = window(potentials, 0.01, instants, PastBeliefs(0.0, believed))
    assert len(graph.nodes) == 30
    # the paper's 94: three times 18, and 40 in time; beliefs of the past are fixed and receive no messages
    assert len(graph.potentials) == 94 - 18 - 10
    assert sum(i // 10 == j // 10 for i, j in graph.potentials) == 2 * 18
    # with the previous frame inferred again all of the 94, and those from its own past
    instants = [replace(instants[0], time=k / 30.0) for k in (1, 2, 3)]
    graph = window(potentials, 0.01, instants, PastBeliefs(0.0, believed))
    assert sum(max(edge) < 30 for edge in graph.potentials) == 94
    assert len(graph.potentials) == 94 + 10
    with pytest.raises(InputError, match="of 1 s"):
        window(potentials, 0.01, [instants[0], replace(instants[1], time=instants[0].time + 1.0)])


def test_importance_functions_cover_proposals_and_the_whole_volume() -> None:
    box, rng = np.array([[-2.0] * 3, [2.0] * 3]), np.random.default_rng(1)
    proposals = PartProposals(np.array([[0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]), np.array([3.0]))
    nothing = PartProposals(np.zeros((0, 7)), np.zeros(0))
    settings = ImportanceSettings(anywhere=0.25)
    received, without_any = importance_functions([(proposals, nothing), (nothing, nothing)], 2, box, settings)
    places = received.sample(rng, 4000)
    near = np.linalg.norm(places[:, :3] - proposals.points[0, :3], axis=1) < 4.0 * np.sqrt(3.0) * settings.place
    assert near.mean() == pytest.approx(0.75, abs=0.04)
    assert np.isfinite(received.log_density(places)).all()
    np.testing.assert_allclose(
        without_any.log_density(places[:5]), UniformBox(PLACEMENTS, *box).log_density(places[:5])
    )


def test_no_person_and_no_common_volume() -> None:
    blank = clip().observation(BEGIN, blank=True)
    assert not tracker().can_start(blank)
    assert tracker().can_start(observations()[0])
    camera, round_about = observations()[0].cameras[0], np.diag([-1.0, 1.0, -1.0])
    away = replace(
        camera,
        R_camera_world=round_about @ camera.R_camera_world,
        t_camera_world=round_about @ camera.t_camera_world,
    )
    apart = replace(observations()[0], cameras=(away, *observations()[0].cameras[1:]))
    with pytest.raises(InputError, match="see no place in common"):
        tracker().init(np.random.default_rng(0), apart)
