"""Each frame's own energy, as a mode of it reads the frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.term import Term
from estimator.search.hypothesis import EXCHANGED
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing.chain import REACH
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.ties import Ties, ties_of
from humanoid.kinematics.body import Body, PosedBody
from humanoid.shape.surface import Surface
from humanoid.support.spilled import Spill

_IN_MEMORY = 2000  # energies, of some 15 kB each


def spill_of(search: ModeSearch, observations: Sequence[Observation], settings: SmoothSettings) -> Spill:
    """Storage of the energies of all frames, or of the ties between them: those of a window along two paths, or of a
    clip of half a minute, are in memory."""
    shared = [search.model, *search.model.cost(None).terms, *(c for o in observations[:1] for c in o.cameras)]
    return Spill(max(_IN_MEMORY, 2 * (settings.window + 2 * REACH)), shared, (Body, Surface))


def frame_costs(search: ModeSearch, observation: Observation, result: FrameResult) -> list[Cost]:
    """Static energy of a frame in the association of each of its K modes; image features stay assigned as they are
    there."""
    if not observation.is_observed:
        return [search.model.cost(None)] * len(result.weight)
    likelihood = search.likelihood(observation, result.q[0])
    terms = {name: search.term(observation, name) for name in set(result.association)}
    costs = []
    for q, association in zip(result.q, result.association, strict=True):
        assigned = likelihood.assigned(search.body.at(q))
        costs.append(search.model.cost(terms[association], image_terms=assigned))
    return costs


def frame_energies(search: ModeSearch, costs: list[Cost], result: FrameResult) -> np.ndarray:
    """Static energy (K,) of every mode of a frame, with the penalty of an exchanged association."""
    penalty = search.model.settings.exchange_penalty
    return np.array(
        [
            cost.value_at(q) + (penalty if association == EXCHANGED else 0.0)
            for cost, q, association in zip(costs, result.q, result.association, strict=True)
        ]
    )


def frame_shifts(search: ModeSearch, observation: Observation, energy: np.ndarray, result: FrameResult) -> np.ndarray:
    """Corrections of the energies (K,) of a frame's modes, so that readings of the trunk are compared fairly, see
    `ModeSearch.reading_shifts`."""
    return search.reading_shifts(result.q, energy, observation.only_camera)


def renewed_terms(search: ModeSearch, observation: Observation, posed: PosedBody) -> list[Term]:
    """The image terms of a frame, with features assigned at a pose."""
    return search.likelihood(observation, posed.q).assigned(posed) if observation.is_observed else []


def renewed_cost(search: ModeSearch, observation: Observation, association: str, image_terms: Sequence[Term]) -> Cost:
    """Static energy of a frame in an association, with image terms."""
    if not observation.is_observed:
        return search.model.cost(None)
    return search.model.cost(search.term(observation, association), image_terms=image_terms)


def flow_ties(
    search: ModeSearch, observation: Observation, before: PosedBody, posed: PosedBody
) -> tuple[Ties, list[Term]]:
    """Terms that tie a frame to the one before, with the body at `before`, and those that can only be terms of the
    frame itself, with `before` fixed."""
    followed = search.likelihood(observation, posed.q).followed(before, posed)
    return ties_of(search.body, followed, before)


def standing_ties(search: ModeSearch, observation: Observation, association: str, dt: float) -> Ties:
    """Terms that tie the feet of a frame, read in an association, to their places in the one before, `dt` seconds
    ago."""
    return search.model.standing_ties(search.associated(observation, association).standing, dt)


def only(result: FrameResult, k: int) -> FrameResult:
    """A frame with its mode k alone."""
    alone = slice(k, k + 1)
    return replace(result, q=result.q[alone], weight=result.weight[alone], association=result.association[alone])
