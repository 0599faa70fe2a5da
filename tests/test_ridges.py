"""Steered derivatives: closed forms of a wave, a picture that is turned, steps and bars."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.trackers.loose_limbed.limbs.ridges import SCALES, ridges_of

HEIGHT, WIDTH = 200, 240
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(float)
INSIDE = np.random.default_rng(0).uniform([70, 70], [WIDTH - 70, HEIGHT - 70], (200, 2))


def wave(angle: float, length: float) -> np.ndarray:
    """Grey values that go up and down along `angle` [rad] with a period [px]."""
    return 128.0 + 100.0 * np.sin(2.0 * np.pi / length * (X * np.cos(angle) + Y * np.sin(angle)))


@pytest.mark.parametrize("scale", range(len(SCALES)))
def test_a_wave_has_the_derivatives_that_calculus_gives(scale: int) -> None:
    angle, length, sigma = 0.7, 90.0, SCALES[scale]
    answer = ridges_of(wave(angle, length))
    at = np.floor((INSIDE + 0.5) / answer.steps[scale]) * answer.steps[scale] + 0.5 * (answer.steps[scale] - 1)
    k = 2.0 * np.pi / length
    phase = k * (at @ [np.cos(angle), np.sin(angle)])
    damped = 100.0 * np.exp(-0.5 * (sigma * k) ** 2)
    across = np.full(len(at), angle - 0.5 * np.pi)  # a line along the wave's crests
    np.testing.assert_allclose(answer.edge(scale, at, across), damped * sigma * k * np.cos(phase), atol=0.02 * damped)
    bend = damped * (sigma * k) ** 2 * np.abs(np.sin(phase))
    np.testing.assert_allclose(answer.ridge(scale, at, across), bend, atol=0.02 * damped)


@pytest.mark.parametrize("scale", range(len(SCALES)))
def test_the_response_turns_with_the_picture(scale: int) -> None:
    """Exactly for a quarter turn; for any angle within the accuracy of pixels."""
    rng = np.random.default_rng(1)
    picture = np.kron(rng.uniform(0, 255, (12, 12)), np.ones((16, 16))).astype(np.uint8)
    whole = ridges_of(picture)
    turned = ridges_of(np.rot90(picture).copy())  # (x, y) -> (y, W - 1 - x)
    at = rng.integers(40, 150, (300, 2)).astype(float)
    at = (at // 4) * 4 + 1.0
    there = np.stack([at[:, 1], 191.0 - at[:, 0]], axis=1)
    angle = rng.uniform(-np.pi, np.pi, 300)
    for response in ("edge", "ridge"):
        before = getattr(whole, response)(scale, at, angle)
        after = getattr(turned, response)(scale, there, angle - 0.5 * np.pi)
        np.testing.assert_allclose(after, before, atol=1e-3)
    bar = [ridges_of(_bar(turn, 2.0 * SCALES[scale])) for turn in (0.2, 1.1)]
    centre, some = np.array([[120.0, 100.0]]).repeat(60, axis=0), np.linspace(-1.5, 1.5, 60)
    values = [b.ridge(scale, centre, some + turn) for b, turn in zip(bar, (0.2, 1.1), strict=True)]
    np.testing.assert_allclose(values[0], values[1], atol=0.03 * np.abs(values[0]).max())
    assert abs(some[values[0].argmax()]) < 0.06  # and it is the largest along the bar


def test_a_bar_answers_most_at_half_its_width() -> None:
    for width in (8.0, 14.0, 24.0):
        answer = ridges_of(_bar(0.4, width))
        centre, along = np.array([[120.0, 100.0]]), np.array([0.4])
        values = [float(answer.ridge(s, centre, along)[0]) for s in range(len(SCALES))]
        nearest = int(np.argmin(np.abs(np.log(answer.scales / (0.5 * width)))))
        assert abs(int(np.argmax(values)) - nearest) <= 1
        side = centre + 0.5 * width * np.array([[-np.sin(0.4), np.cos(0.4)]])
        step = 200.0 / np.sqrt(2.0 * np.pi)  # of an edge with nothing near
        assert float(answer.edge(0, side, along)[0]) == pytest.approx(-step, rel=0.25)


def test_an_even_picture_gives_no_ridges() -> None:
    even = ridges_of(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    assert max(float(np.abs(m).max()) for m in (*even.first, *even.second)) < 1e-2


def _bar(angle: float, width: float) -> np.ndarray:
    """A bright bar through (120, 100) along `angle` [rad], its sides smooth over a pixel."""
    away = np.abs((Y - 100.0) * np.cos(angle) - (X - 120.0) * np.sin(angle))
    return np.asarray(20.0 + 200.0 * np.clip(0.5 * width - away + 0.5, 0.0, 1.0))
