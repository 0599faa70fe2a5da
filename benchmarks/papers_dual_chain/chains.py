"""Chains combined through a shared point, beside exact inference: two random walks, q = r = 0.25, o = 0.5.

    python -m benchmarks chains [--walks 400] [--particles 1000] [--json FILE]

Taycher, Fisher and Darrell 2004, section 3. Where the truth is one walk of variance q a frame, and the point r beside
it, both chains model the same thing: a product of experts is then narrower than either. Their certainty after 15
frames without an observation is counted over walks: the share of 90 % regions (of both coordinates) with the truth
inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.papers_dual_chain.chains_toy import (
    GRID,
    NOISE,
    Belief,
    Joint,
    ParticleWalk,
    Q,
    R,
    Walk,
    WeightedStates,
    on_grid,
    seen,
)
from benchmarks.support.common import Json, save
from estimator.inference.annealing import effective_count
from estimator.inference.chains.exchange import APART, GATED, ONE_WAY, PRINTED, step
from kinemode.terminal import report

SEEN_FRAMES, DARK_FRAMES = 10, 15
INSIDE = 2.0 * np.log(10.0)  # squared radius, in standard deviations, of the 90 % region in two dimensions


@dataclass(frozen=True)
class Check:
    """A figure beside its bar, both as text."""

    what: str
    figure: str
    bar: str


def main(*, walks: int = 400, particles: int = 1000, seed: int = 0, json: Json = None) -> None:
    """Compare with exact inference, and count how often the truth is in the chains' regions.

    Parameters
    ----------
    walks
        The clips whose last place is searched for after frames without detections.
    particles
        Of the chain of samples.
    seed
        Of walks and particles.
    """
    checks = [*exactness(seed), *samples(seed, particles)]
    shares = coverage(walks, seed)
    bars = {GATED: "85 to 95 %", "eq. 4, exact": "", PRINTED: ""}
    label = f"inside after {DARK_FRAMES} dark frames"
    checks += [Check(f"{label}, {name}", f"{share:.1%}", bars.get(name, "")) for name, share in shares.items()]
    table = report.table("chains combined", "", "figure", "bar")
    for check in checks:
        table.add_row(check.what, check.figure, check.bar)
    report.console().print(table)
    save(json, {"measure": "chains", "checks": [vars(c) for c in checks], "inside": shares})


def exactness(seed: int, frames: int = 6) -> list[Check]:
    """Messages against sums on a grid (eqs. 3 and 5), eq. 4 in closed form, and Kalman's filter."""
    rng = np.random.default_rng(seed)
    chains, states = [Walk(), Walk()], [Belief(np.zeros(2), 1.0), Belief(np.zeros(2), 2.0)]
    grids = [_normal(0.0, 1.0), _normal(0.0, 2.0)]
    joint = Joint(np.zeros(2), np.diag([1.0, 2.0]))
    alone, plain = [Belief(np.zeros(2), 1.0), Belief(np.zeros(2), 1.0)], (0.0, 1.0)
    off, gap, kalman = [], [], 0.0
    for frame in range(frames):
        point = rng.normal(size=2) if frame != 3 else None
        first = None if point is None else float(point[0])
        states, _ = step(chains, states, seen(point), 1.0, PRINTED)
        grids = list(on_grid(grids[0], grids[1], first))
        joint = joint.stepped(first)
        off.append(max(_distance(s, *_moments(g)) for s, g in zip(states, grids, strict=True)))
        gap.append(max(_distance(s, joint.mean[k], joint.covariance[k, k]) for k, s in enumerate(states)))
        alone, _ = step([Walk(), Walk(informed=False)], alone, seen(point), 1.0, PRINTED)
        plain = _kalman(*plain, first)
        kalman = max(kalman, _distance(alone[0], *plain))
    return [
        Check("first frame: from exact inference, on the grid", f"{off[0]:.1e}", "1e-6"),
        Check("first frame: from eq. 4 in closed form", f"{gap[0]:.1e}", "1e-6"),
        Check(f"{frames - 1} later frames: from eq. 5 on the grid", f"{max(off[1:]):.1e}", "1e-6"),
        Check("the same: from eq. 4, exact (largest gap of mean or variance)", f"{max(gap[1:]):.3f}", ""),
        Check("beside an uninformative chain: from the Kalman filter", f"{kalman:.1e}", "1e-9"),
        Check("what is impossible in one chain: density in the other", f"{impossible():.1e}", "0"),
    ]


