"""Draws from products of mixtures: exactly, by Gibbs sampling, or by importance with a known density."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.inference.annealing import annealing_power, effective_count, normalised, systematic
from estimator.inference.beliefs.labels import Stacked
from estimator.inference.beliefs.mixture import Density, KernelMixture, mixture_of
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

LogLikelihood = Callable[[np.ndarray], np.ndarray]
METHODS = ("importance", "gibbs", "exact")
_CENTRES = 64  # kernels of a round's proposals at most
_ALIVE = 0.1  # share of the candidates that a round's proposals use, at least
_HALVINGS = 10  # a thousandth of the sought power is accurate enough
_WIDER = 1.5  # covariance of a round's proposals over that of the products that they are made of


@dataclass(frozen=True)
class ProductSettings(CheckedSettings):
    """Settings of the sampling from products of mixtures.

    method: "importance" weights candidates from every mixture, from a proposal if there is any, and from normal
    densities about the best of those; "gibbs" draws which kernels go together, one mixture after the other (Sudderth et
    al. 2003); "exact" goes through all combinations of kernels, and refuses where there are more than `exact_below`.
    candidates: of "importance", at least; per_draw: number of them for each requested draw. rounds: how many times it
    draws about the best. sweeps: of "gibbs".
    exact_below: number of combinations that are enumerated by any method; there "exact" stops.
    image_weighted: candidates of "importance" are weighted by the node's likelihood, too, and drawn about where that is
    high: the samples of the paper are drawn by the messages alone, and where the likelihood is sharp few of them count.
    A product of which all kernels are of R^n is drawn from exactly by "exact"; rotations are treated to first order by
    "gibbs" and "exact", and backgrounds as kernels. "importance" weights by the exact densities.
    """

    method: str = setting("importance", one_of=METHODS)
    candidates: int = setting(300, at_least=1)
    per_draw: float = setting(5.0, at_least=0.0)
    rounds: int = setting(2, at_least=0)
    sweeps: int = setting(5, at_least=0)
    exact_below: int = setting(0, at_least=0)
    image_weighted: bool = setting(True)

    def weighs(self, log_likelihood: LogLikelihood | None) -> bool:
        """Whether candidates are weighted by a likelihood."""
        return self.image_weighted and self.method == "importance" and log_likelihood is not None


@dataclass(frozen=True)
class Candidates:
    """Points (P, size) of a known density, log_density (P,), and the logarithms of each of D mixtures there,
    log_factors (D, P). log_phi (P,): of the likelihood, 0 where it is not used."""

    points: np.ndarray
    log_density: np.ndarray
    log_factors: np.ndarray
    log_phi: np.ndarray

    def weights(self, target: Sequence[int]) -> tuple[np.ndarray, bool, bool]:
        """Weights (P,) of the product of some of the mixtures and the likelihood; whether the mixtures have common
        ground, and whether the likelihood counts: it is left out where it leaves none, and without common ground all
        weights are alike."""
        plain = self.log_factors[list(target)].sum(axis=0) - self.log_density
        seen = plain + self.log_phi
        if np.any(seen > -np.inf):
            return normalised(seen)[0], True, True
        if np.any(plain > -np.inf):
            return normalised(plain)[0], True, False
        return np.full(len(self.points), 1.0 / len(self.points)), False, False


@dataclass(frozen=True)
class ProductSamples:
    """Points (N, size) of a product. log_factors (D, N): all mixtures' densities there, None where they were not
    needed.
    overlap: false where the mixtures have no common ground, and the points are of their mean instead. image_weighted:
    whether they were drawn in proportion to the likelihood, too."""

    points: np.ndarray
    log_factors: np.ndarray | None
    overlap: bool = True
    image_weighted: bool = False


def draw_products(
    rng: np.random.Generator,
    factors: Sequence[KernelMixture],
    targets: Sequence[Sequence[int]],
    counts: Sequence[int],
    settings: ProductSettings,
    proposal: Density | None = None,
    log_likelihood: LogLikelihood | None = None,
) -> list[ProductSamples]:
    """Draws from products of some of several mixtures, for each target: the indices of its mixtures, at least one.

    counts: how many, of each. proposal: a further source of candidates. log_likelihood: a further weight of theirs,
    depending on the settings. Both are for "importance".
    """
    pool = None
    draws = []
    image_weighted = settings.weighs(log_likelihood)
    for target, count in zip(targets, counts, strict=True):
        simple = len(target) == 1 or _combinations(factors, target) <= settings.exact_below
        if (simple and not image_weighted) or settings.method != "importance":
            draws.append(ProductSamples(_by_labels(rng, [factors[i] for i in target], count, settings), None))
            continue
        if pool is None:
            enough = max(settings.candidates, int(settings.per_draw * sum(counts)))
            looks = log_likelihood if image_weighted else None
            pool = candidates(rng, factors, targets, enough, settings.rounds, proposal, looks)
        weights, overlap, seen = pool.weights(target)
        chosen = rng.permutation(systematic(rng, weights, count))
        draws.append(ProductSamples(pool.points[chosen], pool.log_factors[:, chosen], overlap, image_weighted and seen))
    return draws


def _combinations(factors: Sequence[KernelMixture], target: Sequence[int]) -> int:
    return math.prod(len(factors[i]) + (factors[i].background is not None) for i in target)


def _by_labels(
    rng: np.random.Generator, factors: Sequence[KernelMixture], count: int, settings: ProductSettings
) -> np.ndarray:
    """Points (count, size) of the product of all factors, by which kernels go together."""
    if len(factors) == 1:
        return factors[0].sample(rng, count)
    combinations = _combinations(factors, range(len(factors)))
    stacked = Stacked.of(factors)
    if settings.method == "gibbs" and combinations > settings.exact_below:
        labels = stacked.gibbs(rng, count, settings.sweeps)
        mean, covariance, _ = stacked.products(labels, np.ones(labels.shape, dtype=bool))
    else:
        if combinations > max(settings.exact_below, 1):
            problem = f"has {combinations} combinations of kernels, exact_below is {settings.exact_below}"
            raise InputError("an exact product", problem, remedy='method = "importance" or "gibbs", or a higher limit')
        whole = exact_product(stacked)
        return whole.sample(rng, count)
    return mixture_of(stacked.space, mean, covariance).sample(rng, count)


def exact_product(stacked: Stacked) -> KernelMixture:
    """The product of mixtures as one, of all combinations of their kernels; made to integrate to 1."""
    sizes = np.diff(stacked.start)
    labels = np.stack(np.unravel_index(np.arange(math.prod(sizes)), tuple(sizes)), axis=1) + stacked.start[:-1]
    mean, covariance, log_weight = stacked.products(labels, np.ones(labels.shape, dtype=bool))
    return mixture_of(stacked.space, mean, covariance, normalised(log_weight)[0])


def candidates(
    rng: np.random.Generator,
    factors: Sequence[KernelMixture],
    targets: Sequence[Sequence[int]],
    count: int,
    rounds: int,
    proposal: Density | None = None,
    log_likelihood: LogLikelihood | None = None,
) -> Candidates:
    """About `count` points for products of some of several mixtures, and of the likelihood if it is given, with the
    density that they were drawn from in all.

    First points come from all mixtures and the proposal evenly. Each round takes the best of all for the targets, draws
    which kernel of every mixture explains each, and adds points from the normal densities that these make together.
    Wherever a point is from, its density is that of all sources, each by the number of its points (balance heuristic,
    Veach and Guibas 1995; over rounds Cornuet et al. 2012).
    """
    sources: list[Density] = [*factors] if proposal is None else [*factors, proposal]
    share = count // (rounds + 1)
    each = [len(part) for part in np.array_split(np.arange(count - rounds * share), len(sources))]
    points = np.concatenate([source.sample(rng, c) for source, c in zip(sources, each, strict=True)])
    log_sources = np.stack([source.log_density(points) for source in sources])
    log_phi = likelihoods(log_likelihood, points)
    stacked = Stacked.of(factors) if rounds else None
    for _ in range(rounds):
        assert stacked is not None
        pool = Candidates(points, _balanced(log_sources, each), log_sources[: len(factors)], log_phi)
        about = _about_the_best(rng, pool, stacked, targets)
        more = about.sample(rng, share)
        both = np.concatenate([points, more])
        log_phi = np.concatenate([log_phi, likelihoods(log_likelihood, more)])
        log_more = np.stack([source.log_density(more) for source in sources])
        log_sources = np.concatenate([log_sources, log_more], axis=1)
        log_sources = np.concatenate([log_sources, about.log_density(both)[None]])
        sources, each, points = [*sources, about], [*each, share], both
    return Candidates(points, _balanced(log_sources, each), log_sources[: len(factors)], log_phi)


def likelihoods(log_likelihood: LogLikelihood | None, points: np.ndarray) -> np.ndarray:
    """Logarithms (N,) of a likelihood at points (N, size), 0 without one; values that are NaN or plus infinity count as
    none."""
    if log_likelihood is None or len(points) == 0:
        return np.zeros(len(points))
    values = np.asarray(log_likelihood(points), dtype=float)
    return np.where(values < np.inf, values, -np.inf)


def _balanced(log_sources: np.ndarray, each: Sequence[int]) -> np.ndarray:
    """Logarithm (P,) of the density of points from several sources, by that of each (S, P) and how many are of it."""
    with np.errstate(divide="ignore"):
        log_share = np.log(np.array(each) / sum(each))
    shares = log_sources + log_share[:, None]
    highest = shares.max(axis=0)
    density: np.ndarray = highest + np.log(np.exp(shares - highest).sum(axis=0))
    return density


def _about_the_best(
    rng: np.random.Generator, pool: Candidates, stacked: Stacked, targets: Sequence[Sequence[int]]
) -> KernelMixture:
    """Normal densities, each the product of kernels that explain a point of high weight."""
    per_target = max(1, _CENTRES // len(targets))
    chosen, used = [], np.zeros((per_target * len(targets), len(pool.log_factors)), dtype=bool)
    for i, target in enumerate(targets):
        weights = pool.weights(target)[0]
        chosen.append(systematic(rng, _flattened(weights), per_target))
        used[i * per_target : (i + 1) * per_target, list(target)] = True
    labels = stacked.labels_at(rng, pool.points[np.concatenate(chosen)])
    mean, covariance, _ = stacked.products(labels, used)
    return mixture_of(stacked.space, mean, _WIDER * covariance)


def _flattened(weights: np.ndarray) -> np.ndarray:
    """Weights (P,) to a power of 1 at most with which a share of them counts: a few would be all that is drawn
    about."""
    if effective_count(weights) >= _ALIVE * len(weights):
        return weights
    energies = -np.log(np.maximum(weights, 1e-300))
    return normalised(-min(1.0, annealing_power(energies, _ALIVE, _HALVINGS)) * energies)[0]
