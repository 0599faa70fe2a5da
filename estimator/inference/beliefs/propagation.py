"""Which messages are passed in which order: all together and again, or through a tree there and back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator.inference.beliefs.graph import Belief, Edge, Graph
from estimator.inference.beliefs.mixture import KernelMixture
from estimator.inference.beliefs.products import ProductSettings
from estimator.inference.beliefs.strata import Shares, StrataTarget, Weighted, node_samples
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""As `map`."""
Watch = Callable[[int, tuple[Belief, ...]], None]
"""Called with the number of an iteration and the beliefs after it."""


@dataclass(frozen=True)
class BeliefSettings(CheckedSettings):
    """Settings of belief propagation.

    kernels: N, of a message: its N' = (N - 1) / M samples make M kernels each, the outlier process the last (PAMPAS).
    samples: of a belief. iterations: of the batch schedule. proposal_share: lambda_S of the first. proposal_factor:
    what it is multiplied by with each iteration. belief_share: lambda_B as a share of what lambda_S leaves, the rest is
    lambda_I.
    product: how products of messages are drawn from.
    """

    kernels: int = setting(100, at_least=2)
    samples: int = setting(100, at_least=1)
    iterations: int = setting(4, at_least=1)
    proposal_share: float = setting(0.5, at_least=0.0, at_most=1.0)
    proposal_factor: float = setting(0.5, at_least=0.0, at_most=1.0)
    belief_share: float = setting(0.5, at_least=0.0, at_most=1.0)
    product: ProductSettings = field(default_factory=ProductSettings)

    def shares(self, iteration: int) -> Shares:
        """Shares of the strata, in an iteration counted from 0."""
        return Shares.of(self.proposal_share * self.proposal_factor**iteration, self.belief_share)


@dataclass(frozen=True)
class Propagated:
    """The belief of every node, the messages by directed edge (i, j), and for each the status of its samples."""

    beliefs: tuple[Belief, ...]
    messages: Mapping[Edge, KernelMixture]
    status: Mapping[Edge, str]


def propagate_batch(
    rng: np.random.Generator,
    graph: Graph,
    settings: BeliefSettings,
    messages: Mapping[Edge, KernelMixture] | None = None,
    watch: Watch | None = None,
    each: Each = map,
) -> Propagated:
    """All messages computed from those of the iteration before, several times (Sigal et al. 2004, section 4).

    A node that received no message and has no proposal sends nothing yet. messages: the initial ones. watch: takes the
    number of each iteration and the beliefs after it, with random numbers of its own. each: `map`, or one that shares
    the work of nodes; every node has random numbers of its own, so that the order changes no bit.

    Raises
    ------
    InputError: some node received no message after the last iteration.
    """
    passing = _Passing(graph, settings, {**_said_once(graph), **(messages or {})})
    moving = [i for i, node in enumerate(graph.nodes) if node.fixed is None]
    for iteration in range(settings.iterations):
        seeds = _seeds(rng, 2 * len(graph.nodes))
        speaking = [i for i in moving if passing.can_speak(i)]
        turns = [(int(seeds[i]), i, graph.targets[i], iteration) for i in speaking]
        said = list(each(lambda turn: passing.spoken(*turn), turns))
        for part in said:
            passing.take(part)
        if watch is not None and all(map(passing.can_speak, moving)):
            watch(iteration, passing.beliefs(seeds[len(graph.nodes) :], iteration, each))
    return passing.result(_seeds(rng, len(graph.nodes)), settings.iterations - 1, each)


def propagate_tree(rng: np.random.Generator, graph: Graph, settings: BeliefSettings) -> Propagated:
    """Every message once, from the leaves to the first node of each tree and back.

    Raises
    ------
    InputError: the graph has a loop; or a node has nothing to draw from when its turn comes.
    """
    order, parent = _rooted(graph)
    passing = _Passing(graph, settings, _said_once(graph))
    seeds = _seeds(rng, 3 * len(graph.nodes))
    count = len(graph.nodes)
    inwards: list[tuple[int, tuple[int, ...]]] = [(i, (parent[i],)) for i in reversed(order) if parent[i] >= 0]
    outwards = [(i, tuple(j for j in graph.targets[i] if parent[j] == i)) for i in order]
    for turn, steps in enumerate((inwards, outwards)):
        for i, targets in steps:
            if targets and not passing.can_speak(i):
                raise InputError("graph", "has nothing to draw from", place=f"node {i}", remedy="a proposal")
            passing.take(passing.spoken(seeds[turn * count + i], i, targets, 0))
    return passing.result(seeds[2 * count :], 0, map)


