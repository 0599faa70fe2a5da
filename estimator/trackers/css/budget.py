"""Which searches a frame gets: a number of them that bounds its time, shared where they help most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.search.hypothesis import Hypothesis
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class BudgetSettings(CheckedSettings):
    """Settings of the budget: the number of searches of a frame.

    searches: at most, the parents' own included, which are always searched. calm: share of what is left after those
    that is spent while the parents go on as expected. alarm: rise of the best energy from frame to frame from which
    everything is spent. Raises InputError for an invalid share.
    """

    searches: int = setting(40, at_least=1)
    calm: float = setting(0.5, at_least=0, at_most=1)
    alarm: float = setting(12.0, above=0)

    def left(self, spent: int, rise: float, doubt: float) -> int:
        """Searches left after `spent`. rise: of the best energy since the last frame. doubt: weight of all modes but
        the best. An energy jump, or hypotheses of equal weight, call for a wider search."""
        need = max(min(max(rise / self.alarm, 0.0), 1.0), doubt)
        effort = self.calm + (1.0 - self.calm) * need
        return max(0, round(effort * (self.searches - spent)))


class Source(NamedTuple):
    """A source of hypotheses: its share of the budget relative to the other sources, and the function that draws that
    many (or fewer, where there are no more)."""

    share: float
    draw: Callable[[int], list[Hypothesis]]


def allocated(count: int, sources: Sequence[Source]) -> list[Hypothesis]:
    """At most `count` hypotheses, by the sources' shares; what one cannot use goes to the ones after it."""
    hypotheses: list[Hypothesis] = []
    shares = np.array([source.share for source in sources], dtype=float)
    for k, source in enumerate(sources):
        left, rest = count - len(hypotheses), shares[k:].sum()
        if left > 0 and shares[k] > 0.0:
            hypotheses += source.draw(round(left * shares[k] / rest))[:left]
    return hypotheses
