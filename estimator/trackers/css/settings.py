"""Settings of covariance scaled sampling, and the budget of searches by which the time of a frame is bounded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from estimator.search.hypothesis import Hypothesis
from estimator.search.settings import BY_KEYPOINTS
from estimator.trackers.css.frame_proposals import SHAPES, ProposalSettings
from humanoid.support.settings import ONE_CAMERA, PICTURES, CheckedSettings, setting, unused_where, unused_without


@dataclass(frozen=True)
class BudgetSettings(CheckedSettings):
    """Settings of the budget: the number of searches of a frame.

    searches: at most, the parents' own included, which are always searched. calm: share of what is left after those
    that is spent while the parents continue as expected. alarm: rise of the best energy from frame to frame from which
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


REFINE_BEST, REFINE_ALL = REFINED = ("best", "all")


@dataclass(frozen=True)
class CssSettings(CheckedSettings):
    """The search of each frame.

    modes: hypotheses kept (7 for the body, 3 for the arm in CSS section 6). forgetting: power of a parent's weight that
    is passed on, 1 in Figure 6. Less where the same clutter misleads frame after frame, since frames are then not
    independent. transition: penalise the change since the parent; off in the paper, whose search is static (footnote
    5). keep: search from the parents' own poses too, not from samples alone. momentum: share of its velocity by which a
    parent is moved to a further place where pictures are used too (constant velocity beside driftless dynamics).
    refine: which searches are run to convergence, "all" as printed (Figure 6, step 2.3), or the "best" of those that
    differ after a short search.

    budget: how many searches a frame gets. What the parents leave of it is shared in proportion to:
    samples: about the parents. shape: of their distribution, "covariance" (CSS), "spherical" (of equal volume, the
        rival of CSS section 7) or "weakest" (regular, along the weakest directions, footnote 10). scale: factor on the
        standard deviations, the square root of the s of Figure 6 (4 to 14 there). tail: degrees of freedom of Student's
        t, 0 for a Gaussian.
    swapped_readings: parents with left and right of the keypoints exchanged.
    jumps: kinematic jumps, a limb or part at another depth along its rays (one camera only). jump_penalty: energy of a
        jump, added once instead of the transition's: flow is followed from the limb's place before the jump, so it does
        not distinguish the two depths in one frame, and cheap jumps would go back and forth.
    limb_searches: one limb elsewhere, where there are pictures, the best of limb_samples scored poses, with the penalty
        limb_penalty. exchanges: two limbs change places in the image, with the same penalty. These find limbs that have
        lost their image, so with keypoints of the whole person a quarter of them is enough.
    examples: modes reached from examples that look like the picture, where an index is given (`search.index`), with the
        penalty example_penalty. lost_examples: instead, where nothing was seen in the frame before, or the parents' own
        continuations explain less than half of what is seen; then the whole budget is spent. Besides, with an index
        the change that is penalised is that since the person was last seen, not since the frame before.
    """

    modes: int = setting(7, at_least=1)
    budget: BudgetSettings = field(default_factory=BudgetSettings)
    samples: int = setting(14, at_least=0)
    shape: str = setting("covariance", one_of=SHAPES)
    scale: float = setting(3.0, above=0)
    tail: float = setting(0.0, at_least=0)
    forgetting: float = setting(0.8, at_least=0)
    transition: bool = True
    keep: bool = True
    momentum: float = setting(0.8, at_least=0)
    refine: str = setting(REFINE_BEST, one_of=REFINED)
    swapped_readings: int = setting(7, at_least=0)
    jumps: int = setting(5, at_least=0)
    jump_penalty: float = setting(12.0, at_least=0)
    limb_penalty: float = setting(8.0, above=0)
    limb_samples: int = setting(40, at_least=0)
    limb_searches: int = setting(5, at_least=0)
    exchanges: int = setting(4, at_least=0)
    examples: int = setting(4, at_least=0)
    lost_examples: int = setting(20, at_least=0)
    example_penalty: float = setting(12.0, at_least=0)

    @property
    def proposals(self) -> ProposalSettings:
        """The settings for the places of hypotheses."""
        return ProposalSettings(**{name: getattr(self, name) for name in ProposalSettings._fields})


PAPER = CssSettings(
    budget=BudgetSettings(searches=70, calm=1.0), samples=70, swapped_readings=0, jumps=0, limb_searches=0, exchanges=0,
    examples=0, lost_examples=0, scale=8.0**0.5, forgetting=1.0, transition=False, keep=False, refine=REFINE_ALL,
)  # fmt: skip
"""Figure 6 as printed: samples alone, static energies, parents by Bhattacharyya distance."""


UNUSED = (
    unused_where("css.swapped_readings", search__exchange=False),
    unused_where("cost.transition_potential cost.transition_nu", css__transition=False),
    unused_where("css.jump_penalty css.limb_penalty css.momentum", css__transition=False),
    unused_where("css.jump_penalty", css__jumps=0),
    unused_where("css.limb_samples", css__limb_searches=0),
    unused_where("css.limb_penalty", css__limb_searches=0, css__exchanges=0),
    unused_where("css.examples css.lost_examples css.example_penalty", search__index=""),
    unused_where("css.example_penalty", css__examples=0, css__lost_examples=0),
    unused_where("css.example_penalty", css__transition=False),
    unused_where("css.lost_examples", css__keep=False),
    unused_where("search.index", search__start=BY_KEYPOINTS, css__examples=0, css__lost_examples=0),
    unused_where("css.budget.alarm", css__budget__calm=1.0),
    unused_where("css.budget.alarm", css__keep=False),
    unused_without(ONE_CAMERA, "css.jumps css.jump_penalty css.exchanges"),
    unused_without(PICTURES, "css.momentum css.limb_searches css.limb_samples css.limb_penalty css.exchanges"),
)  # fmt: skip
"""Settings without effect on it (`estimator.trackers.spec.Spec.unused`)."""