class _Passing:
    """Messages as they are passed along."""

    def __init__(self, graph: Graph, settings: BeliefSettings, messages: dict[Edge, KernelMixture]) -> None:
        self._graph, self._settings = graph, settings
        self._messages = messages
        self._status: dict[Edge, str] = {}

    def can_speak(self, i: int) -> bool:
        """Whether a node has anything to draw samples from."""
        return self._graph.nodes[i].proposal is not None or bool(self._received(i)[1])

    def spoken(
        self, seed: int, i: int, targets: Sequence[int], iteration: int
    ) -> dict[Edge, tuple[KernelMixture, str]]:
        """The messages of a node to some others, with their statuses."""
        if not targets:
            return {}
        sources, factors = self._received(i)
        potentials = [self._graph.potentials[i, j] for j in targets]
        wanted = [
            StrataTarget(sources.index(j) if j in sources else None,
                   max(1, (self._settings.kernels - 1) // len(potential.relative)))
            for j, potential in zip(targets, potentials, strict=True)
        ]  # fmt: skip
        samples = self._samples(seed, i, factors, wanted, iteration)
        return {
            (i, j): (potential.message(s.points, s.log_weight), s.status)
            for j, potential, s in zip(targets, potentials, samples, strict=True)
        }

    def take(self, said: Mapping[Edge, tuple[KernelMixture, str]]) -> None:
        """Let messages take the place of those before."""
        for edge, (message, status) in said.items():
            self._messages[edge], self._status[edge] = message, status

    def beliefs(self, seeds: np.ndarray, iteration: int, each: Each) -> tuple[Belief, ...]:
        """Beliefs of all nodes, from their messages."""
        return tuple(each(lambda i: self._belief(int(seeds[i]), i, iteration), range(len(self._graph.nodes))))

    def result(self, seeds: np.ndarray, iteration: int, each: Each) -> Propagated:
        """The current result."""
        return Propagated(self.beliefs(seeds, iteration, each), self._messages, self._status)

    def _belief(self, seed: int, i: int, iteration: int) -> Belief:
        node = self._graph.nodes[i]
        if node.fixed is not None:
            return node.fixed
        factors = self._received(i)[1]
        if not factors and node.proposal is None:
            raise InputError("graph", "received no message", place=f"node {i}", remedy="a proposal, or more iterations")
        (s,) = self._samples(seed, i, factors, [StrataTarget(None, self._settings.samples)], iteration)
        return Belief(self._graph.space, s.points, np.exp(s.log_weight), s.status)

    def _samples(
        self, seed: int, i: int, factors: Sequence[KernelMixture], wanted: Sequence[StrataTarget], iteration: int
    ) -> list[Weighted]:
        rng, settings = np.random.default_rng(seed), self._settings
        return node_samples(rng, self._graph.nodes[i], factors, wanted, settings.shares(iteration), settings.product)

    def _received(self, i: int) -> tuple[list[int], list[KernelMixture]]:
        """The nodes that have sent to a node, and their messages, with the priors behind them."""
        sources = [k for k in self._graph.sources[i] if (k, i) in self._messages]
        return sources, [*(self._messages[k, i] for k in sources), *self._graph.nodes[i].priors]


def _said_once(graph: Graph) -> dict[Edge, KernelMixture]:
    """The messages of nodes whose beliefs stay."""
    messages = {}
    for i, node in enumerate(graph.nodes):
        if node.fixed is None:
            continue
        for j in graph.targets[i]:
            with np.errstate(divide="ignore"):
                messages[i, j] = graph.potentials[i, j].message(node.fixed.points, np.log(node.fixed.weights))
    return messages


def _seeds(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.integers(0, 2**63, count)


def _rooted(graph: Graph) -> tuple[list[int], list[int]]:
    """Nodes without fixed beliefs from the roots outwards, and each one's parent, -1 for a root."""
    parent = [-1] * len(graph.nodes)
    order: list[int] = []
    for root, node in enumerate(graph.nodes):
        if node.fixed is not None or root in order:
            continue
        order.append(root)
        waiting = [root]
        while waiting:
            i = waiting.pop(0)
            for j in graph.targets[i]:
                if j == parent[i]:
                    continue
                if j in order:
                    raise InputError("graph", "has a loop", place=f"nodes {i} and {j}", remedy="the batch schedule")
                parent[j] = i
                order.append(j)
                waiting.append(j)
    return order, parent
