"""Covariance scaled sampling (Sminchisescu and Triggs 2003, Figure 6)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from estimator.cost.model import CostModel, CostSettings
from estimator.cost.reprojection import Reprojection
from estimator.cost.term import Cost
from estimator.filtering.merge import best_distinct, body_size
from estimator.filtering.mixture import Mixture, Mode
from estimator.imaging.observation import Observation
from estimator.search.covariance import mode_covariance
from estimator.search.proposals import covariance_scaled_sample
from estimator.search.seek import Found, Seeker, SeekSettings
from humanoid.body import Body
from humanoid.landmarks import mirror_index

ASSOCIATIONS = ("as_detected", "exchanged")


@dataclass(frozen=True)
class CssSettings:
    modes: int = 7
    samples: int = 14
    scale: float = 3.0
    forgetting: float = 0.9
    exchange: bool = True
    distinct: float = 0.03
    cost: CostSettings = field(default_factory=CostSettings)
    explore: SeekSettings = field(default_factory=lambda: SeekSettings(max_iterations=8, decrease_tolerance=0.05))
    refine: SeekSettings = field(default_factory=SeekSettings)


class Candidate(NamedTuple):
    found: Found
    cost: Cost
    parent: int
    association: int
    score: float
    energy: float


class CovarianceScaledSampling:
    def __init__(self, body: Body, settings: CssSettings | None = None) -> None:
        self.body = body
        self.settings = s = settings or CssSettings()
        self.model = CostModel(body, s.cost)
        self.seeker = Seeker(body, s.refine)
        self.mirror = mirror_index(body.landmark_names)
        self.distance = s.distinct * body_size(body)

    def terms(self, observation: Observation) -> list[Reprojection]:
        readings = [observation, observation.exchanged(self.mirror)] if self.settings.exchange else [observation]
        return [self.model.observation_term(o) for o in readings]

    def step(self, rng: np.random.Generator, mixture: Mixture, observation: Observation, dt: float) -> Mixture:
        s = self.settings
        terms = self.terms(observation)
        proposals = [(i, m.q, a) for i, m in enumerate(mixture.modes) for a in range(len(terms))]
        parents = rng.choice(len(mixture.modes), size=s.samples, p=mixture.weights)
        for i in parents:
            m = mixture.modes[i]
            q = covariance_scaled_sample(rng, self.body, m.q, m.covariance, s.scale)
            proposals.append((int(i), q, ASSOCIATIONS.index(m.association)))
        candidates = []
        costs = {}
        for i, q, a in proposals:
            if (i, a) not in costs:
                costs[i, a] = self.model.cost(terms[a], mixture.modes[i].q, dt)
            cost = costs[i, a]
            candidates.append(self.candidate(self.seeker.seek(cost, q, s.explore), cost, i, a, s.forgetting * mixture.log_scores[i]))
        return self.select(candidates, terms)

    def candidate(self, found: Found, cost: Cost, parent: int, association: int, prior: float) -> Candidate:
        energy = found.quadratic.value + (self.settings.cost.exchange_penalty if association else 0.0)
        return Candidate(found, cost, parent, association, prior - energy, energy)

    def select(self, candidates: list[Candidate], terms: list[Reprojection]) -> Mixture:
        s = self.settings
        points = lambda c: self.body.landmarks(c.found.quadratic.posed)
        kept = best_distinct(candidates, lambda c: c.score, points, self.distance, s.modes + 3)
        refined = []
        for c in kept:
            found = self.seeker.seek(c.cost, c.found.q, s.refine)
            refined.append(self.candidate(found, c.cost, c.parent, c.association, c.score + c.energy))
        kept = best_distinct(refined, lambda c: c.score, points, self.distance, s.modes)
        scores = np.array([c.score for c in kept])
        scores -= scores.max()
        weights = np.exp(scores) / np.exp(scores).sum()
        modes = []
        for c in kept:
            static = self.model.cost(terms[c.association]).of(c.found.quadratic.posed)
            covariance = mode_covariance(self.body, c.found.q, static.gradient, static.hessian)
            modes.append(Mode(c.found.q, covariance, c.energy, c.found.status, c.found.kkt_residual, 0.0, c.parent, ASSOCIATIONS[c.association]))
        return Mixture(tuple(modes), weights, scores)
