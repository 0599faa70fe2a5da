"""The tie of a smoothed trajectory to filtered modes: where it leads, what it refuses, and where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import body_of, observe, random_pose
from test_smoothing import CAMERA, FPS, swing

from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.priors import Transition
from estimator.energy.term import Term
from estimator.numerics.huber import BEND
from estimator.search.cost_model import CostModel
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing import SmoothSettings, smooth
from estimator.tracking.smoothing.filtered_mode import (
    FilteredMode,
    filtered_pulls,
    principal_axes,
    without_filtered_modes,
)
from humanoid.kinematics.body import Body

COUNT = 24
TIMES = np.arange(COUNT) / FPS


def fast(body: Body, share: float = 1.0) -> np.ndarray:
    """Poses (T, nq) of an arm that swings up to 1.2 rad and back in half a second, or a share of it."""
    q = np.tile(body.neutral, (COUNT, 1))
    q[:, body.q_names.index("left_shoulder_elevation")] += 0.6 * share * (1.0 - np.cos(4.0 * np.pi * TIMES))
    return q


def smoothed(body: Body, terms: list[list[Term]], start: np.ndarray) -> np.ndarray:
    costs = [Cost(body, of_frame) for of_frame in terms]
    return smooth(body, costs, TIMES, start, SmoothSettings().motion(CostModel(body)))


def test_exact_modes_alone_are_returned() -> None:
    body, rng = body_of("human34"), np.random.default_rng(1)
    modes = np.array([swing(body, t) for t in TIMES])
    start = np.array([body.integrate(q, rng.normal(scale=0.05, size=body.nv)) for q in modes])
    pulls = [[FilteredMode(body, q, 1e-8 * np.eye(body.nv), 1.0)] for q in modes]
    away = [body.difference(a, b) for a, b in zip(modes, smoothed(body, pulls, start), strict=True)]
    assert np.abs(away).max() < 1e-3


def test_a_shrunken_motion_is_refused() -> None:
    """Evidence that fades lets the motion prior shrink a fast swing; with the tie it stays."""
    body = body_of("human34")
    modes, std = fast(body), np.full(body.nv, 0.05)
    fading = [Transition(body, q, std, "leclerc", 1.0) for q in modes]
    pulls = [FilteredMode(body, q, np.diag(np.square(std)), 2.0) for q in modes]
    joint = body.q_names.index("left_shoulder_elevation")
    swings = [
        np.ptp(smoothed(body, [[*of_frame] for of_frame in terms], fast(body, 0.2))[:, joint])
        for terms in (zip(fading, strict=True), zip(fading, pulls, strict=True))
    ]
    assert swings[0] < 0.4 * np.ptp(modes[:, joint])
    assert swings[1] > 0.9 * np.ptp(modes[:, joint])


def test_the_pull_neither_grows_nor_fades_with_the_distance() -> None:
    body, rng = body_of("arm8"), np.random.default_rng(2)
    q, spread = body.neutral, rng.normal(scale=0.01, size=(body.nv, body.nv))
    stds, axes = principal_axes(spread @ spread.T)
    term = FilteredMode(body, q, spread @ spread.T, 3.0, 0.5)

    def at(deviations: float) -> tuple[float, np.ndarray]:
        gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
        posed = body.at(body.integrate(q, deviations * 3.0 * stds[-1] * axes[-1]))
        return term.accumulate(posed, gradient, hessian), gradient

    assert at(1.0)[0] == pytest.approx(0.5 * 0.5)
    far, farther = at(5.0), at(10.0)
    np.testing.assert_allclose(far[1], farther[1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(far[1], 0.5 * BEND * axes[-1] / (3.0 * stds[-1]), rtol=1e-6, atol=1e-9)
    assert farther[0] - far[0] == pytest.approx(0.5 * BEND * 5.0)


def test_axes_without_variance_pull_at_nothing() -> None:
    """Particles span fewer axes than a body has."""
    body, rng = body_of("arm8"), np.random.default_rng(3)
    spread = rng.normal(size=(body.nv, 3))
    stds, axes = principal_axes(spread @ spread.T)
    assert len(stds) == 3
    np.testing.assert_allclose((axes.T * np.square(stds)) @ axes, spread @ spread.T, atol=1e-9)
    term, across = FilteredMode(body, body.neutral, spread @ spread.T, 1.0), np.linalg.svd(spread)[0][:, -1]
    assert term.value(body.at(body.integrate(body.neutral, 0.3 * across))) == pytest.approx(0.0, abs=1e-9)
    nothing = FilteredMode(body, body.neutral, np.zeros((body.nv, body.nv)), 1.0)
    assert nothing.value(body.at(random_pose(body, rng))) == 0.0
    with pytest.raises(ValueError, match="covariance"):
        FilteredMode(body, body.neutral, np.zeros((0, 0)), 1.0)


def frame(body: Body, status: str = "tracked") -> tuple[Observation, FrameResult]:
    seen = observe(body, body.neutral, (CAMERA,), noise=1.0, rng=np.random.default_rng(4))
    weight, q = np.ones(1), body.neutral[None]
    covariance = 0.01 * np.eye(body.nv)[None]
    head = 0, 0.0, status, q, weight, 0.0 * weight, covariance
    return seen, FrameResult(*head, np.array([-1]), 0.0 * weight, 0.0 * weight, ("as_detected",))


def test_a_frame_is_tied_as_far_as_no_keypoint_sees_it() -> None:
    body = body_of("human34")
    seen, result = frame(body)
    none = replace(seen, confidence=np.zeros_like(seen.confidence))
    few = replace(seen, confidence=np.where(np.arange(seen.confidence.shape[1]) < 6, seen.confidence, 0.0))
    moved = body.at(body.integrate(body.neutral, np.full(body.nv, 0.2)))
    assert filtered_pulls(body, seen, result, 0, 2.0, 0.6) == []
    assert filtered_pulls(body, none, result, 0, 0.0, 0.6) == []
    assert filtered_pulls(body, none, frame(body, "unobserved")[1], 0, 2.0, 0.6) == []
    (whole,), (half,) = (filtered_pulls(body, each, result, 0, 2.0, 0.6) for each in (none, few))
    assert half.value(moved) == pytest.approx(0.5 * whole.value(moved))
    assert whole.value(moved) > 1.0
    (alone,) = filtered_pulls(body, none, result, 0, 2.0, 1.0)
    assert whole.value(moved) == pytest.approx(0.6 * alone.value(moved))


def test_the_tie_is_left_out_of_the_uncertainty() -> None:
    body = body_of("arm8")
    evidence = Cost(body, [Transition(body, body.neutral, np.full(body.nv, 0.1))])
    pull = FilteredMode(body, body.neutral, 0.01 * np.eye(body.nv), 1.0)
    np.testing.assert_array_equal(
        without_filtered_modes(evidence.plus([pull])).at(body.neutral).hessian, evidence.at(body.neutral).hessian
    )
    assert without_filtered_modes(evidence) is evidence
