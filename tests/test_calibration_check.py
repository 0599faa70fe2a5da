"""Ranks of truths: known answers, a right posterior, and posteriors that are too narrow, too wide or biased."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from builders import body_of, camera_at

from estimator.data.observation import Observation
from estimator.runs.posterior import PosteriorCalibration
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker, settings_for
from humanoid.kinematics.body import Body
from humanoid.subject.subject import subject_from_text
from kinemode.testing import ContractError, RankStatistics, SimulatedClip, check_calibration, simulated_clips
from kinemode.testing.calibration import rank_statistics
from tests.tiny_clip import FEW_STARTS

PRIOR, NOISE = np.array([0.3, 0.2]), np.array([0.2, 0.3])  # [rad] standard deviations of the two joints and readings
GAIN = PRIOR**2 / (PRIOR**2 + NOISE**2)
AS_TOLD = PosteriorCalibration(1.0, 0.0, 1.0, 1.0, landmark_std=0.0)
LAW = "ranks of the truth in the posterior are uniform"


def two_joints() -> Body:
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{a}"/><child link="{b}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for name, a, b in (("shoulder", "a", "b"), ("elbow", "b", "c"))
    )
    links = "".join(f'<link name="{n}"/><landmark name="on_{n}" link="{n}"/>' for n in "abc")
    return Body(subject_from_text(f'<robot name="r">{links}{joints}</robot>', source="test", base="fixed"))


BODY = two_joints()


class Conjugate:
    """A tracker with the exact answer: angles from the prior, read with Gaussian noise, have a Gaussian posterior.
    width: factor on its standard deviations. bias: of its mean, in standard deviations."""

    width, bias = 1.0, 0.0
    body = BODY

    def can_start(self, observation: Observation) -> bool:
        return True

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[np.ndarray, FrameResult]:
        std = np.sqrt(GAIN) * NOISE
        q = GAIN * observation.pixels[0, :2, 0] + self.bias * std
        weight, zero = np.ones(1), np.zeros(1)
        result = FrameResult(
            observation.index, observation.time, "tracked", q[None], weight, zero,
            np.diag((self.width * std) ** 2)[None], np.array([-1]), zero, zero, ("as_detected",),
        )  # fmt: skip
        return q, result


class Narrow(Conjugate):
    width = 0.5


class Wide(Conjugate):
    width = 2.0


class Biased(Conjugate):
    bias = 1.0


class Silent(Conjugate):
    def can_start(self, observation: Observation) -> bool:
        return False


def readings(count: int, seed: int) -> Iterator[SimulatedClip]:
    """Two angles from the prior, and readings of them in place of keypoints."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        q = PRIOR * rng.normal(size=2)
        pixels = np.zeros((1, 3, 2))
        pixels[0, :2, 0] = q + NOISE * rng.normal(size=2)
        yield SimulatedClip([Observation(0, 0.0, (camera_at(0.0),), pixels, np.ones((1, 3)))], q[None])


@pytest.mark.parametrize("seed", [1, 2])
def test_a_right_posterior_passes(seed: int) -> None:
    statistics = check_calibration(Conjugate, readings(150, seed), calibration=AS_TOLD)
    assert statistics.names == ("shoulder", "elbow")
    assert statistics.ranks.shape == (150, 2)
    assert statistics.calibration_error < 0.05
    assert statistics.p_value.min() > 1e-3
    np.testing.assert_allclose(statistics.coverage(np.array([0.5, 0.9])), [0.5, 0.9], atol=0.07)


@pytest.mark.parametrize(
    ("tracker", "message"),
    [
        (Narrow, r"central intervals of [89]\d% have [45]\d% of 150 truths in them, [34]\d% off"),
        (Wide, r"central intervals of [3-6]\d% have [789]\d% of 150 truths in them, [34]\d% off"),
        (Biased, r"\d+% of 150 truths are below the \d+% quantile, [34]\d% off"),
    ],
    ids=["narrow", "wide", "biased"],
)
def test_a_wrong_posterior_is_found_and_reported(tracker: type[Conjugate], message: str) -> None:
    """With very many truths, intervals are 32 % off where the posterior is too narrow or too wide by a factor of two,
    and ranks 38 % where its mean is off by its deviation."""
    with pytest.raises(ContractError, match=rf": (shoulder|elbow): {message}; the band is 1\d%") as broken:
        check_calibration(tracker, readings(150, 1), calibration=AS_TOLD)
    assert broken.value.law == LAW
    lenient = check_calibration(tracker, readings(150, 1), calibration=AS_TOLD, band=0.5)
    assert lenient.p_value.max() < 1e-6


def test_a_tracker_without_hypotheses_has_no_posterior() -> None:
    with pytest.raises(ContractError, match="clip 0 ends without hypotheses"):
        check_calibration(Silent, readings(3, 1))
    with pytest.raises(ValueError, match="there are no clips"):
        check_calibration(Conjugate, [])


def test_statistics_of_known_ranks() -> None:
    even = RankStatistics(("a", "b"), np.stack([np.arange(100), np.arange(100)[::-1]], axis=1), 99)
    np.testing.assert_allclose(even.chi_square, 0.0)
    np.testing.assert_allclose(even.p_value, 1.0)
    assert even.deviation.max() == pytest.approx(0.01)
    assert even.calibration_error < 0.01
    middle = RankStatistics(("a",), np.full((100, 1), 49), 99)  # always between the same two samples of a hundred
    assert middle.chi_square[0] == pytest.approx(900.0)  # all in one of ten bins: 90^2 / 10 + 9 * 10
    assert middle.deviation[0] == pytest.approx(0.99)
    assert middle.calibration_error == pytest.approx(0.5)


def test_ties_are_broken_evenly() -> None:
    drawn = np.zeros((4000, 9, 1))
    ranks = rank_statistics(("a",), np.zeros((4000, 1)), drawn, np.random.default_rng(0)).ranks
    assert np.bincount(ranks[:, 0], minlength=10) == pytest.approx(np.full(10, 400), abs=100)


def test_the_band_has_its_stated_false_alarm_rate() -> None:
    rng, chance = np.random.default_rng(5), 0.2
    drawn = [RankStatistics(("a", "b"), rng.integers(0, 100, (60, 2)), 99) for _ in range(400)]
    band = drawn[0].band(chance)
    beyond = sum(even.deviation.max() > band for even in drawn)
    assert 0.03 < beyond / 400 < chance + 0.06


@pytest.mark.parametrize(("covariance_scale", "right"), [(1.0, True), (0.01, False)])
def test_css_is_calibrated_on_an_arm(covariance_scale: float, right: bool) -> None:
    body = body_of("arm8")
    cameras = [camera_at(azimuth, distance=3.0) for azimuth in (10.0, 80.0)]
    settings = settings_for("css", changes={"css": {"samples": 4, "budget": {"searches": 12}}, "search": FEW_STARTS})
    clips = simulated_clips(body, cameras, 15, frames=2, seed=4)
    calibration = PosteriorCalibration(covariance_scale=covariance_scale, landmark_std=0.0)

    def check() -> RankStatistics:
        return check_calibration(lambda: make_tracker("css", body, settings), clips, calibration=calibration)

    if right:
        assert check().calibration_error < 0.15
        return
    with pytest.raises(ContractError, match="central intervals of"):
        check()
