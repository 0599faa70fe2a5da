"""A track that jumps to another person is reported."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest
from builders import body_of, camera_at, observe

from estimator.data.formats.packing import pack, unpack
from estimator.data.observation import Observation
from estimator.synthesis.detector import placed
from estimator.synthesis.motion import authored_motion
from estimator.tracking.leaps import FASTEST, LastFrame, LeapCheck, leap_note, leaps, limb_leaps
from estimator.tracking.registry import TRACKERS, make_tracker, settings_for
from estimator.tracking.runner import run

CAMERA = camera_at(30.0, distance=4.5, focal=600.0, height=1.2, aim=(0.0, 0.0, 0.95))
FRAMES, FPS, LEAP = 6, 25.0, 3
FEW: dict[str, dict[str, object]] = {
    "css": {"samples": 4, "budget": {"searches": 16}},
    "single_mode": {},
    "condensation": {"particles": 200},
}


@cache
def clip(step: float, gap: int = 0) -> tuple[Observation, ...]:
    """A person replaced by a twin `step` [m] to the side, after some frames without keypoints."""
    body, rng = body_of("human34"), np.random.default_rng(7)
    q = authored_motion(body, 0.4 + np.arange(FRAMES) / FPS)
    q[LEAP:] = placed(q[LEAP:], step * np.array([-np.sin(0.52), np.cos(0.52)]), 0.0)
    seen = [observe(body, pose, [CAMERA], noise=1.0, rng=rng, index=i, time=i / FPS) for i, pose in enumerate(q)]
    for i in range(LEAP - gap, LEAP):
        seen[i] = replace(seen[i], pixels=seen[i].pixels * np.nan, confidence=seen[i].confidence * 0.0)
    return tuple(seen)


@pytest.mark.parametrize("name", ["css", "robust-single-mode", "condensation"])
def test_a_leap_is_hard_and_reported(name: str) -> None:
    body = body_of("human34")
    group = TRACKERS[name].group
    tracker = make_tracker(name, body, settings_for(name, changes={group: FEW[group]}))
    results = [r for r, _ in run(tracker, clip(1.4), 3)]
    moved = np.linalg.norm(np.diff([r.q[0, :3] for r in results], axis=0), axis=1)
    assert results[LEAP].status == "hard"
    assert (moved[LEAP - 1] > 1.0) == (name != "condensation")  # they follow the twin; particles stay behind
    assert leaps(body, results) == ([] if name == "condensation" else [LEAP])
    assert f"({LEAP};" in leap_note([LEAP])


def test_a_step_is_not_a_leap() -> None:
    body = body_of("human34")
    tracker = make_tracker("css", body, settings_for("css", changes={"css": FEW["css"]}))
    results = [r for r, _ in run(tracker, clip(0.1), 3)]
    assert leaps(body, results) == []
    assert leap_note([]) == ""


def test_time_unseen_is_time_to_move_and_survives_storing() -> None:
    """During frames without keypoints a body may move farther; a resumed run accounts for this too."""
    body = body_of("human34")
    tracker = make_tracker("css", body, settings_for("css", changes={"css": FEW["css"]}))
    straight = list(run(tracker, clip(1.0, gap=2), 3))
    state, last = straight[LEAP - 1][1], None
    for result, _ in straight[:LEAP]:
        last = LastFrame.after(last, result)
    assert state is not None
    assert last is not None
    assert last.unobserved == pytest.approx(2 / FPS)
    stored = unpack(pack(state.arrays() | last.arrays()))
    again, known = tracker.state_from(stored), LastFrame.from_arrays(stored, body)
    assert known is not None
    assert known.unobserved == last.unobserved
    resumed = [r for r, _ in run(tracker, clip(1.0, gap=2), 3, state=again, first=LEAP, last=known)]
    assert [r.status for r in resumed] == [r.status for r, _ in straight[LEAP:]]
    assert leaps(body, [r for r, _ in straight]) == []


def test_older_stored_states_restore_the_same_memory() -> None:
    """Older tracker states held the time unseen, and the roots come from the mixture."""
    body = body_of("human34")
    tracker = make_tracker("css", body, settings_for("css", changes={"css": FEW["css"]}))
    last, state = None, None
    for result, state in islice(run(tracker, clip(1.4, gap=1), 3), LEAP):  # noqa: B007
        last = LastFrame.after(last, result)
    assert state is not None
    assert last is not None
    older = state.arrays() | {"unobserved": np.array(1 / FPS)}
    stored = [LastFrame.from_arrays(arrays, body) for arrays in (older, state.arrays() | last.arrays())]
    for memory in stored:
        assert memory is not None
        assert {n: a.tobytes() for n, a in memory.arrays().items()} == {
            n: a.tobytes() for n, a in last.arrays().items()
        }
    assert LastFrame.from_arrays({"time": np.array(0.0)}, body) is None
    resumed = next(run(tracker, clip(1.4, gap=1), 3, state=state, first=LEAP, last=stored[0]))[0]
    assert resumed.status == "hard"


def test_the_limit_is_a_sprinters_and_knows_uncertainty() -> None:
    body = body_of("human34")
    check, dt = LeapCheck(body), 0.04
    sure, unsure = np.zeros((body.nv, body.nv)), np.zeros((body.nv, body.nv))
    unsure[0, 0] = 0.2**2  # along the root's own x axis
    before, after = body.neutral[None], body.neutral.copy()
    far = FASTEST * 1.75 * dt + 0.3
    after[0] += far
    assert check.leapt(before, sure[None], after, sure, dt)
    assert not check.leapt(before, sure[None], after, sure, 10 * dt)
    assert not check.leapt(before, unsure[None], after, sure, dt)
    aside = body.neutral.copy()
    aside[1] += far
    assert check.leapt(before, unsure[None], aside, sure, dt)
    nearer = np.stack([body.neutral, after])  # another hypothesis was already there
    assert not check.leapt(nearer, np.stack([sure, sure]), after, sure, dt)
    arm = body_of("arm8")
    assert not LeapCheck(arm).leapt(arm.neutral[None] + 5.0, np.zeros((1, arm.nv, arm.nv)), arm.neutral, sure, dt)


@pytest.mark.parametrize(("angle", "fps", "leaps_there"), [(2.4, 45.0, True), (2.0, 60.0, True), (0.4, 30.0, False)])
def test_arms_that_are_elsewhere_a_frame_later_leap(angle: float, fps: float, leaps_there: bool) -> None:
    body = body_of("human34")
    q = authored_motion(body, 0.4 + np.arange(10) / fps)
    first = q.copy()
    for side in ("left", "right"):
        column = body.q_names.index(f"{side}_shoulder_elevation")
        first[:, column] = np.where(np.arange(10) < 4, 0.1, 0.1 + angle)
    times = np.arange(10) / fps
    assert limb_leaps(body, body.landmarks_of(body.placed(q)), times) == []
    assert limb_leaps(body, body.landmarks_of(body.placed(first)), times) == ([4] if leaps_there else [])
    moved = body.landmarks_of(body.placed(first))
    moved[4:] = np.nan  # limbs that were not seen are unknown
    assert limb_leaps(body, moved, times) == []
