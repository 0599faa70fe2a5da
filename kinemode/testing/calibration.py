"""Whether a tracker's posterior is as wide as its errors: simulation-based calibration (S. Talts, M. Betancourt,
D. Simpson, A. Vehtari and A. Gelman, Validating Bayesian Inference Algorithms with Simulation-Based Calibration,
arXiv 1804.06788, 2018; the band of S. Säilynoja, P.-C. Bürkner and A. Vehtari, Statistics and Computing 32, 2022, by
Kolmogorov's distribution in place of simulation)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.data.sequence import assemble
from estimator.runs.calibration import PosteriorCalibration
from estimator.runs.coordinates import joint_entries
from estimator.runs.joint_angle import ONE_NUMBER
from estimator.runs.posterior import Posterior
from estimator.synthesis.detector import keypoints
from estimator.synthesis.random_motion import random_motion
from estimator.synthesis.settings import DetectorSettings
from humanoid.kinematics.body import Body
from kinemode.testing.laws import require
from kinemode.testing.ranks import RankStatistics, rank_statistics
from kinemode.testing.trackers import track_frames

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
    cameras: that see the body. motion: true configurations (T, nq) at times (T,) [s], drawn anew for each clip; parts
        of random motions within the limits (`estimator.synthesis.random_motion`) unless given.
    frames: of each clip. noise_px: standard deviation of the keypoints [px]. bias [m]: see
        `DetectorSettings`; drawn anew for each clip. fps: of the frames [1/s].
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
