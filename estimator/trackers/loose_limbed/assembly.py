"""Assembly of limbs: beliefs of single limbs -> hypotheses of a body within its limits, without overlapping parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.descent.solution import mode_covariance
from estimator.energy.limb_targets import LimbPull, LimbTargets
from estimator.inference.beliefs.graph import Belief
from estimator.inference.mixture import Mixture, Mode, best_distinct, mixture_of
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Candidate, Hypothesis, Refined
from estimator.search.mode_search import ModeSearch, Scored
from estimator.trackers.loose_limbed.limb_choices import (
    Choice,
    Mistakes,
    PlacementCluster,
    choices,
    instead,
    limb_places,
)
from estimator.trackers.loose_limbed.limb_pulls import LimbPulls, LimbScores, Near, Stiffness
from estimator.trackers.loose_limbed.limbs.left_over import LeftOver
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class AssemblySettings(CheckedSettings):
    """Settings of the assembly of limbs.

    place_floor [m], turn_floor [rad]: standard deviations added to a belief's of a limb's place and turn, since sampled
    beliefs collapse. nu: squared distance, in standard deviations, from which a limb counts as an outlier and pulls
    less. doubted: weight of a limb whose belief no measurement supports. coarse_place [m], coarse_turn [rad]: the same
    floors for the first pull, from any start. alone_place [m], alone_turn [rad]: the same floors with one camera, which
    hardly determines the distance of a limb, so that samples collapse there without being right.

    clusters: places that are distinguished in a belief, with the limb's ends about `apart` [m] from each other or more.
    least: share of a belief from which another of its places is tried. same [m]: two limbs whose ends are nearer than
    this are believed in one place. exchange [nats]: penalty of a hypothesis that confuses limbs or front and back, or
    leaves a limb out. jump [nats]: its largest penalty for being far from all modes of the frame before. forgetting:
    power of the parent's weight that is passed on.

    likelihood: share of the limbs' log likelihood ratios that counts: neighbouring limbs share pixels, which the
    beliefs have used already. least_ratio [nats]: lower bound of a limb's ratio in weights. rounds: how often the modes
    are moved on by the likelihood near them, sampled at `samples` places about each limb, normal deviates of near_place
    [m] and near_turn [rad].

    left_over [nats]: penalty of a hypothesis that covers nothing of the person in a view; it is charged for the share
    that none of its limbs covers. Above 0, outermost limbs are also searched in what the best hypothesis leaves
    uncovered; 0 in the paper. Raises InputError where a value is outside its range.
    """

    place_floor: float = setting(0.01, above=0)
    turn_floor: float = setting(0.1, above=0)
    nu: float = setting(12.0, above=0)
    doubted: float = setting(0.1, at_least=0, at_most=1)
    coarse_place: float = setting(0.08, above=0)
    coarse_turn: float = setting(0.5, above=0)
    alone_place: float = setting(0.05, above=0)
    alone_turn: float = setting(0.3, above=0)
    clusters: int = setting(3, at_least=1)
    apart: float = setting(0.25, above=0)
    least: float = setting(0.1, above=0, at_most=1)
    same: float = setting(0.12, above=0)
    exchange: float = setting(3.0, at_least=0)
    jump: float = setting(12.0, above=0)
    forgetting: float = setting(0.8, at_least=0)
    likelihood: float = setting(0.5, at_least=0)
    least_ratio: float = setting(-30.0, at_most=0)
    rounds: int = setting(4, at_least=0)
    samples: int = setting(60, at_least=10)
    near_place: float = setting(0.02, above=0)
    near_turn: float = setting(0.1, above=0)
    left_over: float = setting(60.0, at_least=0)

    @property
    def near(self) -> Near:
        """The settings for the sampling of limbs near a pose."""
        return Near(self.samples, self.near_place, self.near_turn, self.likelihood)

    @property
    def coarse(self) -> Stiffness:
        """Stiffness of the first pull."""
        return Stiffness(self.coarse_place, self.coarse_turn, "gaussian", self.nu)

    def fine(self, cameras: int) -> Stiffness:
        """Stiffness of the last, for a number of cameras."""
        if cameras == 1:
            return Stiffness(self.alone_place, self.alone_turn, "lorentzian", self.nu)
        return Stiffness(self.place_floor, self.turn_floor, "lorentzian", self.nu)


def assembled(
    search: ModeSearch,
    graph: LimbGraph,
    beliefs: Sequence[Belief],
    observation: Observation,
    likelihood: LimbScores | None = None,
    before: Mixture | None = None,
    elapsed: float = 0.0,
    *,
    count: int = 5,
    settings: AssemblySettings | None = None,
    rng: np.random.Generator | None = None,
    left_over: LeftOver | None = None,
    received: Mapping[int, Sequence[PlacementCluster]] = MappingProxyType({}),
) -> Mixture:
    """The `count` best distinct poses whose limbs are where they are believed to be, as a mixture.

    Every choice of places (`estimator.trackers.loose_limbed.limb_choices.choices`) pulls the body: from rest, with the
    root where the limb nearest to it is believed, or where all limbs' ends fit best, or from a mode of the frame
    before, whichever is nearest, and coarsely at first. The modes of the frame before are pulled to the likeliest
    places, too. Then each is searched with all terms of the frame: the pull of its places, the keypoints in either
    association, the priors, and the transition from that mode of the frame before which explains it best; to a minimum
    within the joint limits and without overlaps. Finally the best are moved a few times by the likelihood near them.

    Weights are those of that energy, with what a choice costs and a share of the limbs' log likelihood ratios at the
    pose. The likelihood near a mode is in its energy and not in its covariance, since beliefs have used the same
    pixels.

    search: of the body. graph: its limbs, or those of the same subject with other lengths. beliefs (L): of each limb,
    of `PLACEMENTS`; one without points draws nothing. observation: the frame, its pictures left to the likelihood.
    before: the mixture of a frame `elapsed` [s] ago. rng: of what is sampled near modes; without one nothing is.
    left_over: the person in the pictures, None where that does not count. received: by outermost limb, other places.

    Raises
    ------
    InputError: not one belief for each limb, beliefs of another space, or a body that lacks a link of the graph.
    """
    s = settings or AssemblySettings()
    places = limb_places(graph, beliefs, s.apart, s.clusters)
    made = choices(graph, places, Mistakes(s.exchange, s.least, s.same))
    made += instead(graph, made[0], received, s.exchange)
    weight, pulls = np.where(places.explained, 1.0, s.doubted), LimbPulls(graph, search.body)
    fine = tuple(pulls.of_choice(choice, weight, s.fine(len(observation.cameras))) for choice in made)
    case = FrameProblem(search.associations(observation), elapsed, pulls=fine)
    frame = _Frame(search, graph, pulls, case, likelihood, before, s, left_over)
    coarse = [pulls.of_choice(choice, weight, s.coarse) for choice in made]
    coarse_poses = frame.coarse_poses(coarse)
    hypotheses = [h for q, k in coarse_poses for h in frame.hypotheses(q, k, made[k])]
    best = frame.refined(frame.best(search.explored(hypotheses, case), count + search.settings.spare), case)
    if rng is not None and likelihood is not None and s.rounds:
        best = frame.moved_on(rng, likelihood, frame.best(best, count))
    best = frame.best(best, count)
    scores = frame.scores(best) + search.log_volumes(best, case)
    return mixture_of(tuple(r.mode for r in best), scores)


class _Frame(NamedTuple):
    """One frame's; see `assembled`."""

    search: ModeSearch
    graph: LimbGraph
    pulls: LimbPulls
    case: FrameProblem
    likelihood: LimbScores | None
    before: Mixture | None
    settings: AssemblySettings
    left_over: LeftOver | None

    @property
    def parents(self) -> tuple[Mode, ...]:
        """Modes of the frame before."""
        return () if self.before is None else self.before.modes

    def coarse_poses(self, coarse: Sequence[LimbPull]) -> list[tuple[np.ndarray, int]]:
        """Poses (nq,) that the choices have drawn the body to, coarsely, each with the choice's index; and the modes of
        the frame before, for the first."""
        body, starts = self.search.body, []
        for k, pull in enumerate(coarse):
            near = np.array([*self.pulls.from_rest(pull), *(m.q for m in self.parents)])
            values = LimbTargets(body, pull).values(body.placed(near))
            starts.append(Hypothesis(near[int(np.argmin(values))], 0, Origin(Family.LIMBS), pull=k))
        case = FrameProblem(self.case.associations[:1], 0.0, pulls=tuple(coarse))
        reached = self.search.explored(starts, case)
        return [(c.q, c.hypothesis.pull) for c in reached] + [(m.q, 0) for m in self.parents]

    def hypotheses(self, q: np.ndarray, k: int, choice: Choice) -> list[Hypothesis]:
        """A pose (nq,) under choice k in every association, continued from the mode that explains it best, if any."""
        parent, handed_on, previous, penalty = -1, 0.0, None, choice.cost
        if self.before is not None:
            parent, handed_on = self._parent(q, self.before)
            previous = None if parent < 0 else PreviousPose(self.before.modes[parent].q)
            penalty += self.settings.jump if parent < 0 else 0.0
        origin = Origin(Family.LIMBS, previous, penalty)
        count = len(self.case.associations)
        return [Hypothesis(q, a, origin, parent, handed_on - penalty, pull=k) for a in range(count)]

    def _parent(self, q: np.ndarray, before: Mixture) -> tuple[int, float]:
        """The mode of the frame before that a pose (nq,) continues, -1 for none, and what it hands on [nats]."""
        handed_on, posed = self.settings.forgetting * before.log_scores, self.search.body.at(q)
        model, dt = self.search.model, self.case.dt
        transition_energy = np.array([model.transition(m.q, dt).value(posed) for m in before.modes]) - handed_on
        best = int(np.argmin(transition_energy))
        return (best, float(handed_on[best])) if transition_energy[best] <= self.settings.jump else (-1, 0.0)

    def scores(self, searched: Sequence[Scored]) -> np.ndarray:
        """Log-weights (N,) of hypotheses as far as they are searched: their own, the limbs' log-likelihood, and the
        penalty of what they leave uncovered of the person."""
        own, s = np.array([c.score for c in searched]), self.settings
        likelihood = self.likelihood if s.likelihood > 0.0 else None
        if (likelihood is None and self.left_over is None) or not searched:
            return own
        poses = np.array([c.mode.q if isinstance(c, Refined) else c.q for c in searched])
        t, R = limb_placements(self.graph, self.search.body, poses)
        if self.left_over is not None:
            own -= s.left_over * np.array([self.left_over.share(*placed) for placed in zip(t, R, strict=True)])
        if likelihood is None:
            return own
        for limb in range(len(self.graph.limbs)):
            ratio = likelihood.log_ratio(limb, t[:, limb], R[:, limb])
            own += s.likelihood * np.fmax(ratio, s.least_ratio)
        return own

    def best(self, searched: Sequence[Scored], count: int) -> list[Scored]:
        """The `count` best of which no two are the same pose."""
        scored = list(zip(searched, self.scores(searched).tolist(), strict=True))
        distance = self.search.distinct_by
        return [c for c, _ in best_distinct(scored, lambda x: x[1], lambda x: x[0].landmarks, distance, count)]

    def refined(self, candidates: Sequence[Candidate], case: FrameProblem) -> list[Refined]:
        """Every candidate after a search to convergence, but for those whose parts could not be kept apart."""
        return self.search.apart(self.search.refined(candidates, case))

    def moved_on(self, rng: np.random.Generator, likelihood: LimbScores, modes: Sequence[Refined]) -> list[Refined]:
        """Modes moved by the likelihood near them, with the covariances that they have without it."""
        case, believed = self.case, [self.case.pulls[r.hypothesis.pull] for r in modes]
        reached = [Candidate(r.hypothesis, r.mode.q, r.landmarks, r.mode.energy) for r in modes]
        for k in range(self.settings.rounds):
            pulls = tuple(
                self.pulls.with_seen(rng, c.q, p, likelihood, self.settings.near)
                for c, p in zip(reached, believed, strict=True)
            )
            case = case._replace(pulls=pulls)
            anew = [c._replace(hypothesis=c.hypothesis._replace(q=c.q, pull=i)) for i, c in enumerate(reached)]
            if k + 1 < self.settings.rounds:
                reached = self.search.explored([c.hypothesis for c in anew], case)
        refined = self.refined(anew, case)
        return [self._as_believed(r, modes[r.hypothesis.pull].hypothesis.pull, case) for r in refined]

    def _as_believed(self, refined: Refined, pull: int, case: FrameProblem) -> Refined:
        """A mode that the likelihood moved, under the pull of the beliefs alone and with the covariance of that."""
        search, mode, hypothesis = self.search, refined.mode, refined.hypothesis
        gradient = search.frame(case).surroundings(refined)[0].gradient
        believed = LimbTargets(search.body, self.case.pulls[pull])
        term = case.associations[hypothesis.association].term
        hessian = search.model.cost(term, image_terms=[believed]).at(mode.q).hessian
        covariance = mode_covariance(search.body, mode.q, gradient, hessian)
        return refined._replace(hypothesis=hypothesis._replace(pull=pull), mode=replace(mode, covariance=covariance))
