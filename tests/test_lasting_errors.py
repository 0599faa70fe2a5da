"""Lasting keypoint errors are separated from independent ones, and removed in smoothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import body_of, camera_at, observe
from test_smoothing import CAMERA, FPS, points

from estimator.energy.cost import Cost
from estimator.search.cost_model import CostModel
from estimator.synthesis.detector import correlated_noise
from estimator.tracking.smoothing import SmoothSettings, smooth
from estimator.tracking.smoothing.lasting_errors import (
    Residuals,
    by_whole_error,
    frame_shares,
    lasting_errors,
    without_lasting,
)

LASTING = 0.25  # s


def residuals(new: float, lasting: float, count: int = 600, fps: float = FPS, places: int = 20) -> Residuals:
    """Errors [px] of one camera, independent ones and lasting ones, of a detector expected to err by both together."""
    rng, times = np.random.default_rng(3), np.arange(count) / fps
    persistence = np.exp(-1.0 / (fps * LASTING))
    pixels = lasting * correlated_noise(rng, (count, 1, places, 2), persistence)
    pixels += new * rng.normal(size=pixels.shape)
    shape = pixels.shape[:-1]
    return Residuals(times, pixels, np.full(shape, np.hypot(new, lasting)), np.ones(shape), np.ones(shape))


@pytest.mark.parametrize("fps", [30.0, 60.0])
@pytest.mark.parametrize(("new", "lasting"), [(2.0, 5.0), (4.0, 3.0), (3.0, 0.0)])
def test_the_share_of_a_frame_is_how_much_errors_change_in_one(new: float, lasting: float, fps: float) -> None:
    made = residuals(new, lasting, fps=fps)
    changed = np.hypot(new, lasting * np.sqrt(1.0 - np.exp(-1.0 / (30.0 * LASTING))))
    expected = min(1.0, changed / np.hypot(new, lasting))
    assert frame_shares(made) == pytest.approx(expected, rel=0.03)
    made.pixels[::10, :, :4] += 300.0  # outliers
    made.pixels[5:90, :, 4] = np.nan
    assert frame_shares(made) == pytest.approx(expected, rel=0.1)


def test_few_frames_give_little_evidence() -> None:
    made = residuals(0.5, 5.0, places=3)
    assert frame_shares(made) < 0.5
    short = Residuals(*(part[:4] for part in made))
    assert 0.85 < frame_shares(short) < 1.0
    assert frame_shares(Residuals(*(part[:1] for part in made))) == 1.0


def test_what_lasts_is_found_and_what_does_not_change_keeps_its_pull() -> None:
    made = residuals(2.0, 5.0)
    share = frame_shares(made)
    truth = made.pixels - residuals(2.0, 0.0).pixels  # with the same draws
    errors = lasting_errors(made, share, LASTING)
    assert np.sqrt(np.square(errors - truth).mean()) < 0.5 * np.sqrt(np.square(made.pixels).mean())
    still = made._replace(pixels=np.full_like(made.pixels, 5.0))
    new, whole = share[0] * made.sigma[0, 0, 0], made.sigma[0, 0, 0]
    for seen in (still, still._replace(confidence=0.5 * still.confidence)):
        left = seen.pixels - lasting_errors(seen, share, LASTING)
        np.testing.assert_allclose(left / new**2, still.pixels / whole**2, rtol=1e-9)
    far = made._replace(left=np.full_like(made.left, 0.3))  # outliers
    assert np.abs(lasting_errors(far, np.ones(1), LASTING)).max() < 1e-3  # all errors are independent


def test_sudden_movements_are_followed_where_errors_stay() -> None:
    body, rng, times = body_of("human34"), np.random.default_rng(5), np.arange(40) / FPS
    truth = np.tile(body.neutral, (40, 1))
    for joint in ("left_shoulder_elevation", "right_hip_flexion"):
        truth[:, body.q_names.index(joint)] += np.clip((np.arange(40) - 18) / 3.0, 0.0, 1.0)
    seen = [observe(body, q, (CAMERA,), index=i, time=i / FPS) for i, q in enumerate(truth)]
    errors = 2.0 * rng.normal(size=seen[0].pixels.shape)
    model = CostModel(body)
    detected: list[Cost] = [model.cost(model.observation_term(replace(o, pixels=o.pixels + errors))) for o in seen]
    motion = SmoothSettings().motion(model)
    plain = smooth(body, detected, times, truth, motion)
    costs = list(without_lasting(body, detected, times, plain, LASTING))
    followed = smooth(body, costs, times, plain, motion)
    pictures = [np.array([CAMERA.project(x) for x in points(body, q)]) for q in (plain, followed, truth)]
    before, after = (np.linalg.norm(np.diff(p - pictures[2], axis=0)) for p in pictures[:2])
    assert after < 0.95 * before
    for whole, cost in zip(detected, costs, strict=True):
        assert by_whole_error(cost).value_at(truth[0]) == whole.value_at(truth[0])


@pytest.mark.parametrize("count", [1, 2, 12])
def test_clips_of_few_frames_and_cameras_that_see_nothing(count: int) -> None:
    body, cameras = body_of("human34"), (CAMERA, camera_at(80.0))
    seen = [
        observe(body, body.neutral, cameras, noise=3.0, rng=np.random.default_rng(i), index=i, time=i / FPS)
        for i in range(count)
    ]
    for observation in seen[4:]:
        observation.confidence[1], observation.pixels[1] = 0.0, np.nan
    for observation in seen[2:3]:
        observation.confidence[:], observation.pixels[:] = 0.0, np.nan
    model = CostModel(body)
    costs: list[Cost] = [model.cost(model.observation_term(o)) for o in seen]
    q = np.tile(body.neutral, (count, 1))
    corrected = without_lasting(body, costs, np.arange(count) / FPS, q, LASTING)
    assert (corrected is None) == (count == 1)
    assert np.isfinite([cost.value_at(body.neutral) for cost in corrected or costs]).all()


def test_frames_without_cameras_stay_as_they_are() -> None:
    body = body_of("arm8")
    costs = [CostModel(body).cost(None)] * 3
    assert without_lasting(body, costs, np.arange(3) / FPS, np.tile(body.neutral, (3, 1)), LASTING) is None
