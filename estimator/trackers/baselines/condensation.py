"""CONDENSATION (Isard and Blake 1998): many particles, moved by simple dynamics and weighted by the energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.observation import Observation
from estimator.inference.annealing import Particles, bootstrap_step, effective_count
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import Initialisation
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import classify_frame
from estimator.trackers.particle_set import (
    DYNAMICS_ALONE,
    FrameEnergy,
    ParticleState,
    Summary,
    first_particle_set,
    summarised,
    unseen,
)
from estimator.trackers.spec import FROM_A_PAPER, ONLY_TO_BEGIN, Spec, by_search
from humanoid.support.settings import setting


@dataclass(frozen=True)
class CondensationSettings:
    """The particle filter.

    particles: how many; each costs one evaluation of the energy a frame (1,000 in Demirdjian et al. 2005).
    noise: of the dynamics, as a share of the energy's turn_speed, root_turn_speed and root_slide_speed. momentum: share
    of its velocity that carries a particle on, 0 for driftless dynamics, 1 for constant velocity. temperature: energies
    are divided by it; 1 is the posterior, more keeps more particles alive. modes: hypotheses reported at most.
    cluster: radius of a hypothesis, root mean square distance of landmarks as a fraction of the body's size.
    """

    particles: int = setting(1000, at_least=1)
    noise: float = setting(0.3, above=0)
    momentum: float = setting(0.0, at_least=0)
    temperature: float = setting(1.0, above=0)
    modes: int = setting(7, at_least=1)
    cluster: float = setting(0.1, above=0)


class Condensation(Initialisation):
    """A row of the particles' states is the configuration (nq,) and the velocity (nv,) [1/s] that led to it.

    For every searched frame but the first it reports
    effective_sample_size: how many evenly weighted particles the weights are worth, from 1 to N.
    log_evidence: logarithm of the mean weight before it is normalised, an estimate of the observation's log-likelihood
        given those before it; at a temperature of 1 and up to a constant of the energy.
    resampled: whether particles were selected by weight, which CONDENSATION does in every frame that it searches.
    """

    def __init__(self, search: ModeSearch, settings: CondensationSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or CondensationSettings()
        self._summary = Summary.of(self.body, self.settings.modes, self.settings.cluster)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[ParticleState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        s = self.settings
        state, result = first_particle_set(self.search, rng, observation, s.modes, s.particles)
        at_rest = np.hstack([state.particles.states, np.zeros((s.particles, self.body.nv))])
        return replace(state, particles=replace(state.particles, states=at_rest)), result

    def step(
        self, rng: np.random.Generator, state: ParticleState, observation: Observation
    ) -> tuple[ParticleState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        particles, before, dt = state.particles, state.mixture, observation.time - state.time
        if not observation.is_observed:
            return unseen(self.search, state, observation, self._moved(rng, particles.states, dt))
        energy, nq = FrameEnergy(self.search, observation, before), self.body.nq
        states, weights, ancestor, log_evidence = bootstrap_step(
            rng,
            particles.states,
            particles.weights,
            lambda old: self._moved(rng, old, dt),
            lambda new, old: -energy.values(new[:, :nq], particles.owner[old]) / self.settings.temperature,
        )
        after = Particles(states, weights, particles.owner[ancestor])
        mixture, owner = summarised(self.search, energy, after, states[:, :nq], before, dt, self._summary)
        diagnostics = {
            "effective_sample_size": np.array(effective_count(weights)),
            "log_evidence": np.array(log_evidence),
            "resampled": np.array(True),
        }
        _, result = classify_frame(self.search, observation, mixture, diagnostics)
        return ParticleState(mixture, observation.time, replace(after, owner=owner)), result

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> ParticleState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return ParticleState.from_arrays(arrays, self.body, self.body.nq + self.body.nv)

    def _moved(self, rng: np.random.Generator, states: np.ndarray, dt: float) -> np.ndarray:
        """States (N, nq + nv) after `dt` [s]."""
        body, nq = self.body, self.body.nq
        std = self.settings.noise * self.search.model.transition_std(dt)
        drift = self.settings.momentum * dt * states[:, nq:]
        q = body.integrated(states[:, :nq], drift + std * rng.standard_normal((len(states), body.nv)))
        velocity = [body.velocity(old, new, dt) for old, new in zip(states[:, :nq], q, strict=True)]
        return np.hstack([q, np.array(velocity)])


SPEC = Spec(
    name="condensation",
    sentence="particle filter (Isard and Blake 1998)",
    make=by_search(Condensation),
    group="condensation",
    settings=CondensationSettings(),
    defaults=FROM_A_PAPER,
    unused=(ONLY_TO_BEGIN, *DYNAMICS_ALONE),
)
