"""The measures of trackers with several chains are right."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers_dual_chain.css_dual import GAP, GONE, TIMES, with_gaps
from benchmarks.papers_dual_chain.dual_chain_event_clips import (
    CROSSING,
    EVENTS,
    FACE,
    LOST,
    event_frames,
    event_motion,
    hands_of,
    upper_body,
)  # fmt: skip
from benchmarks.papers_dual_chain.dual_chain_events import FIRST, LATER, figures, level
from humanoid.collision.self_collision import SelfCollision


@pytest.mark.paper
def test_levels_are_even_where_the_density_is_right() -> None:
    """Up to the kernel width, which adds a seventh to variances; all are high where the width is too narrow."""
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(400, 2)) * [3.0, 1.0]
    truths = rng.normal(size=(500, 2)) * [3.0, 1.0]
    right = np.array([level(samples, truth, rng) for truth in truths])
    narrow = np.array([level(0.3 * samples, truth, rng) for truth in truths])
    for share in (0.5, 0.9):
        assert np.mean(right <= share) == pytest.approx(1.0 - (1.0 - share) ** 1.135, abs=0.06)
    assert np.mean(narrow <= 0.9) < 0.5


def test_an_event_is_measured_by_its_frames() -> None:
    on = np.zeros(40, dtype=bool)
    on[10:20] = True
    error = np.full(40, 7.0)
    error[:FIRST], error[10:20], error[20 : 20 + LATER] = 99.0, 50.0, 20.0
    right = np.zeros(40, dtype=bool)
    right[19 + LATER] = True
    levels = np.full((40, 2), 0.95)
    levels[10:15] = 0.2
    result = figures({"on": on, "error": error, "right": right, "levels": levels, "levels_world": levels[::-1]})
    assert (result["before"], result["during"], result["after"], result["right"]) == (7.0, 50.0, 20.0, 1.0)
    assert (result["covers"], result["covers_world"]) == (0.5, 0.0)


@pytest.mark.parametrize("event", EVENTS)
def test_motions_contain_their_event(event: str) -> None:
    """Within the limits, no overlapping parts, hands apart before and after the event."""
    q, body = event_motion(event, np.random.default_rng(3)), upper_body()
    on, collision = event_frames(event, q), SelfCollision(body)
    assert (q >= body.lower).all()
    assert (q <= body.upper).all()
    assert max(collision.penetration(body.at(pose)) for pose in q) < 0.005
    head, left, right = np.moveaxis(hands_of(q)[:, :, 1:], 1, 0)
    away = np.linalg.norm(left - right, axis=1)
    assert min(away[0], away[-1]) > 0.25
    assert on.any()
    assert not on[: FIRST + 1].any()
    if event == CROSSING:
        assert (left[on, 0] < right[on, 0]).any()
    if event == FACE:
        assert min(np.linalg.norm(hand - head, axis=1).min() for hand in (left, right)) < 0.07
    if event == LOST:
        assert on.sum() == 15


def test_gaps_are_as_long_and_as_many_as_they_should_be(tmp_path: Path) -> None:
    names = ["nose", *GONE]
    frames = [{"keypoints": [[1.0, 2.0, 0.9] for _ in names]} for _ in range(100)]
    source, to = tmp_path / "a.json", tmp_path / "b.json"
    source.write_text(json.dumps({"names": names, "frames": frames}), encoding="utf-8")
    gone = with_gaps(source, to, 4)
    seen = np.array([[k[2] for k in frame["keypoints"]] for frame in json.loads(to.read_text())["frames"]])
    assert (seen[:, 0] == 0.9).all()
    for i, name in enumerate(GONE):
        np.testing.assert_array_equal(seen[:, i + 1] == 0.0, gone[name])
        assert gone[name].sum() == TIMES * GAP
        begins = np.flatnonzero(np.diff(gone[name].astype(int)) == 1)
        assert len(begins) == TIMES
        assert begins[0] >= 2
