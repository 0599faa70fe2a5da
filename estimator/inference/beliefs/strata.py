"""The samples that messages and beliefs of one node are made of (PAMPAS, Isard 2003; Sigal et al. 2004, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.inference.annealing import normalised
from estimator.inference.beliefs.graph import APART, OK, UNEXPLAINED, Node
from estimator.inference.beliefs.mixture import KernelMixture
from estimator.inference.beliefs.products import ProductSamples, ProductSettings, draw_products, likelihoods


class Split(NamedTuple):
    """Numbers of samples by stratum, as `Shares`."""

    belief: int
    incoming: int
    proposal: int


class Shares(NamedTuple):
    """Shares of the samples: lambda_B, from the product of all incoming messages; lambda_I, from that of all but the
    message from where it goes to; lambda_S, from the importance function Q. Their sum is 1."""

    belief: float
    incoming: float
    proposal: float

    @staticmethod
    def of(proposal: float, belief: float = 0.5) -> Shares:
        """lambda_S, and lambda_B as a share of what that leaves."""
        return Shares(belief * (1.0 - proposal), (1.0 - belief) * (1.0 - proposal), proposal)

    def counts(self, total: int, possible: tuple[bool, bool, bool]) -> Split:
        """Number of samples of `total` in each stratum; those of impossible strata are shared by the possible ones."""
        share = np.where(possible, self, 0.0)
        if share.sum() <= 0.0:
            share = np.array(possible, dtype=float)
        ends = np.round(np.cumsum(share) / share.sum() * total).astype(int)
        first, second, third = np.diff(ends, prepend=0)
        return Split(int(first), int(second), int(third))


class Stratum(NamedTuple):
    """Points (N, size) of a source, and their logarithmic weights (N,) without and with the likelihood, plain and seen,
    both up to a constant of the stratum. overlap: false where the messages had no common ground."""

    points: np.ndarray
    plain: np.ndarray
    seen: np.ndarray
    overlap: bool = True


def belief_weight(log_phi: np.ndarray, log_factors: np.ndarray, to: int | None) -> np.ndarray:
    """Stratum B: phi / m_ji, (N,), of a sample from the product of all messages, log_factors (D, N); phi for a belief,
    where `to` is None."""
    return log_phi if to is None else _over(log_phi, log_factors[to])


def incoming_weight(log_phi: np.ndarray) -> np.ndarray:
    """Stratum I: phi, (N,), of a sample from the product of all messages but m_ji."""
    return log_phi


def proposal_weight(
    log_phi: np.ndarray, log_factors: np.ndarray, to: int | None, log_proposal: np.ndarray
) -> np.ndarray:
    """Stratum S: phi prod_k m_ki / Q, (N,), k not j, of a sample from Q; all k for a belief, where `to` is None."""
    others = [k for k in range(len(log_factors)) if k != to]
    return _over(log_phi + log_factors[others].sum(axis=0), log_proposal)


def _over(logarithm: np.ndarray, divisor: np.ndarray) -> np.ndarray:
    """Their difference; minus infinity where the divisor, from which a sample was drawn, is minus infinity."""
    with np.errstate(invalid="ignore"):
        return np.where(divisor > -np.inf, logarithm - divisor, -np.inf)


def weighted(strata: Sequence[Stratum]) -> tuple[np.ndarray, np.ndarray, str]:
    """Points (N, size) of all strata, their logarithmic weights (N,), whose exponentials sum to 1, and the status.

    Weights are normalised within each stratum and times its share of the samples. A stratum in which no sample has any
    weight leaves its share to the others. Where none has, the likelihood is left out, and where that does not help, all
    samples count alike.
    """
    strata = [s for s in strata if len(s.points)]
    ways = [
        (OK, [s.seen for s in strata]),
        (UNEXPLAINED, [s.plain for s in strata]),
        (APART, [np.zeros(len(s.points)) for s in strata]),
    ]
    status, weights = next(way for way in ways if any(np.any(w > -np.inf) for w in way[1]))
    alive = [i for i, w in enumerate(weights) if np.any(w > -np.inf)]
    total = sum(len(strata[i].points) for i in alive)
    logarithms = []
    for i in alive:
        share, _ = normalised(weights[i])
        with np.errstate(divide="ignore"):
            logarithms.append(np.log(share) + np.log(len(share) / total))
    if not all(s.overlap for s in strata):
        status = APART
    return np.concatenate([strata[i].points for i in alive]), np.concatenate(logarithms), status


class StrataTarget(NamedTuple):
    """The purpose of samples. to: the incoming message from their receiver; None for a belief, and where there is none.
    samples: how many."""

    to: int | None
    samples: int


class Weighted(NamedTuple):
    """Samples (N, size), logarithms (N,) of weights that sum to 1, and a status, see `Belief`."""

    points: np.ndarray
    log_weight: np.ndarray
    status: str


def node_samples(
    rng: np.random.Generator,
    node: Node,
    factors: Sequence[KernelMixture],
    targets: Sequence[StrataTarget],
    shares: Shares,
    settings: ProductSettings,
) -> list[Weighted]:
    """Samples of a node's outgoing messages, or of its belief; all incoming messages are evaluated once for all of
    them.

    factors: the incoming messages; without any there has to be a proposal. What has no support is in the status.
    """
    everything = tuple(range(len(factors)))
    # where candidates are weighted by the likelihood Q is one of their sources, and each counts by all of its weight; a
    # stratum of its own would keep its share however unlikely it is
    proposing = node.proposal is not None and not (factors and settings.weighs(node.log_likelihood))
    rests = [() if t.to is None else tuple(k for k in everything if k != t.to) for t in targets]
    splits = [
        shares.counts(t.samples, (bool(factors), bool(rest), proposing)) for t, rest in zip(targets, rests, strict=True)
    ]
    wanted = [
        (everything, max(s.belief for s in splits)),
        *((r, s.incoming) for r, s in zip(rests, splits, strict=True)),
    ]
    draws = _draws(rng, factors, wanted, settings, node)
    proposed, log_proposal = np.empty((0, draws[0].points.shape[1])), np.empty(0)
    if proposing:
        assert node.proposal is not None
        proposed = node.proposal.sample(rng, max(s.proposal for s in splits))
        log_proposal = node.proposal.log_density(proposed)
    parts = [*(d.points for d in draws), proposed]
    every_phi = np.split(
        likelihoods(node.log_likelihood, np.concatenate(parts)), np.cumsum([len(p) for p in parts])[:-1]
    )
    # what was drawn in proportion to the likelihood has it in its density already
    common, (phi, *own_phi, proposed_phi) = (
        draws[0],
        [
            np.zeros(len(p)) if d is not None and d.image_weighted else p
            for p, d in zip(every_phi, [*draws, None], strict=True)
        ],
    )
    common_factors = _evaluated(factors, common.points) if common.log_factors is None else common.log_factors
    proposed_factors = _evaluated(factors, proposed)
    samples = []
    for target, split, own, seen in zip(targets, splits, draws[1:], own_phi, strict=True):
        b, s = slice(split.belief), slice(split.proposal)
        flat = np.zeros(len(phi)), np.zeros(len(proposed))
        strata = [
            Stratum(
                common.points[b],
                belief_weight(flat[0][b], common_factors[:, b], target.to),
                belief_weight(phi[b], common_factors[:, b], target.to),
                common.overlap,
            ),
            Stratum(own.points, np.zeros(len(seen)), incoming_weight(seen), own.overlap),
            Stratum(
                proposed[s],
                proposal_weight(flat[1][s], proposed_factors[:, s], target.to, log_proposal[s]),
                proposal_weight(proposed_phi[s], proposed_factors[:, s], target.to, log_proposal[s]),
            ),
        ]
        samples.append(Weighted(*weighted(strata)))
    return samples


def _draws(
    rng: np.random.Generator,
    factors: Sequence[KernelMixture],
    wanted: Sequence[tuple[Sequence[int], int]],
    settings: ProductSettings,
    node: Node,
) -> list[ProductSamples]:
    """Draws of each requested target, in the requested number; empty for others."""
    asked = [(target, count) for target, count in wanted if count]
    targets, counts = [a[0] for a in asked], [a[1] for a in asked]
    draws = iter(draw_products(rng, factors, targets, counts, settings, node.proposal, node.log_likelihood))
    size = node.proposal.space.size if node.proposal is not None else factors[0].space.size
    nothing = ProductSamples(np.empty((0, size)), np.empty((len(factors), 0)))
    return [next(draws) if count else nothing for _, count in wanted]


def _evaluated(factors: Sequence[KernelMixture], points: np.ndarray) -> np.ndarray:
    """Logarithms (D, N) of all messages at points (N, size)."""
    if not factors or len(points) == 0:
        return np.zeros((len(factors), len(points)))
    return np.stack([factor.log_density(points) for factor in factors])
