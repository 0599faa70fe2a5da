"""A tracker of hypotheses beside a chain of keypoints: seen keypoints are unchanged, missing ones kept for a while."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from builders import body_of, camera_at, observe

from estimator.data.formats.checked_arrays import DamageError
from estimator.data.observation import Observation
from estimator.inference.chains.exchange import APART
from estimator.search.cost_model import CostModel
from estimator.synthesis.motion import authored_motion
from estimator.trackers.base import TrackerProtocol
from estimator.trackers.baselines.single_mode import SingleMode
from estimator.trackers.css.points_beside import BesideSettings, BesideState, PointsBeside
from estimator.tracking.registry import make_tracker, settings_for
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index
from tests.tiny_clip import FEW_STARTS

FRAMES, GAP, FPS = 12, range(5, 12), 30.0
FEW = {"samples": 4, "budget": {"searches": 12}}
CAMERAS = camera_at(30.0, distance=3.5, height=1.2, aim=(0.0, 0.0, 0.95)), camera_at(110.0, distance=3.5, height=1.2)


@cache
def clip(cameras: int = 1) -> tuple[Observation, ...]:
    body, rng = body_of("human34"), np.random.default_rng(81)
    poses = authored_motion(body, 0.4 + np.arange(FRAMES) / FPS)
    return tuple(
        observe(body, q, CAMERAS[:cameras], noise=3.0, rng=rng, index=i, time=i / FPS) for i, q in enumerate(poses)
    )


def mark(name: str) -> int:
    return body_of("human34").landmark_names.index(name)


def without(seen: Observation, *names: str) -> Observation:
    gone = np.isin(np.arange(seen.confidence.shape[1]), [mark(name) for name in names])
    pixels = np.where(gone[:, None], np.nan, seen.pixels)
    return replace(seen, pixels=pixels, confidence=np.where(gone, 0.0, seen.confidence))


def gapped(cameras: int = 1) -> list[Observation]:
    return [without(o, "left_wrist") if o.index in GAP else o for o in clip(cameras)]


def dual(**beside: object) -> PointsBeside:
    settings = settings_for("css-dual", changes={"css_dual": {**FEW, "beside": beside}, "search": FEW_STARTS})
    tracker = make_tracker("css-dual", body_of("human34"), settings)
    assert isinstance(tracker, PointsBeside)
    return tracker


def tracked(tracker: TrackerProtocol, seen: list[Observation]) -> list[tuple[object, object]]:
    states = [tracker.init(np.random.default_rng([1, 0]), seen[0])]
    for o in seen[1:]:
        states.append(tracker.step(np.random.default_rng([1, o.index]), states[-1][0], o))
    return states


def spreads(tracker: PointsBeside, seen: list[Observation], name: str) -> list[float | None]:
    """Standard deviations [px] with which a missing keypoint is filled in each frame, None where it is not."""
    state, _ = tracker.init(np.random.default_rng([1, 0]), seen[0])
    out: list[float | None] = []
    for o in seen[1:]:
        filled = tracker.filled(tracker._predicted(state, o), o)
        spread = 0.0 if filled.spread is None else float(filled.spread[0, mark(name)])
        out.append(spread or None)
        state, _ = tracker.step(np.random.default_rng([1, o.index]), state, o)
    return out


@pytest.mark.parametrize("cameras", [1, 2])
def test_with_nothing_missing_it_is_css_to_the_bit(cameras: int) -> None:
    seen = list(clip(cameras))[:4]
    css = make_tracker("css", body_of("human34"), settings_for("css", changes={"css": FEW, "search": FEW_STARTS}))
    for (_, ours), (_, theirs) in zip(tracked(dual(), seen), tracked(css, seen), strict=True):
        np.testing.assert_array_equal(ours.q, theirs.q)  # type: ignore[attr-defined]


def test_what_is_detected_is_not_touched_and_what_is_missing_is_near() -> None:
    tracker, seen = dual(), gapped(2)
    state, _ = tracker.init(np.random.default_rng(0), seen[0])
    for o in seen[1 : GAP[0] + 1]:
        before, state = state, tracker.step(np.random.default_rng(o.index), state, o)[0]
    o = seen[GAP[0]]
    filled = tracker.filled(tracker._predicted(before, o), o)
    there = o.confidence > 0.0
    np.testing.assert_array_equal(filled.pixels[there], o.pixels[there])
    np.testing.assert_array_equal(filled.confidence[there], o.confidence[there])
    assert filled.spread is not None
    assert (filled.spread[there] == 0.0).all()
    wrist = mark("left_wrist")
    off = np.linalg.norm(filled.pixels[:, wrist] - clip(2)[GAP[0]].pixels[:, wrist], axis=1)
    assert (off < 4.0 * np.hypot(filled.spread[:, wrist], 3.0)).all()


def test_a_gap_has_no_confirmation() -> None:
    """The doubt about a missing keypoint grows from frame to frame, until it is missing for the tracker too."""
    seen = gapped()
    grown = spreads(dual(farthest=0.2), seen, "left_wrist")[GAP[0] - 1 :]
    finite = [s for s in grown if s is not None]
    assert 2 <= len(finite) < len(GAP)
    assert grown[: len(finite)] == finite  # and then none any more
    assert all(b > a for a, b in pairwise(finite))
    printed = [s for s in spreads(dual(farthest=0.2, exchange="printed"), seen, "left_wrist") if s is not None]
    assert len(printed) > len(finite)  # it is certain of its own echo


def test_without_messages_the_tracker_is_plain_css() -> None:
    seen = gapped()
    css = make_tracker("css", body_of("human34"), settings_for("css", changes={"css": FEW, "search": FEW_STARTS}))
    for (_, ours), (_, theirs) in zip(tracked(dual(exchange=APART), seen), tracked(css, seen), strict=True):
        np.testing.assert_array_equal(ours.q, theirs.q)  # type: ignore[attr-defined]


def test_any_tracker_of_hypotheses_may_stand_beside_the_chain() -> None:
    """A single mode with and without the chain: with it a missing wrist stays nearer to the truth."""
    body, seen = body_of("human34"), gapped()
    made = [make_tracker("single-mode", body, settings_for("single-mode")) for _ in range(2)]
    alone = made[0]
    assert isinstance(alone, SingleMode)
    beside = PointsBeside(made[1], alone.search, BesideSettings())
    truth = authored_motion(body, 0.4 + np.arange(FRAMES) / FPS)
    errors = []
    for tracker in (alone, beside):
        q = np.array([result.q[0] for _, result in tracked(tracker, seen)])  # type: ignore[attr-defined]
        off = [
            in_image(body, ours, "left_wrist") - in_image(body, true, "left_wrist")
            for ours, true in zip(q, truth, strict=True)
        ]
        errors.append(np.linalg.norm(off[GAP[0] : GAP[0] + 4], axis=1).mean())
    assert errors[1] < errors[0]


def in_image(body: Body, q: np.ndarray, name: str) -> np.ndarray:
    return CAMERAS[0].project(body.landmarks(body.at(q)))[mark(name)]


def test_a_stored_state_resumes_to_the_bit_and_a_damaged_one_is_refused() -> None:
    tracker, seen = dual(), gapped()
    states = tracked(tracker, seen[: GAP[0] + 2])
    state = states[-2][0]
    assert isinstance(state, BesideState)
    stored, rng = tracker.state_from(state.arrays()), np.random.default_rng([1, GAP[0] + 1])
    again, result = tracker.step(rng, stored, seen[GAP[0] + 1])
    np.testing.assert_array_equal(result.q, states[-1][1].q)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(again.covariance, states[-1][0].covariance)  # type: ignore[attr-defined]
    for name, value in (("keypoint_covariance", np.nan), ("keypoint_covariance", 0.0), ("keypoint_mean", np.nan)):
        arrays = state.arrays()
        with pytest.raises(DamageError, match=name):
            tracker.state_from({**arrays, name: np.full_like(arrays[name], value)})


def test_doubt_is_added_in_quadrature_and_changes_sides_with_its_keypoint() -> None:
    body, seen = body_of("human34"), clip()[0]
    model, mirror = CostModel(body), mirror_index(body.landmark_names)
    spread = np.random.default_rng(0).uniform(0.0, 20.0, size=seen.confidence.shape)
    doubted = replace(seen, spread=spread)
    np.testing.assert_allclose(model.keypoint_sigma(doubted), np.hypot(model.keypoint_sigma(seen), spread))
    np.testing.assert_array_equal(doubted.exchanged(mirror).spread, spread[:, mirror])
