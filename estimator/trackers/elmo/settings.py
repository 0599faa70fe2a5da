"""Settings of ELMO."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.search.from_examples import ExampleSearch
from humanoid.support.settings import CheckedSettings, setting

_USUAL = ExampleSearch()


@dataclass(frozen=True)
class ElmoSettings(CheckedSettings):
    """ELMO and its parts.

    neighbours: examples of the index (`search.index`) from which a frame is searched, 50 in the paper; 0 for none.
    votes: several cameras choose these together, each voting for the others' too; otherwise each contributes as many.
    keep: search from the last modes too. modes: hypotheses kept, 5 on average in the paper. rounds: short searches of
    each start, points paired again before each; 0 leaves the examples as they are. survivors: how many of the starts
    continue from round to round. recombined: in every round but the last, searches from each of the `recombined_of`
    best poses so far with one limb taken from one of the examples, for each limb: limbs are nearly independent, and few
    examples are near in all of them; 0 for none, as in the paper. limbs: from how many examples limbs are tried for
    this, beside those of the neighbours. again: how often they are tried again where the silhouette counts too, in the
    first frame, or the first after some without the person. anew: how many times as many poses continue and are
    given other limbs then. away: penalty [nats] then of a pose with its back to the
    only camera: most people are filmed from the front, and depth hardly shows which way they face.
    headings: by depth alone keep the best mode that is turned round, in place of the worst, however unlikely: later
    frames may show it to be right. forwards: how much rather people move forwards than backwards [nats/m]
    (`benchmarks.training.walking_forwards`), which shows which way they face.
    jump: largest penalty [nats] of a pose for being far from all modes of the frame before, which may be lost; the
    paper has no such bound. correlated: time [s] for which the silhouette errors of a film are correlated. Where there
    is a silhouette, a frame sooner than this after the last with the person counts by that share less for the direction
    they face; 0 for never.
    settle: the product of likelihood and prior as it is: modes are weighted with their covariances, and searched
    further with the transition from their previous mode in the energy. Off, eqs. 5 and 6, which leave modes at the
    likelihood's maxima and treat what is only unknown as far from the past. turn_floor, root_turn_floor [rad],
    root_slide_floor [m]: least change of a frame, as standard deviations, however short it was; the rest of C_eta (eq.
    4) is the transition's since the last frame in which the person was seen.
    """

    neighbours: int = setting(_USUAL.neighbours, at_least=0)
    votes: bool = _USUAL.votes
    keep: bool = True
    modes: int = setting(5, at_least=1)
    rounds: int = setting(_USUAL.rounds, at_least=0)
    survivors: int = setting(_USUAL.survivors, at_least=1)
    recombined: int = setting(_USUAL.recombined, at_least=0)
    recombined_of: int = setting(_USUAL.recombined_of, at_least=1)
    limbs: int = setting(_USUAL.limbs, at_least=0)
    again: int = setting(_USUAL.again, at_least=0)
    anew: int = setting(_USUAL.anew, at_least=1)
    away: float = setting(_USUAL.away, at_least=0)
    headings: bool = True
    forwards: float = setting(6.0, at_least=0)
    jump: float = setting(12.0, above=0)
    correlated: float = setting(0.5, at_least=0)
    settle: bool = True
    turn_floor: float = setting(0.3, above=0)
    root_turn_floor: float = setting(0.15, above=0)
    root_slide_floor: float = setting(0.1, above=0)

    @property
    def descent(self) -> ExampleSearch:
        """The settings for the search of modes from examples."""
        return ExampleSearch(**{name: getattr(self, name) for name in ExampleSearch._fields})
