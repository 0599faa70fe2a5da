"""Modes of a frame that are searched from the examples of an index that look like its pictures, without a past."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.imaging.observation import Observation
from estimator.modes.mixture import Mixture
from estimator.modes.origin import Family, Origin
from estimator.search.examples.lookup import Looked, looked_up
from estimator.search.frame_search import FrameCase
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.search.mode_search import ModeSearch
from humanoid.kinematics.body import Body


class Descent(NamedTuple):
    """How modes are searched from examples, see `estimator.trackers.elmo.ElmoSettings`."""

    neighbours: int = 50
    rounds: int = 3
    survivors: int = 16
    recombined: int = 8


def example_modes(search: ModeSearch, rng: np.random.Generator, observation: Observation, count: int) -> Mixture:
    """The `count` best modes of one frame that shows the person, found as ELMO finds those of its first frame; where
    there are keypoints they count as in any frame.

    Raises InputError where no index is named or the one that is cannot be read.
    """
    how = Descent()
    looks = looked_up(search.examples, observation, how.neighbours)
    associations = search.associations(observation)
    starts = [h for k in range(len(associations)) for h in example_starts(search.body, looks, k)]
    case = FrameCase(associations, 0.0, search.likelihood(observation, starts[0].q))
    return search.best_of(descended(search, starts, looks, case, how), case, count, rng)


def example_starts(body: Body, looks: Sequence[Looked], association: int = 0) -> list[Hypothesis]:
    """A start at every example, in one association of the keypoints."""
    return [Hypothesis(body.clamp(q), association, Origin(Family.EXAMPLE)) for look in looks for q in look.q]


def descended(
    search: ModeSearch, starts: Sequence[Hypothesis], looks: Sequence[Looked], case: FrameCase, how: Descent
) -> list[Candidate]:
    """Where short searches lead from the starts: how many reach a mode does not count. What the pictures say is asked
    anew in every round, as in ICP, and only the best go on."""
    candidates = search.explored(starts, case)
    for left in reversed(range(how.rounds - 1)):
        best = search.distinct(candidates, how.survivors)
        again = [c.hypothesis._replace(q=c.q) for c in best]
        if left == how.rounds - 2 and how.recombined:
            others = _recombined(search, best[0], looks)
            again += search.screened(others, case, how.recombined)
        candidates = search.explored(again, case)
    return candidates


def _recombined(search: ModeSearch, best: Candidate, looks: Sequence[Looked]) -> list[Hypothesis]:
    """A pose with one of its limbs as one of the examples has it, for all limbs and examples."""
    body, hypotheses = search.body, []
    place = dict(zip(body.bounded_v.tolist(), body.bounded_q.tolist(), strict=True))  # of an angle's limits, in q
    for limb in search.jumps.limbs:
        if not set(limb.dofs.tolist()) <= place.keys():
            continue
        places = [place[dof] for dof in limb.dofs.tolist()]
        for example in (pose for look in looks for pose in look.q):
            other = best.q.copy()
            other[places] = example[places]
            hypotheses.append(Hypothesis(body.clamp(other), best.hypothesis.association, Origin(Family.EXAMPLE)))
    return hypotheses
