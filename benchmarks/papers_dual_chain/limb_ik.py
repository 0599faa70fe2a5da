"""Arms drawn from an image by inverse kinematics: how many a second, how exactly they meet it, what their weights are.

    python -m benchmarks limb_ik [--arms 200000] [--json FILE]

Taycher et al. 2004, section 4. The end of an arm drawn over all that it can reach in the image (a wide normal density),
in perspective and by parallel projection: the middle of upper13's hand, human34's, talos' (three axes, no swivel) and
g1's wrist (axes that miss each other). Samples weighed by one over their density are beside an even draw of angles, by
chi-square over bins of all angles; weights are bounded by leaving out where the proposal has less than a hundredth of
its largest density. Bars: p > 0.01, 1e-9 m, no limit left, 50,000 a second.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from benchmarks.support.common import Json, save
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.inference.chains.feature_density import gaussian
from estimator.search.jumps.anatomy import TwoSegmentLimb, anatomy_of
from estimator.search.point_features import skin_features
from estimator.trackers.dual_chain.limb_ik import Arms, ImageProposal, LimbIK
from humanoid.kinematics.body import Body, points_of_each
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

SIZE = 640, 480
BINS = 3  # of each angle
FEWEST = 60  # samples in a bin that counts, of either kind
BOUND = 100.0  # of weights: the largest over the least


@dataclass(frozen=True)
class Row:
    """One body and camera. reached: share of the draws that are arms. bins, samples: see `Fit`.
    p, p_without: of weights with and without the volume. metres: largest distance of an end, as Pinocchio places it,
    from the line of sight that it was drawn on. outside: largest excess over a limit [rad]. draws, arms: a second, on
    given trunks, limits and density included; arms are those draws that are in reach and inside of the limits."""

    body: str
    camera: str
    reached: float
    bins: int
    samples: int
    p: float
    p_without: float
    metres: float
    outside: float
    draws: float
    arms: float


class Fit(NamedTuple):
    """The result of a chi-square test: p, the number of bins, and the effective number of samples."""

    p: float
    bins: int
    samples: int


def main(*, arms: int = 200_000, seed: int = 0, json: Json = None) -> None:
    """Draw arms and weigh them.

    Parameters
    ----------
    arms
        How many are drawn for each camera, of bodies other than upper13 a fifth.
    seed
        Of the draws.
    """
    rows = [
        measured(name, kind, camera, arms if name == "upper13" else arms // 5, seed)
        for name in ("upper13", "human34", "example-robot-data:talos", "example-robot-data:g1")
        for kind, camera in cameras().items()
    ]
    columns = "body", "camera", "reached", "bins", "samples", "p", "p without volume", "off [m]", "outside"
    table = report.table("arms drawn from an image", *columns, "draws/s", "arms/s")
    for r in rows:
        name, fits = r.body.split(":")[-1], (f"{r.p:.3f}", f"{r.p_without:.1e}")
        rates = f"{r.draws:,.0f}", f"{r.arms:,.0f}"
        exact = f"{r.metres:.0e}", f"{r.outside:.0e}"
        table.add_row(name, r.camera, f"{r.reached:.0%}", str(r.bins), str(r.samples), *fits, *exact, *rates)
    report.console().print(table)
    save(json, {"measure": "limb_ik", "rows": [asdict(r) for r in rows]})


def cameras() -> dict[str, Camera]:
    """A camera in front of a person facing it, 3 m away, and at the same scale without perspective."""
    guessed = guessed_camera("k", SIZE)
    R = guessed.R_camera_world @ np.diag([-1.0, -1.0, 1.0])
    near = replace(guessed, R_camera_world=R, t_camera_world=-R @ np.array([3.0, 0.0, 0.3]))
    K = near.K.copy()
    K[[0, 1], [0, 1]] /= 3.0
    return {"perspective": near, "parallel": replace(near, K=K, parallel=True)}


def end_of(body: Body) -> tuple[TwoSegmentLimb, int, np.ndarray]:
    """The left arm, and its end: the joint and the place (3,) [m] in its frame."""
    anatomy = anatomy_of(body)
    names = [body.landmark_names[int(limb.landmarks[2])] for limb in anatomy.limbs]
    number = names.index("left_wrist")
    if body.subject.flesh:
        features = skin_features(body, anatomy)
        hand = int(features.ends(number)[-1])
        return anatomy.limbs[number], int(features.joint[hand]), features.local[hand]
    wrist = int(anatomy.limbs[number].landmarks[2])
    return anatomy.limbs[number], int(body.landmark_joint[wrist]), body.landmark_local[wrist]


def measured(name: str, kind: str, camera: Camera, count: int, seed: int) -> Row:
    """Draw, weigh and time."""
    body = Body(load_subject(name))
    limb, joint, local = end_of(body)
    ik = LimbIK.of(body, limb, joint, local)
    trunks = body.placed(np.tile(body.neutral, (count, 1)))
    shoulder = camera.project(body.landmarks(body.at(body.neutral))[int(limb.landmarks[0])])
    scale = camera.K[0, 0] / (1.0 if camera.parallel else 3.0) * ik.far
    proposal = ImageProposal(ik, camera, gaussian(("hand",), shoulder[None], (0.7 * scale) ** 2 * np.eye(2)))
    proposal.sample(np.random.default_rng(seed), trunks.of(slice(0, 100)))  # compiled
    rng = np.random.default_rng(seed)
    began = time.process_time()
    arms = proposal.sample(rng, trunks)
    seconds = time.process_time() - began
    pixels = proposal.seen.sample(np.random.default_rng(seed), count)[0][:, 0]  # as they were drawn
    q = np.tile(body.neutral, (count, 1))
    q[:, ik.entries] = arms.angles
    ends = points_of_each(body.placed(q[arms.ok]), np.array([joint]), local[None])[:, 0]
    origins, ways = camera.rays(pixels[arms.ok])
    off = np.linalg.norm(np.cross(ends - origins, ways), axis=1).max()
    outside = np.maximum(ik.low + ik.rest - arms.angles, arms.angles - ik.high - ik.rest)[arms.ok].max()
    density = ik.forward(arms.angles)[1].log_density
    without = arms.log_density - np.where(arms.ok, density, 0.0)
    fit, wrong = (p_value(proposal, arms, dense, body, rng) for dense in (arms.log_density, without))
    return Row(
        name, kind, float(arms.ok.mean()), fit.bins, fit.samples, fit.p, wrong.p, float(off), max(float(outside), 0.0),
        count / seconds, int(arms.ok.sum()) / seconds,
    )  # fmt: skip


def p_value(proposal: ImageProposal, arms: Arms, log_density: np.ndarray, body: Body, rng: np.random.Generator) -> Fit:
    """That samples weighed by one over their density are spread as an even draw of the angles is.

    Both only where the proposal's density is not below a hundredth of its largest, so that weights are bounded. Two
    histograms, of weights and of counts, are one but for a factor: variances are sums of squared weights and counts.
    """
    ik = proposal.ik
    count = len(arms.angles)
    even = rng.uniform(ik.low, ik.high, (count, len(ik.rest))) + ik.rest
    of_even = proposal.log_density(even, body.placed(np.tile(body.neutral, (count, 1))))
    least = np.max(arms.log_density) - np.log(BOUND)
    good = arms.log_density > least
    weight = np.exp(log_density[good].min() - log_density[good])
    codes, size = _bin(ik, arms.angles[good]), BINS ** len(ik.rest)
    sums, squares = (np.bincount(codes, w, minlength=size) for w in (weight, weight**2))
    counts = np.bincount(_bin(ik, even[of_even > least]), minlength=size).astype(float)
    some = (counts >= FEWEST) & (sums**2 >= FEWEST * squares)
    if some.sum() < 2:
        return Fit(np.nan, int(some.sum()), 0)  # too few arms to measure
    sums, squares, counts = sums[some], squares[some], counts[some]
    ratio = sums.sum() / counts.sum()
    for _ in range(5):
        variance = squares + ratio**2 * counts
        ratio = np.sum(sums * counts / variance) / np.sum(counts**2 / variance)
    statistic = np.sum((sums - ratio * counts) ** 2 / variance)
    return Fit(float(chi2.sf(statistic, len(sums) - 1)), len(sums), int(sums.sum() ** 2 / squares.sum()))


def _bin(ik: LimbIK, angles: np.ndarray) -> np.ndarray:
    level = (angles - ik.rest - ik.low) / (ik.high - ik.low)
    return np.clip((BINS * level).astype(np.int64), 0, BINS - 1) @ BINS ** np.arange(len(ik.rest))
