"""Limbs put together: beliefs of single limbs -> hypotheses of a body within its limits, its parts kept apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from estimator.imaging.observation import Observation
from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.space import placements_of
from estimator.modes.merge import best_distinct
from estimator.modes.mixture import Mixture, mixture_of
from estimator.modes.origin import Family, Origin, PreviousPose
from estimator.numerics.alignment import similarity_onto
from estimator.search.frame_search import FrameCase
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.search.limb_choices import Choice, Mistakes, choices
from estimator.search.limb_places import limb_places
from estimator.search.mode_search import ModeSearch
from estimator.search.views import with_root
from estimator.terms.limb_targets import LimbPull, LimbTargets
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements, limbs_on_joints
from humanoid.support.settings import check, setting


class LimbScores(Protocol):
    """What says how likely single limbs are by what was measured: `estimator.limbs.likelihood.LimbLikelihood`."""

    def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Of places t (N, 3), R (N, 3, 3) of a limb: (N,) [nats], minus infinity where it cannot be."""
        ...


@dataclass(frozen=True)
class AssemblySettings:
    """How limbs are put together.

    place_floor [m], turn_floor [rad]: what is added to how well a belief knows a limb's place and turn: sampled beliefs
    collapse. nu: squared distance, in standard deviations, from which a limb counts as astray and pulls less. doubted:
    weight of a limb whose belief nothing measured explains. coarse_place [m], coarse_turn [rad]: the same floors of the
    first pull, from wherever the body is. clusters: places that are told apart in a belief, of which the limb's ends
    are about `apart` [m] from each other or more. least: share of a belief from which another of its places is tried.
    same [m]: two limbs are believed in one place whose ends are nearer than this. exchange [nats]: what a hypothesis
    pays that takes limbs for each other or the front for the back, or leaves one out. jump [nats]: what it pays at most
    for being far from all modes of the frame before. forgetting: power of the parent's weight that is handed on.
    likelihood: share of the limbs' log likelihood ratios that counts in weights: neighbouring limbs see the same
    pixels, and the beliefs know these already. least_ratio [nats]: no limb counts for less than this.
    Raises InputError where a value cannot be.
    """

    place_floor: float = setting(0.01, above=0)
    turn_floor: float = setting(0.1, above=0)
    nu: float = setting(12.0, above=0)
    doubted: float = setting(0.1, at_least=0, at_most=1)
    coarse_place: float = setting(0.08, above=0)
    coarse_turn: float = setting(0.5, above=0)
    clusters: int = setting(3, at_least=1)
    apart: float = setting(0.25, above=0)
    least: float = setting(0.1, above=0, at_most=1)
    same: float = setting(0.12, above=0)
    exchange: float = setting(3.0, at_least=0)
    jump: float = setting(12.0, above=0)
    forgetting: float = setting(0.8, at_least=0)
    likelihood: float = setting(0.3, at_least=0)
    least_ratio: float = setting(-30.0, at_most=0)

    def __post_init__(self) -> None:
        check(self)


class Past(NamedTuple):
    """The mixture of a frame before, `elapsed` [s] ago."""

    mixture: Mixture
    elapsed: float


def assembled(
    search: ModeSearch,
    graph: LimbGraph,
    beliefs: Sequence[Belief],
    observation: Observation,
    likelihood: LimbScores | None = None,
    past: Past | None = None,
    *,
    count: int = 5,
    settings: AssemblySettings | None = None,
) -> Mixture:
    """The `count` best distinct poses whose limbs are where they are believed to be, as a mixture.

    Every choice of places (`estimator.search.limb_choices.choices`) draws the body: from rest, with the root where the
    limb nearest to it is believed, or where all limbs' ends lie best, or from a mode of the frame before, whichever is
    nearest; coarsely at first. The modes of the frame before are drawn to the likeliest places, too. Then each is
    searched with what is known of the frame: the pull of its places, the keypoints in either association, the priors,
    and the transition from that mode of the frame before which explains it best; at last to a minimum within the joint
    limits and without overlaps.

    Weights are those of that energy, with what a choice costs and a share of the limbs' log likelihood ratios at the
    pose. A mode's energy and covariance have neither.

    search: of the body. graph: its limbs, or those of the same subject with other lengths. beliefs (L): of each limb,
    of `PLACEMENTS`; one without points draws nothing. observation: the frame, its pictures left to the likelihood.

    Raises
    ------
    InputError: not one belief for each limb, beliefs of another space, or a body that lacks a link of the graph.
    """
    assembly = _Assembly(search, graph, observation, likelihood, past, settings or AssemblySettings())
    return assembly.mixture(beliefs, count)


