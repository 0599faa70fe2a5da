"""The graphical model of a few consecutive instants: a node for each limb at each (Sigal et al. 2004, section 4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.inference.beliefs.graph import Belief, Edge, Graph, LogLikelihood, Node
from estimator.inference.beliefs.mixture import Density, KernelMixture, UniformBox
from estimator.inference.beliefs.potential import Potential
from estimator.inference.beliefs.space import PLACEMENTS, placements_of
from estimator.trackers.loose_limbed.limbs.likelihood import LimbView, limb_view
from estimator.trackers.loose_limbed.limbs.potentials import LimbPotentials

Beliefs = tuple[Belief, ...]
"""Beliefs of all limbs at an instant, in the order of their graph."""


@dataclass(frozen=True)
class Instant:
    """Measurements at one instant.

    time [s]. log_ratio: of a limb at some placements; None where nothing is measured. proposals (L): Q of each limb,
    None where there is none. box (2, 3) [m]: lowest and highest corner of where limbs can be.
    """

    time: float
    log_ratio: LimbLogRatio | None
    proposals: tuple[Density | None, ...]
    box: np.ndarray


@dataclass(frozen=True)
class PastBeliefs:
    """Fixed beliefs of an earlier instant. time [s]."""

    time: float
    beliefs: Beliefs


def window(
    potentials: LimbPotentials, share: float, instants: Sequence[Instant], past: PastBeliefs | None = None
) -> Graph:
    """The graph of one instant or more: limb l at instant k is node k L + l, and behind them the limbs of the past.

    Limbs of an instant are connected as the body is, every limb with itself at the instants beside. The past sends to
    the first instant, and receives nothing; with ten limbs it and two instants are 30 nodes. share: lambda0, of the
    outlier process, which is even in the instant's box.

    Raises
    ------
    InputError: instants farther apart than the potentials' time steps.
    """
    count = len(potentials.limbs)
    nodes = [_node(instant, limb) for instant in instants for limb in range(count)]
    links: dict[Edge, Potential] = {}
    for k, instant in enumerate(instants):
        outlier = UniformBox(PLACEMENTS, *instant.box)
        for (i, j), placements in potentials.spatial.items():
            links[k * count + i, k * count + j] = placements.potential(outlier, share)
    for k, (earlier, later) in enumerate(pairwise(instants)):
        steps = potentials.steps(later.time - earlier.time)
        before, after = UniformBox(PLACEMENTS, *earlier.box), UniformBox(PLACEMENTS, *later.box)
        for limb, (forward, backward) in enumerate(zip(steps.forward, steps.backward, strict=True)):
            here, there = k * count + limb, (k + 1) * count + limb
            links[here, there], links[there, here] = forward.potential(after, share), backward.potential(before, share)
    if past is not None:
        outlier, first = UniformBox(PLACEMENTS, *instants[0].box), len(nodes)
        forwards = potentials.steps(instants[0].time - past.time).forward
        nodes += [Node(fixed=belief) for belief in past.beliefs]
        links |= {(first + limb, limb): forward.potential(outlier, share) for limb, forward in enumerate(forwards)}
    return Graph(PLACEMENTS, tuple(nodes), links)


def initial_messages(graph: Graph, limbs: int, points: np.ndarray) -> dict[Edge, KernelMixture]:
    """First messages of a window's graph of a number of limbs, as if in all its instants each limb were believed at
    some placements, points (L, K, 7), alike."""
    count = points.shape[1]
    alike = np.full(count, -np.log(count))
    free = [i for i, node in enumerate(graph.nodes) if node.fixed is None]
    return {
        (i, j): potential.message(points[i % limbs], alike)
        for (i, j), potential in graph.potentials.items()
        if i in free and j in free
    }


def _node(instant: Instant, limb: int) -> Node:
    return Node(_of_limb(instant.log_ratio, limb), instant.proposals[limb])


def _of_limb(log_ratio: LimbLogRatio | None, limb: int) -> LogLikelihood | None:
    """The likelihood of one limb, as a node's."""
    if log_ratio is None:
        return None

    def log_likelihood(points: np.ndarray) -> np.ndarray:
        return log_ratio(limb, *placements_of(points))

    return log_likelihood


SILHOUETTE = "silhouette"
"""The cue that locates the person."""


LimbLogRatio = Callable[[int, np.ndarray, np.ndarray], np.ndarray]
"""As `LimbLikelihood.log_ratio`: limb, t (N, 3), R (N, 3, 3) -> (N,) nats."""


def limb_views(observation: Observation) -> list[LimbView]:
    """A view of each camera with a picture, in their order; the person's place is known where a silhouette was read."""
    return [_view(cues) for cues in observation.cues if cues.picture is not None]


def _view(cues: ImageCues) -> LimbView:
    assert cues.picture is not None
    read = cues.get(SILHOUETTE)
    mask, known = (None, None) if read is None else (read.mask, read.known)
    return limb_view(cues.camera, cues.picture, mask, known)


def shows_person(views: Sequence[LimbView], least: float = 0.002) -> bool:
    """Whether a view has the person in at least that share of its pixels, or no view locates the person and some
    picture is not of one colour."""
    with_foreground = [view for view in views if view.foreground.size]
    if with_foreground:
        return any(float((view.foreground == 1).mean()) >= least for view in with_foreground)
    return any(max(float(np.abs(m).max()) for m in view.ridges.first) > 0.0 for view in views)
