"""Arms drawn from an image by inverse kinematics: how many a second, how exactly they meet it, what their weights are.

    python -m benchmarks.limb_ik [--arms 200000] [--json FILE]

Taycher et al. 2004, section 4. An arm of upper13, its hand's middle drawn over all that it can reach in the image (a
wide normal density), in perspective and by parallel projection. Samples weighed by one over their density are beside an
even draw of angles, by chi-square over bins of all four angles. Bars: p > 0.01, 1e-9 m, no limit left, 50,000 a second.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.stats import chi2

from benchmarks.common import Json, save, start
from estimator.cameras.camera import Camera, guessed_camera
from estimator.inference.chains.feature_density import gaussian
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import skin_features
from estimator.search.proposals.limb_ik import Arms, ImageProposal, LimbIK
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

SIZE = 640, 480
BINS = 3  # of each angle
FEWEST = 60  # even draws in a bin that counts


@dataclass(frozen=True)
class Row:
    """One camera. reached: share of the draws that an arm can reach. p, p_without: of weights with and without the
    volume. metres: largest distance of a hand, as Pinocchio places it, from where it was asked for. outside: largest
    excess over a limit [rad]. rate: draws a second, density included; `reached` of them are arms."""

    camera: str
    reached: float
    p: float
    p_without: float
    metres: float
    outside: float
    rate: float


def main(*, arms: int = 200_000, seed: int = 0, json: Json = None) -> None:
    """Draw arms and weigh them.

    Parameters
    ----------
    arms
        How many are drawn for each camera.
    seed
        Of the draws.
    """
    body = Body(load_subject("upper13"))
    rows = [measured(body, camera, name, arms, seed) for name, camera in cameras().items()]
    table = report.table(
        "arms drawn from an image", "camera", "reached", "p", "p without volume", "off [m]", "outside", "draws/s"
    )
    for r in rows:
        table.add_row(
            r.camera, f"{r.reached:.0%}", f"{r.p:.3f}", f"{r.p_without:.1e}", f"{r.metres:.0e}", f"{r.outside:.0e}",
            f"{r.rate:,.0f}",
        )  # fmt: skip
    report.console().print(table)
    save(json, {"measure": "limb_ik", "rows": [asdict(r) for r in rows]})


def cameras() -> dict[str, Camera]:
    """In front of a person who looks at it, 3 m away, and at the same scale without perspective."""
    guessed = guessed_camera("k", SIZE)
    R = guessed.R_camera_world @ np.diag([-1.0, -1.0, 1.0])
    near = replace(guessed, R_camera_world=R, t_camera_world=-R @ np.array([3.0, 0.0, 0.3]))
    K = near.K.copy()
    K[[0, 1], [0, 1]] /= 3.0
    return {"perspective": near, "parallel": replace(near, K=K, parallel=True)}


def measured(body: Body, camera: Camera, name: str, count: int, seed: int) -> Row:
    """Draw, weigh and time."""
    anatomy = anatomy_of(body)
    features = skin_features(body, anatomy)
    limb = anatomy.limbs[0]
    hand = int(features.ends(0)[-1])
    ik = LimbIK.of(body, limb, int(features.joint[hand]), features.local[hand])
    trunks = body.placed(np.tile(body.neutral, (count, 1)))
    shoulder = camera.project(body.landmarks(body.at(body.neutral))[int(limb.landmarks[0])])
    scale = camera.K[0, 0] / (1.0 if name == "parallel" else 3.0) * ik.far
    proposal = ImageProposal(ik, camera, gaussian(("hand",), shoulder[None], (0.7 * scale) ** 2 * np.eye(2)))
    rng = np.random.default_rng(seed)
    proposal.drawn(rng, trunks.of(slice(0, 100)))  # compiled
    began = time.process_time()
    arms = proposal.drawn(rng, trunks)
    seconds = time.process_time() - began
    off = _off(ik, body, rng)
    outside = np.maximum(ik.low + ik.rest - arms.angles, arms.angles - ik.high - ik.rest)[arms.ok].max()
    _, looked = ik.looked_at(arms.angles)
    without = np.where(arms.ok, arms.log_density, 0.0) - np.where(looked.ok, looked.log_density, 0.0)
    return Row(
        name, float(arms.ok.mean()), p_value(proposal, arms, arms.log_density, body, rng),
        p_value(proposal, arms, without, body, rng), off, max(float(outside), 0.0),
        count / seconds,
    )  # fmt: skip


def _off(ik: LimbIK, body: Body, rng: np.random.Generator) -> float:
    """Largest distance [m] of a hand, by Pinocchio, from a place that it can reach, with any swivel."""
    count = 2000
    ends, _ = ik.looked_at(rng.uniform(ik.low, ik.high, (count, len(ik.rest))) + ik.rest)
    arms = ik.solved(ends, 2.0 * np.pi * rng.random(count), rng.random(count))
    q = np.tile(body.neutral, (count, 1))
    q[:, ik.entries] = arms.angles
    features = skin_features(body, anatomy_of(body))
    hands = features.points(body.placed(q))[:, int(features.ends(0)[-1])]
    M = body.placed(body.neutral[None]).placements[0, ik.parent]
    asked = ends @ M[:9].reshape(3, 3) + M[9:]
    return float(np.linalg.norm(hands - asked, axis=1)[arms.ok].max())


def p_value(
    proposal: ImageProposal, arms: Arms, log_density: np.ndarray, body: Body, rng: np.random.Generator
) -> float:
    """That samples kept in proportion to one over their density are spread as an even draw of the angles is.

    Both only where the proposal's density is not below a thousandth of its largest, so that weights are bounded.
    """
    ik = proposal.ik
    count = len(arms.angles)
    even = rng.uniform(ik.low, ik.high, (count, len(ik.rest))) + ik.rest
    of_even = proposal.log_density(even, body.placed(np.tile(body.neutral, (count, 1))))
    least = np.max(arms.log_density) - np.log(1000.0)
    good = arms.ok & (arms.log_density > least)
    log_weight = -log_density[good]
    kept = arms.angles[good][rng.random(good.sum()) < np.exp(log_weight - log_weight.max())]
    codes = [_bin(ik, a) for a in (kept, even[of_even > least])]
    counts = [np.bincount(c, minlength=BINS ** len(ik.rest)).astype(float) for c in codes]
    some = counts[1] >= FEWEST
    ratio = counts[0][some].sum() / counts[1][some].sum()
    # both draws have noise: the variance of kept - ratio even is expected (1 + ratio)
    expected = (counts[0][some] + counts[1][some]) * ratio / (1.0 + ratio)
    statistic = np.sum((counts[0][some] - ratio * counts[1][some]) ** 2 / (expected * (1.0 + ratio)))
    return float(chi2.sf(statistic, some.sum() - 1))


def _bin(ik: LimbIK, angles: np.ndarray) -> np.ndarray:
    level = (angles - ik.rest - ik.low) / (ik.high - ik.low)
    return np.clip((BINS * level).astype(np.int64), 0, BINS - 1) @ BINS ** np.arange(len(ik.rest))


if __name__ == "__main__":
    start(main)
