"""Whether a tracker's posterior is as wide as its errors: simulation-based calibration (S. Talts, M. Betancourt,
D. Simpson, A. Vehtari and A. Gelman, Validating Bayesian Inference Algorithms with Simulation-Based Calibration,
arXiv 1804.06788, 2018; the band of S. Säilynoja, P.-C. Bürkner and A. Vehtari, Statistics and Computing 32, 2022, by
Kolmogorov's distribution in place of simulation).

Whether ranks of truths among samples are uniform, as those of a right posterior are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2, kstwo

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.data.sequence import assemble
from estimator.runs.coordinates import joint_entries
from estimator.runs.joint_angle import ONE_NUMBER
from estimator.runs.posterior import Posterior, PosteriorCalibration
from estimator.synthesis.detector import keypoints
from estimator.synthesis.motion import random_motion
from estimator.synthesis.settings import DetectorSettings
from humanoid.kinematics.body import Body
from kinemode.testing.laws import require
from kinemode.testing.trackers import track_frames

_BINS = 10  # of the ranks; fewer where these would hold less than five each
_FEWEST = 5
LEVELS = np.linspace(0.05, 0.95, 19)


@dataclass(frozen=True, eq=False)
class RankStatistics:
    """Ranks of true values among samples of the posteriors that claim to know them (Talts et al. 2018).

    names (n): of the coordinates. ranks (N, n): how many of the `samples` are below each of N truths, 0 to `samples`.
    """

    names: tuple[str, ...]
    ranks: np.ndarray
    samples: int

    @property
    def chi_square(self) -> np.ndarray:
        """Chi-square statistic (n,) of the ranks in bins of equal probability, with `degrees` of freedom."""
        count = self.degrees + 1
        edges = np.linspace(0.0, 1.0, count + 1)
        inside = np.array([np.histogram(place, edges)[0] for place in self._places().T])
        expected = len(self.ranks) / count
        return np.asarray(np.sum(np.square(inside - expected), axis=1) / expected)

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `chi_square`: one less than there are bins."""
        return int(np.clip(len(self.ranks) // _FEWEST, 2, _BINS)) - 1

    @property
    def p_value(self) -> np.ndarray:
        """Probability (n,) that ranks of a right posterior have so large a `chi_square`."""
        return np.asarray(chi2.sf(self.chi_square, self.degrees))

    @property
    def deviation(self) -> np.ndarray:
        """Largest distance (n,) of a coordinate's empirical distribution from the uniform one: of its ranks, which show
        a bias, and of the central intervals that reach the truth, which show a wrong width."""
        return np.maximum(self._of_ranks(), self._of_intervals())

    @property
    def calibration_error(self) -> float:
        """See `calibration_error`: of central intervals, over all coordinates together."""
        return calibration_error(self._levels())

    def coverage(self, levels: float | np.ndarray) -> np.ndarray:
        """Share of truths within the central intervals of these probabilities, over all coordinates together."""
        return coverage(self._levels(), levels)

    def band(self, chance: float) -> float:
        """The `deviation` that some coordinate of a right posterior exceeds with this probability at most: Kolmogorov's
        distribution, for all coordinates together by Bonferroni's inequality, and a step of the ranks."""
        each = kstwo.isf(chance / (2 * len(self.names)), len(self.ranks))
        return float(each + 1.0 / (self.samples + 1))

    def worst(self) -> str:
        """A description of the coordinate of the largest deviation."""
        k, count = int(np.argmax(self.deviation)), len(self.ranks)
        bias = self._of_ranks()[k] >= self._of_intervals()[k]
        place = np.sort((self._places() if bias else self._levels())[:, k])
        below = (np.arange(count) + 1.0) / count
        at = int(np.argmax(np.abs(below - place)))
        share, level = f"{below[at]:.0%}", f"{place[at]:.0%}"
        if bias:
            return f"{self.names[k]}: {share} of {count} truths are below the {level} quantile"
        return f"{self.names[k]}: central intervals of {level} have {share} of {count} truths in them"

    def _places(self) -> np.ndarray:
        return (self.ranks + 0.5) / (self.samples + 1)

    def _levels(self) -> np.ndarray:
        """The probability (N, n) of the smallest central interval that has the truth in it."""
        return np.abs(2.0 * self._places() - 1.0)

    def _of_ranks(self) -> np.ndarray:
        return _distance(self._places())

    def _of_intervals(self) -> np.ndarray:
        return _distance(self._levels())


def coverage(levels: np.ndarray, level: float | np.ndarray) -> np.ndarray:
    """Share (P,) of truths within their regions of the given level or levels (P,); levels (...): of the smallest region
    that has each truth in it."""
    return np.asarray(np.mean(levels.ravel()[:, None] <= np.atleast_1d(level), axis=0))


def calibration_error(levels: np.ndarray) -> float:
    """Expected calibration error: mean over `LEVELS` of how far the `coverage` is from the level."""
    return float(np.mean(np.abs(coverage(levels, LEVELS) - LEVELS)))


def rank_statistics(
    names: Sequence[str], truth: np.ndarray, drawn: np.ndarray, rng: np.random.Generator
) -> RankStatistics:
    """The ranks of N truths (N, n) among samples (N, S, n) each of n named coordinates; ties are broken at random."""
    below, equal = (np.sum(f(drawn, truth[:, None]), axis=1) for f in (np.less, np.equal))
    return RankStatistics(tuple(names), below + rng.integers(0, equal + 1), drawn.shape[1])


def _distance(places: np.ndarray) -> np.ndarray:
    """Kolmogorov's distance (n,) of N places (N, n) from the uniform distribution on 0 to 1."""
    ordered, steps = np.sort(places, axis=0), np.arange(len(places) + 1.0)[:, None] / len(places)
    return np.asarray(np.maximum(steps[1:] - ordered, ordered - steps[:-1]).max(axis=0))


_LAW = "ranks of the truth in the posterior are uniform"


class SimulatedClip(NamedTuple):
    """observations (T): of a body whose true configurations are q (T, nq)."""

    observations: Sequence[Observation]
    q: np.ndarray


def simulated_clips(
    body: Body,
    cameras: Sequence[Camera],
    count: int,
    *,
    motion: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None,
    frames: int = 3,
    noise_px: float = 2.5,
    bias: float = 0.0,
    fps: float = 30.0,
    seed: int = 0,
) -> Iterator[SimulatedClip]:
    """So many short clips of known motions, whose keypoints are those of a simulated detector with noise of known size.

    There are no outliers and no missing keypoints (`estimator.synthesis.detector`); observations have the noise as
    their jitter, which trackers count beside the noise that they suppose of every detector.

    Parameters
    ----------
    cameras: that see the body. motion: true configurations (T, nq) at times (T,) [s], drawn for each clip; parts
        of random motions within the limits (`estimator.synthesis.motion`) unless given.
    frames: of each clip. noise_px: standard deviation of the keypoints [px]. bias [m]: see
        `DetectorSettings`; drawn for each clip. fps: of the frames [1/s].
    """
    for clip in range(count):
        rng = np.random.default_rng((seed, clip))
        times = np.arange(frames) / fps
        q = motion(times, rng) if motion is not None else random_motion(body, rng.uniform(0.4, 2.4) + times, rng)
        tracks = keypoints(body, q, cameras, rng, DetectorSettings(noise_px, 0.0, 0.0, bias))
        by_name = {camera.name: camera for camera in cameras}
        seen = assemble(body, dict(zip(by_name, tracks, strict=True)), by_name, times)
        yield SimulatedClip([replace(frame, jitter=(noise_px,) * len(cameras)) for frame in seen], q)


def check_calibration(
    make: Callable[[], Any],
    clips: Iterable[SimulatedClip],
    *,
    band: float | None = None,
    chance: float = 1e-3,
    samples: int = 99,
    calibration: PosteriorCalibration | None = None,
    seed: int = 0,
) -> RankStatistics:
    """Check that the posterior of a tracker is calibrated: that ranks of the true angles among its samples are uniform.

    The last frame of each clip counts, as frames of one clip are not independent; so do joints that one number places,
    and not a free root. Ranks are exactly uniform where truths come from the tracker's own prior and noise from its own
    model. Where they do not, `band` is how far a tracker may be off.

    Parameters
    ----------
    make: a new tracker, each time it is called.
    clips: independent of each other, from whose first frames it can start, such as `simulated_clips`.
    band: the largest distance of a coordinate's distribution of ranks, or of covered intervals, from the uniform one
        (`RankStatistics.deviation`, 0 to 1); by default what a right posterior exceeds with probability `chance`.
    samples: of each posterior. calibration: between the tracker's numbers and its posterior; that of `Run.posterior`
        unless given. seed: of trackers and samples.

    Raises
    ------
    ContractError: a clip ends without hypotheses; a deviation is beyond the band.
    ValueError: there is no clip, or a body without a joint that one number places.
    """
    who, body = type(make()).__name__, make().body
    joints = {e.name: int(body.model.idx_vs[body.model.getJointId(e.name)]) for e in joint_entries(body)
              if e.kind in ONE_NUMBER and not e.follows}  # fmt: skip
    truths, drawn = [], []
    for i, clip in enumerate(clips):
        result = track_frames(make(), clip.observations, (seed, i))[-1].result
        there = result is not None and len(result.weight) > 0
        require(there, who, "a frame has a posterior", f"clip {i} ends without hypotheses")
        assert result is not None
        posterior = Posterior.of(body, result, calibration)
        at, rng = posterior.best, np.random.default_rng((seed, i, 1))
        truths.append(body.difference(at, clip.q[-1]))
        drawn.append([body.difference(at, q) for q in posterior.sample(rng, samples)])
    if not truths or not joints:
        raise ValueError("there are no clips" if joints else "the body has no joint that one number places")
    kept = list(joints.values())
    truth, among = np.array(truths)[:, kept], np.array(drawn)[:, :, kept]
    statistics = rank_statistics(list(joints), truth, among, np.random.default_rng(seed))
    limit = statistics.band(chance) if band is None else band
    off = float(statistics.deviation.max())
    detail = f"{statistics.worst()}, {off:.0%} off; the band is {limit:.0%}"
    require(off <= limit, who, _LAW, f"{detail}, the expected calibration error {statistics.calibration_error:.3f}")
    return statistics
