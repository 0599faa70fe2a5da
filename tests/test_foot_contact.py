"""When feet stand and on what floor: known motions, the chain against all paths, and force plates."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.foot_contact import agreements
from estimator.inference.contacts import _smoothed, foot_contact, standing_probability
from estimator.inference.ground import fitted_ground

UP = np.array([0.0, 0.0, 1.0])
HEEL, TOE = 0.05, 0.01  # m above the sole
STANCE, CYCLE, STEP = 0.6, 1.0, 1.2  # s, s, m


def walk(fps: float, noise: float = 0.0, seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heels and toes (T, 4, 3) of two feet in turn, times (T,), and whether each foot stands (T, 2)."""
    time = np.arange(0.0, seconds, 1.0 / fps)
    points, stands = [], []
    for phase in (0.0, 0.5):
        cycles = time / CYCLE + phase
        done, part = np.floor(cycles), cycles % 1.0
        swing = np.clip((part - STANCE) / (1.0 - STANCE), 0.0, 1.0)
        along = STEP * (done + swing - np.sin(2 * np.pi * swing) / (2 * np.pi))
        lift = 0.12 * np.sin(np.pi * swing) ** 2
        for ahead, above in ((0.0, HEEL), (0.2, TOE)):
            points.append(np.stack([along + ahead, np.full_like(time, 0.2 * phase), lift + above], axis=1))
        stands.append(part < STANCE)
    rng = np.random.default_rng(0)
    exact = np.stack(points, axis=1)
    return exact + noise * rng.normal(size=exact.shape), time, np.stack(stands, axis=1)


@pytest.mark.parametrize(("fps", "noise"), [(30.0, 0.0), (30.0, 0.003), (120.0, 0.003)])
def test_walking_feet_stand_and_swing(fps: float, noise: float) -> None:
    points, time, stands = walk(fps, noise)
    kind = np.array([0, 1, 0, 1])
    contact = foot_contact(points, time, kind, UP)
    ours = contact.standing.reshape(-1, 2, 2).max(axis=2) > 0.5
    for side in range(2):
        near = np.abs(time[:, None] - time[1:][np.diff(stands[:, side].astype(int)) != 0]).min(axis=1) < 0.09
        assert np.array_equal(ours[~near, side], stands[~near, side])
    assert contact.floor is not None
    lowest = contact.floor.height + contact.floor.above
    assert lowest == pytest.approx([HEEL, TOE], abs=0.004 + 1.5 * noise)  # below nine tenths of the observations
    heights = contact.floor.heights(points, kind).reshape(-1, 2, 2)[stands]
    assert np.abs(heights).max() < 0.005 + 5.5 * noise


def test_a_floor_may_slope() -> None:
    """Within the error of up; feet on a box are left out."""
    rng = np.random.default_rng(1)
    slope = np.array([0.06, -0.04])
    level = rng.uniform(-2.0, 2.0, (200, 2))
    points = np.column_stack([level, 0.7 + level @ slope])
    points[::10, 2] += 0.3
    floor = fitted_ground(points[:, None], np.ones((200, 1)), np.zeros(1, int), UP, tilt=0.1)
    assert floor is not None
    normal = np.array([*-slope, 1.0]) / np.sqrt(1.0 + slope @ slope)
    np.testing.assert_allclose(floor.normal, normal, atol=2e-3)
    on_box = np.arange(200) % 10 == 0
    heights = floor.heights(points[:, None], np.zeros(1, int))[:, 0]
    assert np.abs(heights[~on_box]).max() < 0.005
    assert heights[on_box] == pytest.approx(0.3, abs=0.01)


def test_without_stances_there_is_no_floor() -> None:
    points = np.cumsum(np.full((40, 1, 3), 0.1), axis=0)
    contact = foot_contact(points, np.arange(40) / 30.0, np.zeros(1, int), UP)
    assert contact.floor is None
    assert contact.standing.max() < 0.1


def test_a_foot_rests_on_a_box() -> None:
    """Higher than the other, for longer than a swing."""
    points, time, _ = walk(60.0)
    points[:, :2, 2] += 0.4
    points[:, :2, :2] = points[:1, :2, :2]
    points[:, :2, 2] = points[:1, :2, 2]
    assert foot_contact(points, time, np.array([0, 1, 0, 1]), UP).standing[:, :2].min() > 0.5


def test_a_gap_in_a_stance_is_bridged() -> None:
    points, time, _ = walk(60.0)
    gap = (time > 0.2) & (time < 0.4)
    points[gap, 0] = np.nan
    assert standing_probability(points, time)[gap, 0].min() > 0.5


def test_probabilities_are_those_of_all_paths() -> None:
    rng = np.random.default_rng(2)
    log, gaps = rng.normal(0.0, 2.0, (6, 1, 2)), rng.uniform(0.01, 0.3, 5)
    total, standing = 0.0, np.zeros(6)
    for path in product((0, 1), repeat=6):
        weight = np.exp(sum(log[t, 0, s] for t, s in enumerate(path)))
        for gap, (a, b) in zip(gaps, pairwise(path), strict=True):
            leave = 1.0 - np.exp(-gap / (0.4, 0.6)[a])
            weight *= leave if a != b else 1.0 - leave
        total += weight
        standing += weight * np.array(path)
    np.testing.assert_allclose(_smoothed(log, gaps)[:, 0], standing / total, rtol=1e-9)


def test_force_plates_agree(shared_data: Path) -> None:
    folder = shared_data / "opencap" / "subject4"
    if not folder.is_dir():
        pytest.skip("needs opencap/subject4")
    for agreement in agreements(folder, "walking1").values():
        assert agreement.f1 > 0.9
        assert np.nanmax(np.abs(agreement.off)) <= 0.035
