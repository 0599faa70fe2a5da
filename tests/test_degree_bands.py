"""Truths in a run's intervals: directions of coordinates, and levels with a known answer."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from builders import body_of, random_pose

from benchmarks.accuracy.degree_bands import COORDINATES, calibration, central_levels, directions
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates
from estimator.runs.marginals import Marginals

BODY = body_of("human34")
POSES = np.array([random_pose(BODY, np.random.default_rng(k), share=0.2) for k in range(3)])


def test_coordinates_go_with_the_joints_or_against_them() -> None:
    signs = directions(BODY, POSES)
    assert signs["left_knee_flexion"] == signs["right_hip_flexion"] == signs["left_elbow_flexion"] == 1.0
    assert signs["lumbar_flexion"] == signs["left_hip_abduction"] == signs["right_hip_abduction"] == -1.0


@pytest.mark.parametrize(("off", "level"), [(0.0, 0.0), (1.6449, 0.9), (-0.6745, 0.5)])
def test_a_truth_that_is_some_deviations_off_has_their_level(off: float, level: float) -> None:
    """Gaussians of 4 degrees about the run's pose, far from limits, for any zero."""
    std, nv = np.radians(4.0), BODY.nv
    far = np.full(nv, 10.0)

    def posterior(frame: int) -> SimpleNamespace:
        rows = np.zeros((nv, 1))
        normal = Marginals(np.ones(1), rows, rows + std, rows, -far, far)
        return SimpleNamespace(best=POSES[frame], marginals=lambda: normal)

    run = SimpleNamespace(body=BODY, q=POSES, posterior=posterior)
    names, ours = gait_coordinates(BODY, POSES, GAIT_MODELS["rajagopal"])
    truth = {c: ours[:, names.index(c)] + 4.0 * off for c in COORDINATES.values()}
    levels = central_levels(run, np.arange(3), truth)  # type: ignore[arg-type]
    assert set(levels) == set(COORDINATES)
    for own in levels.values():
        np.testing.assert_allclose(own, level, atol=1e-4)


def test_even_levels_are_calibrated_and_narrow_ones_are_not() -> None:
    even = np.linspace(0.0, 1.0, 2001)
    right = calibration({"a": even, "b": even})
    assert right["90 %"] == pytest.approx(0.9, abs=1e-3)
    assert right["error"] < 1e-3
    narrow = calibration({"a": even, "b": np.sqrt(even)})
    assert (narrow["fewest"], narrow["most"]) == pytest.approx((0.81, 0.9), abs=2e-3)
    assert narrow["error"] == pytest.approx(
        np.mean(0.5 * np.abs(np.linspace(0.05, 0.95, 19) ** 2 - np.linspace(0.05, 0.95, 19))), abs=2e-3
    )