class _Assembly:
    """One frame's; see `assembled`."""

    def __init__(
        self,
        search: ModeSearch,
        graph: LimbGraph,
        observation: Observation,
        likelihood: LimbScores | None,
        past: Past | None,
        settings: AssemblySettings,
    ) -> None:
        self._search, self._body, self._graph = search, search.body, graph
        self._likelihood, self._past, self._settings = likelihood, past, settings
        self._joint, self._local = limbs_on_joints(graph, search.body)
        self._associations = search.associations(observation)
        self._before = () if past is None else past.mixture.modes

    def mixture(self, beliefs: Sequence[Belief], count: int) -> Mixture:
        """See `assembled`."""
        s = self._settings
        places = limb_places(self._graph, beliefs, s.apart, s.clusters)
        made = choices(self._graph, places, Mistakes(s.exchange, s.least, s.same))
        weight = np.where(places.explained, 1.0, s.doubted)
        dt = 0.0 if self._past is None else self._past.elapsed
        coarse = [self._pull(c, weight, s.coarse_place, s.coarse_turn, "gaussian") for c in made]
        fine = [self._pull(c, weight, s.place_floor, s.turn_floor, "lorentzian") for c in made]
        case = FrameCase(self._associations, dt, None, tuple(fine))
        drawn = self._drawn(coarse)
        hypotheses = [h for q, k in drawn for h in self._hypotheses(q, k, made[k], case)]
        explored = self._search.explored(hypotheses, case)
        return self._best(explored, case, count)

    def _pull(self, choice: Choice, weight: np.ndarray, metres: float, radians: float, potential: str) -> LimbPull:
        """What draws limbs to the places of a choice. weight (L,). metres, radians: floors."""
        floor = np.repeat(np.square([metres, radians]), 3)
        target, precision = (
            np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(weight), 1)),
            np.zeros((len(weight), 6, 6)),
        )
        for i, place in enumerate(choice.places):
            if place is not None:
                target[i], precision[i] = place.point, np.linalg.inv(place.covariance + np.diag(floor))
        drawn = np.array([place is not None for place in choice.places])
        precision = 0.5 * (precision + precision.transpose(0, 2, 1))
        return LimbPull(self._joint, self._local, target, precision, weight * drawn, potential, self._settings.nu)

    def _drawn(self, coarse: Sequence[LimbPull]) -> list[tuple[np.ndarray, int]]:
        """Poses (nq,) that the choices have drawn the body to, coarsely, each with the choice's index; and the modes of
        the frame before, for the first."""
        case = FrameCase(self._associations[:1], 0.0, None, tuple(coarse))
        starts = []
        for k, pull in enumerate(coarse):
            near = np.array([*self._placed(pull), *(m.q for m in self._before)])
            values = LimbTargets(self._body, pull).values(self._body.placed(near))
            starts.append(Hypothesis(near[int(np.argmin(values))], 0, Origin(Family.LIMBS), pull=k))
        reached = self._search.explored(starts, case)
        return [(c.q, c.hypothesis.pull) for c in reached] + [(m.q, 0) for m in self._before]

    def _placed(self, pull: LimbPull) -> list[np.ndarray]:
        """The body at rest with a free root placed for the limbs: where that nearest to it is drawn, and so that the
        ends of all lie best."""
        body, rest = self._body, self._body.neutral
        drawn = np.flatnonzero(pull.weight > 0.0)
        if not body.has_free_root or len(drawn) == 0:
            return [rest]
        t, R = limb_placements(self._graph, body, rest)
        goal, turn = placements_of(pull.target)
        carrier = drawn[np.argmin([body.support(int(j)).sum() for j in self._joint[drawn]])]
        R_carried = turn[carrier] @ R[carrier].T
        carried = _moved(body, rest, R_carried, goal[carrier] - R_carried @ t[carrier])
        length = np.array([[limb.length] for limb in self._graph.limbs])
        own = np.concatenate([t[drawn], (t + length * R[:, :, 2])[drawn]])
        fitted = similarity_onto(own, np.concatenate([goal[drawn], (goal + length * turn[:, :, 2])[drawn]]))
        return [carried, _moved(body, rest, fitted.R, fitted.t)]

    def _hypotheses(self, q: np.ndarray, k: int, choice: Choice, case: FrameCase) -> list[Hypothesis]:
        """A pose under choice k in every association, continued from the mode that explains it best, if one does."""
        parent, handed_on = -1, 0.0
        origin = Origin(Family.LIMBS, None, choice.cost)
        if self._past is not None:
            parent, handed_on = self._parent(q, case.dt)
            if parent < 0:
                origin = origin._replace(penalty=choice.cost + self._settings.jump)
            else:
                origin = origin._replace(previous=PreviousPose(self._before[parent].q))
        score = handed_on - origin.penalty
        return [Hypothesis(q, a, origin, parent, score, pull=k) for a in range(len(case.associations))]

    def _parent(self, q: np.ndarray, dt: float) -> tuple[int, float]:
        """The mode of the frame before that a pose (nq,) continues, -1 for none, and what it hands on [nats]."""
        assert self._past is not None
        handed_on = self._settings.forgetting * self._past.mixture.log_scores
        posed = self._body.at(q)
        paid = np.array([self._search.model.transition(m.q, dt).value(posed) for m in self._before])
        best = int(np.argmin(paid - handed_on))
        if paid[best] - handed_on[best] > self._settings.jump:
            return -1, 0.0
        return best, float(handed_on[best])

    def _best(self, explored: Sequence[Candidate], case: FrameCase, count: int) -> Mixture:
        search = self._search
        seen = self._seen([c.q for c in explored])
        scored = sorted(zip(explored, seen.tolist(), strict=True), key=lambda x: -(x[0].score + x[1]))
        kept = best_distinct(
            scored, lambda x: x[0].score + x[1], lambda x: x[0].landmarks, search.distinct_by,
            count + search.settings.spare,
        )  # fmt: skip
        refined = search.apart(search.refined([c for c, _ in kept], case))
        again = list(zip(refined, self._seen([r.mode.q for r in refined]).tolist(), strict=True))
        best = best_distinct(again, lambda x: x[0].score + x[1], lambda x: x[0].landmarks, search.distinct_by, count)
        scores = np.array([r.score + s for r, s in best]) + search.log_volumes([r for r, _ in best], case)
        return mixture_of(tuple(r.mode for r, _ in best), scores)

    def _seen(self, poses: Sequence[np.ndarray]) -> np.ndarray:
        """What the limbs' likelihood adds to the log-weights of poses (N) of (nq,): (N,)."""
        total, s = np.zeros(len(poses)), self._settings
        if self._likelihood is None or s.likelihood == 0.0 or not len(poses):
            return total
        t, R = limb_placements(self._graph, self._body, np.array(poses))
        for limb in range(len(self._graph.limbs)):
            ratio = self._likelihood.log_ratio(limb, t[:, limb], R[:, limb])
            total += np.maximum(np.nan_to_num(ratio, nan=s.least_ratio, neginf=s.least_ratio), s.least_ratio)
        return s.likelihood * total


def _moved(body: Body, q: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The pose q (nq,) moved as a whole by R (3, 3), t (3,)."""
    posed = body.at(q)
    return with_root(q, R @ posed.rotations[1], R @ posed.translations[1] + t)
