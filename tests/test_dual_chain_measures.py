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
    EventClip,
    event_frames,
    event_motion,
    hands_of,
    upper_body,
)  # fmt: skip
from benchmarks.papers_dual_chain.dual_chain_events import FIRST, LATER, EventRun, figures, level, show
from benchmarks.papers_dual_chain.limb_losses import losses
from benchmarks.support import standard_errors
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


def test_standard_errors_are_the_deviations_of_repeated_measures() -> None:
    """Of shares and of ratios of means of paired numbers, by drawing the whole measure again and again."""
    rng, count = np.random.default_rng(0), 40
    shares = rng.binomial(count, 0.8, size=4000) / count
    assert np.mean([standard_errors.of_share(round(s * count), count) for s in shares[:500]]) == pytest.approx(
        shares.std(), rel=0.05
    )
    assert standard_errors.of_share(count, count) > 0.0
    below = rng.gamma(4.0, 10.0, size=(4000, count))
    above = 1.3 * below + 8.0 * rng.normal(size=below.shape)
    errors = [standard_errors.of_ratio(a, b) for a, b in zip(above[:500], below[:500], strict=True)]
    assert np.mean(errors) == pytest.approx((above.mean(axis=1) / below.mean(axis=1)).std(), rel=0.05)


def test_the_table_of_events_compares_the_same_clips(capsys: pytest.CaptureFixture[str]) -> None:
    on = [False] * 8 + [True] * 4 + [False] * 8
    runs, results = [], []
    for seed, before in enumerate((20.0, 40.0)):
        for label, more in (("dual-chain", 0.0), ("one-way", 6.0)):
            error = [before * (1.5 if event else 1.0) + more * event for event in on]
            levels = [[0.5, 0.5]] * len(on)
            runs.append(EventRun(EventClip(LOST, seed), label))
            results.append(
                {"on": on, "error": error, "right": [True] * len(on), "levels": levels, "levels_world": levels}
            )
    full, other = show(runs, results, [LOST], ["dual-chain", "one-way"])
    assert (full["ratio"], full["ratio_error"], full["less"]) == pytest.approx((1.5, 0.0, 0.0), abs=1e-12)
    assert (other["ratio"], other["less"], other["less_error"]) == pytest.approx((1.7, 6.0, 0.0), abs=1e-12)
    assert other["ratio_error"] == pytest.approx(2.0 / 30.0)  # 1.7 times before is off by 2 and -2 mm
    assert "1.50 ± 0.00" in capsys.readouterr().out


def test_an_arm_is_lost_once_until_it_is_found() -> None:
    error = np.array([170.0, 70.0, 40.0, 140.0, 151.0, 130.0, 51.0, 49.0, 20.0, 300.0])
    assert losses(error) == (2, 4)
    assert losses(np.full(9, 70.0)) == (0, 0)
