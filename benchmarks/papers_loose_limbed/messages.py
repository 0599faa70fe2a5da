"""Products of messages: how near draws from them are to the truth, and what they cost.

    python -m benchmarks messages [--methods importance gibbs] [--candidates 1000000] [--json FILE]

In 1-D the truth is a quadrature, in 6-D a million weighted candidates with an effective number of over a thousand,
whose mean is compared with that of 200 draws. Bars: total variation 0.08, 3 mm and 1 degree, 150 ms a call on one core.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from benchmarks.support.common import Several, check_known, save, tell
from estimator.inference.annealing import effective_count
from estimator.inference.beliefs.mixture import KernelMixture, mixture_of
from estimator.inference.beliefs.potential import potential_of
from estimator.inference.beliefs.products import METHODS, ProductSettings, candidates, draw_products
from estimator.inference.beliefs.space import PLACEMENTS, Space
from estimator.inference.clusters import mean_and_covariance

DRAWS = 200
CASES = ((2, 600), (3, 300), (5, 181), (7, 100), (7, 600))
"""Mixtures and kernels of each."""
LINE = Space(1, False)
BINS = 50  # of equal probability
SPREAD, APART = (0.025, 0.1), (0.08, 0.3)  # of a message's points; between messages that disagree [m, rad]
BAR_VARIATION, BAR_MM, BAR_DEG, BAR_MS = 0.08, 3.0, 1.0, 150.0


@dataclass(frozen=True)
class Row:
    """One way to draw from one product. variation: total, in 1-D. mm, deg: of the mean of a call's draws from the true
    mean, root mean square over calls; sampling: the same of as many independent true draws. ms: a call, median."""

    dims: int
    mixtures: int
    kernels: int
    agree: bool
    method: str
    variation: float | None
    mm: float | None
    deg: float | None
    sampling: tuple[float, float] | None
    ms: float


def main(
    methods: Annotated[tuple[str, ...], Several] = ("importance", "gibbs"),
    cases: Annotated[tuple[str, ...], Several] = (),
    candidates: int = 1_000_000,
    calls: int = 40,
    seed: int = 0,
    json: Path | None = None,
) -> None:
    """Draw from products and compare with the truth.

    Parameters
    ----------
    methods: ways to draw; gibbs with a number of sweeps is gibbs3, importance with a number of candidates
        for each draw importance10.
    cases: mixtures x kernels, as 5x181; all without.
    candidates: of the truth in 6-D.
    calls: of every way, of 200 draws each.
    seed: of the messages.
    json: file for the figures.
    """
    ways = {name: _settings(name) for name in methods}
    sizes = [tuple(int(part) for part in case.split("x")) for case in cases] or list(CASES)
    nanoseconds = _evaluation_ns(np.random.default_rng(seed))
    print(
        "evaluating a kernel at a point, 6-D: " + ", ".join(f"{what} {ns:.0f} ns" for what, ns in nanoseconds.items())
    )
    rows = []
    for mixtures, kernels in sizes:
        for agree in (True, False):
            rng = np.random.default_rng((seed, mixtures, kernels, agree))
            tell(f"{mixtures} x {kernels} kernels that {'agree' if agree else 'disagree'}")
            rows += _line_rows(rng, mixtures, kernels, agree, ways, calls)
            rows += _placement_rows(rng, mixtures, kernels, agree, ways, calls, candidates)
    _print(rows)
    save(json, {"evaluation_ns": nanoseconds, "rows": [asdict(row) for row in rows]})


def _settings(name: str) -> ProductSettings:
    method = name.rstrip("0123456789")
    check_known("--methods", [method], METHODS)
    number = int(name[len(method) :] or 0)
    settings = ProductSettings(method, exact_below=10**6 if method == "exact" else 0)
    if number:
        return replace(settings, sweeps=number) if method == "gibbs" else replace(settings, per_draw=number)
    return settings


def _line_rows(
    rng: np.random.Generator, count: int, kernels: int, agree: bool, ways: dict[str, ProductSettings], calls: int
) -> list[Row]:
    """In 1-D: histograms of the draws of all calls beside a quadrature."""
    factors = []
    for _ in range(count):
        centre = 0.0 if agree else APART[0] * rng.standard_normal()
        mean = centre + SPREAD[0] * rng.standard_normal((kernels, 1))
        mean[0], variance = 0.0, np.full((kernels, 1), 0.012**2)
        variance[0] = 1.0
        weight = rng.exponential(size=kernels)
        weight[0] = 0.01 * weight.sum()
        factors.append(mixture_of(LINE, mean, variance, weight))
    grid = np.linspace(-1.0, 1.0, 40_001)[:, None]
    log_density = sum(factor.log_density(grid) for factor in factors)
    cumulative = np.cumsum(np.exp(log_density - np.max(log_density)))
    cumulative /= cumulative[-1]
    rows = []
    for name, settings in ways.items():
        points, ms = _called(rng, factors, settings, calls)
        where = np.interp(points.reshape(-1), grid[:, 0], cumulative)
        share = np.bincount(np.minimum((where * BINS).astype(int), BINS - 1), minlength=BINS) / where.size
        variation = 0.5 * float(np.abs(share - 1.0 / BINS).sum())
        rows.append(Row(1, count, kernels, agree, name, variation, None, None, None, ms))
    return rows


def _placement_rows(
    rng: np.random.Generator,
    count: int,
    kernels: int,
    agree: bool,
    ways: dict[str, ProductSettings],
    calls: int,
    reference: int,
) -> list[Row]:
    """In 6-D: the mean of each call's draws beside that of very many weighted candidates."""
    factors = placement_messages(rng, count, kernels, agree)
    mean, covariance = _true_moments(rng, factors, reference)
    spread = np.sqrt([np.trace(covariance[:3, :3]) / DRAWS, np.trace(covariance[3:, 3:]) / DRAWS])
    sampling = (1e3 * float(spread[0]), math.degrees(spread[1]))
    rows = []
    for name, settings in ways.items():
        points, ms = _called(rng, factors, settings, calls)
        off = np.stack([PLACEMENTS.differences(mean, call).mean(axis=0) for call in points])
        mm = 1e3 * math.sqrt(np.mean(np.sum(off[:, :3] ** 2, axis=1)))
        deg = math.degrees(math.sqrt(np.mean(np.sum(off[:, 3:] ** 2, axis=1))))
        rows.append(Row(6, count, kernels, agree, name, None, mm, deg, sampling, ms))
    return rows


