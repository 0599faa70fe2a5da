"""Modes of a frame that are searched from the examples of an index that look like its pictures, without a past."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.inference.mixture import Mixture, best_distinct
from estimator.inference.origin import Family, Origin
from estimator.search.examples.limbs import SeenPoints, seen_points
from estimator.search.examples.lookup import Lookup, turned_away
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Candidate, Hypothesis, Refined
from estimator.search.mode_search import ModeSearch, Scored
from estimator.vision.cues.depth import Depth
from estimator.vision.cues.silhouette import Outline
from humanoid.kinematics.body import ROOT_JOINT, Body


class ExampleSearch(NamedTuple):
    """Settings of the search of modes from examples, see `estimator.trackers.elmo.settings.ElmoSettings`."""

    neighbours: int = 50
    votes: bool = True
    rounds: int = 5
    survivors: int = 8
    recombined: int = 6
    recombined_of: int = 2
    limbs: int = 800
    again: int = 1
    anew: int = 3
    away: float = 3.0

    @property
    def without_past(self) -> ExampleSearch:
        """The search of a frame without a past: `anew` times as many poses continue and are given other limbs."""
        return self._replace(survivors=self.anew * self.survivors, recombined_of=self.anew * self.recombined_of)


def example_modes(search: ModeSearch, rng: np.random.Generator, observation: Observation, count: int) -> Mixture:
    """The `count` best modes of one frame that shows the person, found as ELMO finds those of its first frame.
    Keypoints, if any, count as in any frame.

    Raises InputError where no index is given, or it is unreadable or for other cameras.
    """
    how = ExampleSearch()
    search.examples.check(observation)
    lookups = search.examples.lookup_without_prior(observation, how.neighbours)
    associations = search.associations(observation)
    starts = [h for k in range(len(associations)) for h in example_starts(search.body, lookups, how.away, k)]
    case = FrameProblem(associations, 0.0, search.likelihood(observation, starts[0].q))
    groups = sides(search.body, starts, lookups)
    return best_reached(search, groups, lookups, observation, case, how, count, rng, alone=True)


def example_starts(body: Body, lookups: Sequence[Lookup], away: float = 0.0, association: int = 0) -> list[Hypothesis]:
    """A start at every example, in one association of the keypoints. away: what is subtracted from the scores of those
    with their back to the only camera that sees them."""
    starts = []
    for lookup in lookups:
        penalties = np.zeros(len(lookup.q))
        if away > 0.0 and len(lookups) == 1:
            penalties[turned_away(body, body.placed(lookup.q), lookup.frame) > 90.0] = away
        for q, off in zip(lookup.q, penalties.tolist(), strict=True):
            starts.append(Hypothesis(body.clamp(q), association, Origin(Family.EXAMPLE), prior_score=-off))
    return starts


def sides(body: Body, starts: Sequence[Hypothesis], lookups: Sequence[Lookup]) -> list[list[Hypothesis]]:
    """The starts of a frame without a past, in groups that are searched separately: where only one camera sees the
    person, those that face it and those that turn away. Otherwise only those slightly better after a few steps would be
    left, and later frames could not correct that."""
    if len(lookups) != 1:
        return [list(starts)]
    away = turned_away(body, body.placed(np.array([h.q for h in starts])), lookups[0].frame) > 90.0
    both = ([h for h, a in zip(starts, away.tolist(), strict=True) if a is side] for side in (False, True))
    return [side for side in both if side]


def best_reached(
    search: ModeSearch,
    groups: Sequence[Sequence[Hypothesis]],
    lookups: Sequence[Lookup],
    observation: Observation,
    case: FrameProblem,
    how: ExampleSearch,
    count: int,
    rng: np.random.Generator | None = None,
    *,
    headings: bool = False,
    alone: bool = False,
) -> Mixture:
    """The `count` best distinct modes that are reached from groups of starts, each searched apart: in the case without
    the silhouette, see `without_silhouette`; these, and the starts at earlier modes, are refined and ranked in all of
    it, limbs tried again. headings: the best that is turned round is among them, however unlikely. alone: the frame has
    no past, so that it is searched from more poses, limbs are tried again (`ExampleSearch.again`), and evidence whose
    errors last counts in full; energies are without that."""
    how = how.without_past if alone else how._replace(again=0)
    wide = without_silhouette(search, observation, case, groups[0][0].q)
    candidates = [c for group in groups for c in descended(search, group, lookups, observation, wide, how, alone)]
    if wide is not case:
        best = _best(search, candidates, wide, count + search.settings.spare, alone)
        kept = [h for group in groups for h in group if h.origin.family is Family.KEPT]
        candidates = search.explored([c.hypothesis._replace(q=c.q) for c in best] + kept, case)
        seen = _seen_for_limbs(search, observation, lookups, how)
        for _ in range(how.again):
            best = _best(search, candidates, case, how.recombined_of, alone)
            candidates = candidates + search.explored(_recombined(search, best, lookups, seen, how), case)
    both_ways = headings and count > 1 and len(lookups) == 1 and search.body.has_free_root
    if both_ways:
        candidates = candidates + search.explored(_kept_each_way(search.body, groups), case)
    if alone:
        candidates = _in_full(search, candidates, case)
    if not both_ways:
        return search.best_of(candidates, case, count, rng)
    return search.mixture(_both_headings(search, candidates, case, count), case, count, rng)


def _best(
    search: ModeSearch, candidates: Sequence[Candidate], case: FrameProblem, count: int, alone: bool
) -> list[Candidate]:
    """The `count` best distinct candidates; alone: see `best_reached`."""
    if not alone:
        return search.distinct(candidates, count)
    return best_distinct(
        candidates, lambda c: c.score - _left_out(search, c, case), lambda c: c.landmarks, search.distinct_by, count
    )


def _in_full(search: ModeSearch, candidates: Sequence[Candidate], case: FrameProblem) -> list[Candidate]:
    """The candidates, scored with the evidence that counts only where there is no past."""
    scored = []
    for c in candidates:
        full = c.hypothesis.prior_score - _left_out(search, c, case)
        scored.append(c._replace(hypothesis=c.hypothesis._replace(prior_score=full)))
    return scored


def _left_out(search: ModeSearch, c: Candidate, case: FrameProblem) -> float:
    return case.likelihood.without_past(search.body.at(c.q))


def _kept_each_way(body: Body, groups: Sequence[Sequence[Hypothesis]]) -> list[Hypothesis]:
    """The likeliest earlier mode, and the likeliest that is turned round from it: among all starts few rounds would be
    enough for either to be dropped."""
    kept = [h for group in groups for h in group if h.origin.family is Family.KEPT]
    if not kept:
        return []
    turned = np.flatnonzero(turned_round(body, np.array([h.q for h in kept]), kept[0].q))
    return [kept[0], *(kept[k] for k in turned[:1])]


def _both_headings(
    search: ModeSearch, candidates: Sequence[Candidate], case: FrameProblem, count: int
) -> list[Refined]:
    """The `count` best distinct modes of candidates, searched to convergence. Where all face one way, the best that is
    turned round is in place of the last."""
    best = search.distinct(candidates, count + search.settings.spare)
    others = _turned_from(search, candidates, best[0].q)
    missing = [] if _turned_from(search, best, best[0].q) else search.distinct(others, 1)
    reached = search.apart(search.refined([*best, *missing], case))
    kept = search.distinct(reached, count)
    if _turned_from(search, kept, kept[0].q):
        return kept
    return search.with_one_of(kept, _turned_from(search, reached, kept[0].q), count)


def _turned_from(search: ModeSearch, searched: Sequence[Scored], q: np.ndarray) -> list[Scored]:
    """Those that are turned round from a pose (nq,)."""
    turned = turned_round(search.body, np.array([c.q for c in searched]), q)
    return [c for c, away in zip(searched, turned.tolist(), strict=True) if away]


def turned_round(body: Body, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Which of some poses (N, nq) face away from where another (nq,) faces, (N,) bool."""
    ahead = body.placed(np.vstack([other, q])).placements[:, ROOT_JOINT, :3]
    return np.asarray(ahead[1:] @ ahead[0] < 0.0)


