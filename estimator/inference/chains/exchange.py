"""One frame of several chains that estimate the same image: their messages to each other about its features.

Taycher, Fisher and Darrell 2004: eqs. 1 and 2, the product of experts; eq. 5, marginals of the frame before in place of
their joint; the four steps of section 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from estimator.inference.chains.evidence import Evidence
from estimator.inference.chains.feature_density import FeatureDensity, alike, kinds, product, uniform
from humanoid.support.errors import InputError

S = TypeVar("S")
P = TypeVar("P")
GATED, PRINTED, WHICH, ONE_WAY, APART = "gated", "printed", "which", "one-way", "apart"
EXCHANGES = (GATED, PRINTED, WHICH, ONE_WAY, APART)
MOST = 40  # kernels of a message


@dataclass(frozen=True, eq=False)
class Message:
    """mu_F->S, what a chain receives of the features.

    evidence: by which its states are weighted. guide: where the features may be by the predictions of all other chains;
    it guides proposals, and is not evidence.
    """

    evidence: FeatureDensity
    guide: FeatureDensity


class FeatureChain(Protocol[S, P]):
    """A hidden Markov chain that predicts image features. Equal random generators give equal states."""

    def predict(self, state: S, dt: float) -> P:
        """mu_St-1->St: the prediction `dt` seconds after a state, before the image is used (step 1)."""
        ...

    def features(self, prior: P) -> FeatureDensity:
        """mu_S->F: what it expects of the features (step 2); it is 1 over features that it does not predict."""
        ...

    def update(self, prior: P, message: Message) -> tuple[S, float]:
        """p(S | O) and the log-evidence of the message under the prior (step 4)."""
        ...


def messages(expected: Sequence[FeatureDensity], evidence: Evidence, exchange: str = GATED) -> list[Message]:
    """mu_F->Si for each of n >= 2 chains, from mu_Si->F of all of them and phi(O, F) (step 3).

    A chain never receives its own message: i receives phi(O, F) times the predictions of all others.

    exchange: "printed" is that and nothing else. Without detections the chains then keep confirming each other's
    predictions, and become sure of them. "gated": where a feature has no detection, the others' prediction of it is not
    evidence, only a guide; it still counts in the weight of an association. "which": it counts in that alone, and where
    there is a detection, the chain receives only the detection: two chains that know the past from the same images do
    not count it twice. "one-way": as gated, and only the first receives anything. "apart": none does.

    Raises
    ------
    InputError: a chain that has no feature in common with any other.
    """
    if exchange not in EXCHANGES:
        raise InputError("exchange", f"there is no {exchange!r}", remedy="one of " + ", ".join(EXCHANGES))
    _check_common(expected)
    names = tuple(dict.fromkeys(n for d in (evidence.density, *expected) for n in d.names))
    seen = evidence.density.over(names)
    received = []
    for i in range(len(expected)):
        listens = exchange in (GATED, PRINTED, WHICH) or (exchange == ONE_WAY and i == 0)
        others = [d for k, d in enumerate(expected) if k != i] if listens else []
        theirs = product(others, names, MOST)
        factor = seen.times(theirs)
        own = expected[i].over(names)
        whole = factor.reduced(MOST, expected=own)
        if exchange != PRINTED:
            gated = _gated(seen, theirs, factor, exchange == WHICH).reduced(MOST, expected=own)
        received.append(Message(whole if exchange == PRINTED else gated, whole))

    return received


def _gated(seen: FeatureDensity, theirs: FeatureDensity, factor: FeatureDensity, which: bool) -> FeatureDensity:
    """The product of the evidence with the others' predictions, of which only the weights of associations remain where
    there is no detection (and, if only `which` is sent, where there is one).

    What is left out is not 1, but as high as it is on average where it is expected: a density has a unit, and beside
    one that is not left out 1 would be as much as any evidence.
    """
    count = len(theirs.log_weight)
    i, j = np.divmod(np.arange(len(factor.log_weight)), count)
    heights = np.empty((len(seen.known), count))
    for rows in alike(seen.known):
        heights[rows] = _log_mean_heights(theirs, ~seen.known[rows[0]])
    log_weight = factor.log_weight + heights[i, j]
    if which:
        return replace(seen, log_weight=np.logaddexp.reduce(log_weight.reshape(-1, count), axis=1))
    return replace(factor, log_weight=log_weight, known=seen.known[i])


def _log_mean_heights(density: FeatureDensity, features: np.ndarray) -> np.ndarray:
    """Logarithms (K,) of the means of the kernels' densities of some features (F,) bool under themselves, 0 where they
    are uninformative."""
    heights = np.zeros(len(density.known))
    for rows, dims in kinds(density.known & features):
        heights[rows] = -0.5 * np.linalg.slogdet(4.0 * np.pi * density.covariance[np.ix_(rows, dims, dims)])[1]
    return heights


def _check_common(expected: Sequence[FeatureDensity]) -> None:
    for i, own in enumerate(expected):
        others = {n for k, d in enumerate(expected) if k != i for n in d.names}
        if len(expected) > 1 and not others & set(own.names):
            problem = f"chain {i + 1} predicts {', '.join(own.names)}, and no other does"
            raise InputError("chains", problem, remedy="chains that share features")


def step(
    chains: Sequence[FeatureChain[Any, Any]],
    states: Sequence[Any],
    evidence: Evidence,
    dt: float,
    exchange: str = GATED,
) -> tuple[list[Any], list[Message]]:
    """All four steps for one frame: the chains' new states and what each received."""
    priors = [chain.predict(state, dt) for chain, state in zip(chains, states, strict=True)]
    expected = [chain.features(prior) for chain, prior in zip(chains, priors, strict=True)]
    received = messages(expected, evidence, exchange)
    after = [chain.update(prior, m)[0] for chain, prior, m in zip(chains, priors, received, strict=True)]
    return after, received


def nothing_seen(names: Sequence[str]) -> Message:
    """The uninformative message, without detections or other chains."""
    return Message(uniform(names), uniform(names))
