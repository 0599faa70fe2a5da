"""Graphs of nodes and potentials, and beliefs of nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.inference.beliefs.mixture import Density, KernelMixture
from estimator.inference.beliefs.potential import Potential
from estimator.inference.beliefs.space import Space
from estimator.inference.clusters import mean_and_covariance
from humanoid.support.errors import InputError

Edge = tuple[int, int]
LogLikelihood = Callable[[np.ndarray], np.ndarray]

OK, UNEXPLAINED, APART = "ok", "unexplained", "apart"


@dataclass(frozen=True)
class Belief:
    """The belief of a node: points (N, size) and weights (N,) that sum to 1.

    status: "ok"; "unexplained" where the likelihood gives no point any weight, so that the belief is that of the
    messages alone; "apart" where the messages do not overlap, and the belief is their union.
    """

    space: Space
    points: np.ndarray
    weights: np.ndarray
    status: str = OK

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (size,) and covariance (dims, dims) in the tangent space at it."""
        return mean_and_covariance(self.space, self.points, self.weights)


@dataclass(frozen=True)
class Node:
    """A node of a graph.

    log_likelihood: phi_i, points (N, size) -> logarithms (N,), up to a constant; None where nothing is measured.
    proposal: Q_i, the importance function; None where there is none. priors: messages that come from outside the graph
    and stay.
    fixed: a belief that stays: what the node sends, whatever it is sent.
    """

    log_likelihood: LogLikelihood | None = None
    proposal: Density | None = None
    priors: tuple[KernelMixture, ...] = ()
    fixed: Belief | None = None


@dataclass(frozen=True)
class Graph:
    """Nodes, and for each directed edge (i, j) the potential psi_ij as a density of X_j.

    An edge has both directions, or one alone where the other would lead to a node with a fixed belief. Loops are
    welcome.

    Raises
    ------
    InputError: an edge names no node, lacks its other direction, or is of another space; a node has neither neighbours
        nor
        priors nor a proposal.
    """

    space: Space
    nodes: tuple[Node, ...]
    potentials: Mapping[Edge, Potential] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for i, j in self.potentials:
            place = f"edge {i} to {j}"
            if i == j or not (0 <= i < len(self.nodes) and 0 <= j < len(self.nodes)):
                raise InputError("graph", f"has {len(self.nodes)} nodes", place=place)
            if self.potentials[i, j].space != self.space:
                raise InputError("graph", f"the potential is not of {self.space}", place=place)
            if (j, i) not in self.potentials and self.nodes[i].fixed is None:
                raise InputError("graph", "the other direction has no potential", place=place)
        for i, node in enumerate(self.nodes):
            if node.fixed is None and not (node.priors or node.proposal or self.sources[i]):
                problem = "has neither neighbours nor priors nor a proposal"
                raise InputError("graph", problem, place=f"node {i}", remedy="a proposal")

    @cached_property
    def sources(self) -> tuple[tuple[int, ...], ...]:
        """The nodes that send to each."""
        return tuple(tuple(i for i, j in sorted(self.potentials) if j == node) for node in range(len(self.nodes)))

    @cached_property
    def targets(self) -> tuple[tuple[int, ...], ...]:
        """The nodes that each sends to; those with a fixed belief need no message."""
        return tuple(
            tuple(j for i, j in sorted(self.potentials) if i == node and self.nodes[j].fixed is None)
            for node in range(len(self.nodes))
        )