def without_silhouette(search: ModeSearch, observation: Observation, case: FrameProblem, q: np.ndarray) -> FrameProblem:
    """The problem in which examples are searched: the case without the silhouette where depth shows the person too,
    since it misleads from poses far off. q (nq,): about where the body is."""
    if search.evidence.cue == Outline.name or not shows_silhouette(observation):
        return case
    without = tuple(cues.changed(**{Outline.name: None}) for cues in observation.cues)
    return case._replace(likelihood=search.likelihood(replace(observation, cues=without), q))


def shows_silhouette(observation: Observation) -> bool:
    """Whether some camera has one."""
    return any(Outline.name in cues for cues in observation.cues)


def descended(
    search: ModeSearch,
    starts: Sequence[Hypothesis],
    lookups: Sequence[Lookup],
    observation: Observation,
    case: FrameProblem,
    how: ExampleSearch,
    alone: bool = False,
) -> list[Candidate]:
    """The results of short searches from the starts, whatever number reaches a mode. Image features are assigned again
    in every round, as in ICP, and only the best continue. alone: see `best_reached`."""
    candidates = search.explored(starts, case)
    seen = _seen_for_limbs(search, observation, lookups, how)
    for left in reversed(range(how.rounds - 1)):
        best = _best(search, candidates, case, how.survivors, alone)
        again = [c.hypothesis._replace(q=c.q) for c in best]
        if left > 0:
            again += _recombined(search, best[: how.recombined_of], lookups, seen, how)
        candidates = search.explored(again, case)
    return candidates


def _seen_for_limbs(
    search: ModeSearch, observation: Observation, lookups: Sequence[Lookup], how: ExampleSearch
) -> SeenPoints | None:
    """Ranking of the limbs of examples; None where none are tried."""
    depth = search.model.cues.of(Depth.name)
    return seen_points(observation, depth.surface_noise, depth.nu) if lookups and how.recombined else None


def _recombined(
    search: ModeSearch,
    poses: Sequence[Candidate],
    lookups: Sequence[Lookup],
    seen: SeenPoints | None,
    how: ExampleSearch,
) -> list[Hypothesis]:
    """Poses with one of their limbs from one of the examples; none where no limbs are seen."""
    if seen is None:
        return []
    bank = search.examples.limbs(search.model.image.surface, search.jumps.limbs, how.limbs)
    alike, hypotheses = np.concatenate([lookup.q for lookup in lookups]), []
    for c in poses:
        changed = (bank.best(c.q, k, alike, seen, how.recombined) for k in range(len(bank.limbs)))
        mine = c.hypothesis._replace(origin=Origin(Family.EXAMPLE))
        hypotheses += [mine._replace(q=q) for of in changed for q in of]
    return hypotheses