def impossible() -> float:
    """Density of the second chain where the first's is zero: the first's walk is a box on the grid."""
    box = np.where(np.abs(GRID) < 1.0, 0.5, 0.0)
    _, second = on_grid(box, _normal(0.0, 4.0), 0.5, q=1e-9, r=1e-9)
    return float(second[np.abs(GRID) > 1.5].max())


def samples(seed: int, particles: int, repeats: int = 200) -> list[Check]:
    """The number of standard errors between the mean and variance of samples and the closed form, over
    repeats."""
    truth: list[Belief] = [Belief(np.zeros(2), 1.0), Belief(np.zeros(2), 1.0)]
    points = np.random.default_rng(seed).normal(size=(3, 2))
    for point in points:
        truth, _ = step([Walk(), Walk()], truth, seen(point), 1.0)
    mean, variance, counts = [], [], []
    for k in range(repeats):
        rng = np.random.default_rng([seed, k])
        states: list[Any] = [
            WeightedStates(rng.standard_normal((particles, 2)), np.full(particles, 1.0 / particles)),
            Belief(np.zeros(2), 1.0),
        ]
        chains: list[Any] = [ParticleWalk(rng), Walk()]
        for point in points:
            states, _ = step(chains, states, seen(point), 1.0)
        mean.append(states[0].mean)
        variance.append(states[0].variance)
        counts.append(effective_count(states[0].weights))
    return [
        Check(f"{particles} samples: mean, in standard errors of {repeats} runs", _errors(mean, truth[0].mean), "3"),
        Check("the same: variance", _errors(variance, np.full(2, truth[0].variance)), "3"),
        Check("the same: effective number", f"{np.mean(counts):.0f}", ""),
    ]


def coverage(walks: int, seed: int) -> dict[str, float]:
    """Share of walks whose last place is inside of the 90 % region, by exchange, and by eq. 4."""
    rng = np.random.default_rng(seed)
    inside: dict[str, list[bool]] = {k: [] for k in (GATED, PRINTED, ONE_WAY, APART, "eq. 4, exact")}
    for _ in range(walks):
        place = np.cumsum(np.sqrt(Q) * rng.standard_normal((SEEN_FRAMES + DARK_FRAMES, 2)), axis=0)
        points = place + np.sqrt(R + NOISE) * rng.standard_normal(place.shape)
        observed: Sequence[np.ndarray | None] = [*points[:SEEN_FRAMES], *[None] * DARK_FRAMES]
        for exchange in (GATED, PRINTED, ONE_WAY, APART):
            states = [Belief(np.zeros(2), 1e-6), Belief(np.zeros(2), 1e-6)]
            for point in observed:
                states, _ = step([Walk(), Walk()], states, seen(point), 1.0, exchange)
            inside[exchange].append(_inside(place[-1] - states[0].mean, states[0].variance))
        both = [Joint(np.zeros(2), 1e-6 * np.eye(2))] * 2
        for point in observed:
            both = [joint.stepped(None if point is None else float(point[k])) for k, joint in enumerate(both)]
        mean = np.array([joint.mean[0] for joint in both])
        inside["eq. 4, exact"].append(_inside(place[-1] - mean, float(both[0].covariance[0, 0])))
    return {name: float(np.mean(values)) for name, values in inside.items()}


def _inside(off: np.ndarray, variance: float) -> bool:
    return bool(off @ off / variance < INSIDE)


def _errors(values: Sequence[np.ndarray], truth: np.ndarray) -> str:
    off = np.mean(values, axis=0) - truth
    return f"{np.max(np.abs(off) / (np.std(values, axis=0) / np.sqrt(len(values)))):.1f}"


def _normal(mean: float, variance: float) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * np.square(GRID - mean) / variance) / np.sqrt(2.0 * np.pi * variance))


def _moments(density: np.ndarray) -> tuple[float, float]:
    share = density / density.sum()
    mean = float(share @ GRID)
    return mean, float(share @ np.square(GRID - mean))


def _distance(state: Belief, mean: float, variance: float) -> float:
    """The larger of how far a belief's first coordinate is off in mean and in variance."""
    return max(abs(float(state.mean[0]) - mean), abs(state.variance - variance))


def _kalman(mean: float, variance: float, observed: float | None) -> tuple[float, float]:
    """Kalman's filter of one walk, observed with R and NOISE."""
    variance += Q
    if observed is None:
        return mean, variance
    gain = variance / (variance + R + NOISE)
    return mean + gain * (observed - mean), (1.0 - gain) * variance
