"""Annealed particle filter (Deutscher, Blake and Reid 2000), as Sigal et al. 2004 ran it for comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.observation import Observation
from estimator.inference.annealing import Annealing, anneal
from estimator.inference.clusters import mean_and_covariance
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import Initialisation
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import classify_frame
from estimator.trackers.particle_set import (
    DYNAMICS_ALONE,
    FrameEnergy,
    ParticleState,
    Summary,
    diffused,
    first_particle_set,
    summarised,
    unseen,
)
from estimator.trackers.spec import FROM_A_PAPER, ONLY_TO_BEGIN, Spec, by_search
from humanoid.support.settings import setting


@dataclass(frozen=True)
class AnnealedSettings:
    """The annealed particle filter.

    layers, particles: number of layers, and of particles in each, each an evaluation of the energy (10 and 200 in Sigal
    et al. 2004). survival: share of the particles that each layer lets live, which sets its power of the likelihood.
    noise: of the dynamics, before the first layer, as a share of the energy's turn_speed, root_turn_speed and
    root_slide_speed. diffusion: noise before the other layers, as a share of that; it shrinks with the particles'
    standard deviation in each degree of freedom. modes: hypotheses reported at most. cluster: radius of a hypothesis,
    root mean square distance of landmarks as a fraction of the body's size.
    """

    layers: int = setting(10, at_least=1)
    particles: int = setting(200, at_least=1)
    survival: float = setting(0.5, above=0, at_most=1)
    noise: float = setting(0.3, above=0)
    diffusion: float = setting(0.5, above=0)
    modes: int = setting(7, at_least=1)
    cluster: float = setting(0.1, above=0)


class Annealed(Initialisation):
    """Driftless dynamics; the particles' states are configurations (nq,). See `estimator.inference.annealing`.

    For every searched frame but the first it reports, by layer,
    annealing_power (layers,): the power of the likelihood.
    effective_sample_size (layers,): how many evenly weighted particles the weights by that power are worth.
    """

    def __init__(self, search: ModeSearch, settings: AnnealedSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = s = settings or AnnealedSettings()
        self._annealing = Annealing(s.layers, s.survival, s.diffusion)
        self._summary = Summary.of(self.body, s.modes, s.cluster)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[ParticleState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return first_particle_set(self.search, rng, observation, self.settings.modes, self.settings.particles)

    def step(
        self, rng: np.random.Generator, state: ParticleState, observation: Observation
    ) -> tuple[ParticleState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        particles, before, dt = state.particles, state.mixture, observation.time - state.time
        noise = self.settings.noise * self.search.model.transition_std(dt)

        def disperse(q: np.ndarray, scale: np.ndarray | float) -> np.ndarray:
            return diffused(rng, self.body, q, scale * noise)

        if not observation.is_observed:
            return unseen(self.search, state, observation, disperse(particles.states, 1.0))
        energy = FrameEnergy(self.search, observation, before)
        particles, layers = anneal(rng, particles, self._annealing, disperse, energy.values, self._spread)
        mixture, owner = summarised(self.search, energy, particles, particles.states, before, dt, self._summary)
        diagnostics = {"annealing_power": layers.power, "effective_sample_size": layers.effective_count}
        _, result = classify_frame(self.search, observation, mixture, diagnostics)
        return ParticleState(mixture, observation.time, replace(particles, owner=owner)), result

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> ParticleState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return ParticleState.from_arrays(arrays, self.body, self.body.nq)

    def _spread(self, q: np.ndarray, weights: np.ndarray) -> np.ndarray:
        covariance = mean_and_covariance(self.body, q, weights)[1]
        return np.sqrt(np.diag(covariance))


SPEC = Spec(
    name="annealed",
    sentence="annealed particle filter (Deutscher, Blake and Reid 2000)",
    make=by_search(Annealed),
    group="annealed",
    settings=AnnealedSettings(),
    defaults=FROM_A_PAPER,
    unused=(ONLY_TO_BEGIN, *DYNAMICS_ALONE),
)
