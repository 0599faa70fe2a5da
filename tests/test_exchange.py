"""Left and right are exchanged where that could explain the keypoints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import body_of, camera_at, observe, random_pose

from estimator.data.observation import Observation
from estimator.search.mode_search import ModeSearch
from estimator.trackers.mixture_state import MixtureState
from estimator.tracking.registry import make_tracker

BODY = body_of("human34")
CAMERAS = (camera_at(0.0), camera_at(100.0), camera_at(220.0))
Q = random_pose(BODY, np.random.default_rng(4), share=0.3)


def search() -> ModeSearch:
    tracker = make_tracker("css", BODY)
    made: ModeSearch = tracker.search  # type: ignore[attr-defined]
    return made


def swapped(seen: Observation, cameras: list[int], mirror: np.ndarray) -> Observation:
    """With left and right exchanged in some cameras."""
    pixels, confidence = seen.pixels.copy(), seen.confidence.copy()
    pixels[cameras], confidence[cameras] = pixels[cameras][:, mirror], confidence[cameras][:, mirror]
    return replace(seen, pixels=pixels, confidence=confidence)


@pytest.mark.parametrize(
    ("count", "wrong", "names"),
    [
        (1, [], ["as_detected", "exchanged"]),  # one camera hardly distinguishes front from back
        (3, [], ["as_detected"]),
        (3, [1], ["as_detected", "exchanged"]),
        (3, [0, 1, 2], ["as_detected", "exchanged"]),
    ],
)
def test_several_cameras_exchange_sides_where_one_of_them_gains(count: int, wrong: list[int], names: list[str]) -> None:
    by = search()
    seen = swapped(observe(BODY, Q, CAMERAS[:count], noise=3.0, rng=np.random.default_rng(5)), wrong, by.mirror)
    assert [a.name for a in by.associations(seen, Q)] == names
    assert len(by.associations(seen)) == 2  # the body's place is unknown


def test_sides_that_all_cameras_exchange_for_a_while_are_followed() -> None:
    tracker = make_tracker("css", BODY)
    by: ModeSearch = tracker.search  # type: ignore[attr-defined]
    state, results = None, []
    for i in range(6):
        seen = observe(BODY, Q, CAMERAS[:2], noise=2.0, rng=np.random.default_rng(i), index=i, time=i / 30.0)
        seen = swapped(seen, [0, 1] if i in (2, 3) else [], by.mirror)
        rng = np.random.default_rng(i)
        state, result = tracker.init(rng, seen) if state is None else tracker.step(rng, state, seen)
        assert isinstance(state, MixtureState)
        results.append(result)
    assert [r.association[0] for r in results] == ["as_detected"] * 2 + ["exchanged"] * 2 + ["as_detected"] * 2
    truth = BODY.landmarks(BODY.at(Q))
    for result in results:
        assert np.linalg.norm(BODY.landmarks(BODY.at(result.q[0])) - truth, axis=1).mean() < 0.03