def placement_messages(rng: np.random.Generator, count: int, kernels: int, agree: bool) -> list[KernelMixture]:
    """Messages of a third as many points as kernels each, by potentials of three kernels and an outlier process."""
    scale = np.repeat(SPREAD, 3)
    here = np.array([0.3, -0.2, 1.0, 0.1, -0.5, 0.7, 0.5])
    here[3:] /= np.linalg.norm(here[3:])
    messages = []
    for _ in range(count):
        centre = here
        if not agree:
            away = rng.standard_normal(6)
            size = np.repeat([np.linalg.norm(away[:3]), np.linalg.norm(away[3:])], 3)
            centre = PLACEMENTS.moved(here, np.repeat(APART, 3) * away / size)[0]
        points = PLACEMENTS.moved(centre, scale * rng.standard_normal(((kernels - 1) // 3, 6)))
        relative = PLACEMENTS.moved(np.eye(7)[6], 0.25 * scale * rng.standard_normal((3, 6)))
        variance = np.square(np.array([0.01, 0.015, 0.02, 0.06, 0.1, 0.15]) * rng.uniform(0.7, 1.3, (3, 6)))
        outlier = mixture_of(PLACEMENTS, here[None], np.array([[1.0, 1.0, 1.0, 4.0, 4.0, 4.0]]))
        weight = rng.exponential(size=len(points))
        potential = potential_of(PLACEMENTS, relative, variance, outlier=outlier, share=0.01)
        messages.append(potential.message(points, np.log(weight / weight.sum())))
    return messages


def _true_moments(
    rng: np.random.Generator, factors: Sequence[KernelMixture], reference: int
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a product."""
    pool = candidates(rng, factors, [range(len(factors))], reference, rounds=4)
    weights = pool.weights(range(len(factors)))[0]
    tell(f"  truth: {reference} candidates, worth {effective_count(weights):.0f}")
    if effective_count(weights) < 1000.0:
        tell("  which is not enough: more --candidates")
    return mean_and_covariance(PLACEMENTS, pool.points, weights)


def _called(
    rng: np.random.Generator, factors: Sequence[KernelMixture], settings: ProductSettings, calls: int
) -> tuple[np.ndarray, float]:
    """Draws of every call (calls, DRAWS, size) and the median of their processor time [ms]."""
    target = [range(len(factors))]
    draw_products(rng, factors, target, [DRAWS], settings)  # compiled
    points, times = [], []
    for _ in range(calls):
        begin = time.process_time()
        points.append(draw_products(rng, factors, target, [DRAWS], settings)[0].points)
        times.append(time.process_time() - begin)
    return np.stack(points), 1e3 * float(np.median(times))


def _evaluation_ns(rng: np.random.Generator) -> dict[str, float]:
    """Nanoseconds to evaluate one kernel at one point: among points of the same message, and over a room."""
    message = placement_messages(rng, 1, 301, True)[0]
    room = PLACEMENTS.moved(message.mean[0], rng.standard_normal((2000, 6)))
    taken = {}
    for what, points in (("near", message.sample(rng, 2000)), ("far", room)):
        message.log_density(points)
        begin = time.process_time()
        for _ in range(5):
            message.log_density(points)
        taken[what] = (time.process_time() - begin) / (5 * len(points) * len(message)) * 1e9
    return taken


def _print(rows: Sequence[Row]) -> None:
    print(f"{'':6}{'messages':>12}  {'method':14}{'variation':>10}{'mm':>8}{'deg':>7}{'(sampling)':>14}{'ms':>8}")
    for r in rows:
        what = f"{r.dims}-D {'' if r.agree else 'apart'}"
        error = f"{r.variation:10.3f}{'':29}" if r.variation is not None else f"{'':10}{r.mm:8.2f}{r.deg:7.2f}"
        if r.sampling is not None:
            error += f"{r.sampling[0]:8.2f}{r.sampling[1]:6.2f}"
        print(f"{what:10}{r.mixtures:3} x {r.kernels:3}  {r.method:14}{error}{r.ms:8.1f}")
    for method in dict.fromkeys(r.method for r in rows):
        mine = [r for r in rows if r.method == method]
        met = [
            (r.variation or 0.0) <= BAR_VARIATION and (r.mm or 0.0) <= BAR_MM and (r.deg or 0.0) <= BAR_DEG
            and r.ms <= BAR_MS
            for r in mine
        ]  # fmt: skip
        bars = f"{BAR_VARIATION}, {BAR_MM:.0f} mm, {BAR_DEG:.0f} deg, {BAR_MS:.0f} ms"
        print(f"{method}: {sum(met)} of {len(met)} within {bars}")
