"""What is asked of an index of examples: which look like a picture, and how their limbs lie."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from estimator.data.observation import Observation
from estimator.search.examples.index import ExampleIndex
from estimator.search.examples.limbs import LimbBank
from estimator.search.examples.lookup import Lookup, check_elevation, either_way, lookups
from estimator.search.examples.person_seen import PersonEvidence, persons
from estimator.search.examples.votes import Votes, turned_away
from estimator.search.jumps.anatomy import TwoSegmentLimb
from humanoid.kinematics.body import Body
from humanoid.shape.surface import Surface

_EITHER_WAY = 4  # times as many examples are compared where both facings are needed


class Examples:
    """The examples of one index for one body, whose person is seen by `evidence`."""

    def __init__(self, index: ExampleIndex, body: Body, evidence: PersonEvidence) -> None:
        self.index, self.evidence, self._body = index, evidence, body
        self._banks: dict[int, LimbBank] = {}

    def lookups(self, observation: Observation, count: int, together: bool = True) -> list[Lookup]:
        """What the pictures of a frame are looked up by, and the `count` examples that look most like them: chosen by
        all cameras together, or as many by each."""
        return lookups(self.index, observation, count, self.evidence, self._votes if together else None)

    def lookup_without_prior(self, observation: Observation, count: int, together: bool = True) -> list[Lookup]:
        """The same for a frame without a past. Where only one camera sees the person, which hardly distinguishes front
        from back, half of the examples face it and half turn away, whichever are slightly more similar to the
        picture."""
        lookups = self.lookups(observation, _EITHER_WAY * count, together)
        if len(lookups) != 1:
            return self.lookups(observation, count, together)
        (lookup,) = lookups
        away = turned_away(self._body, self._body.placed(lookup.q), lookup.frame) > 90.0
        return [either_way(lookup, away, count)]

    def check(self, observation: Observation) -> None:
        """Raise InputError where the cameras that see the person look down otherwise than the examples' does: what
        they see would look like none of them."""
        check_elevation(self.index, observation, {c: frame for c, frame, _ in persons(observation, self.evidence)})

    def limbs(self, surface: Surface, limbs: tuple[TwoSegmentLimb, ...], count: int) -> LimbBank:
        """The limbs of `count` of the examples, always the same ones; made once."""
        if count not in self._banks:
            q = self.index.q
            chosen = np.random.default_rng(0).choice(len(q), min(count, len(q)), replace=False)
            self._banks[count] = LimbBank(self._body, surface, limbs, q[np.sort(chosen)].astype(np.float64))
        return self._banks[count]

    @cached_property
    def _votes(self) -> Votes:
        return Votes(self.index, self._body)
