"""State of the particle trackers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays, check_weights, length_of
from estimator.inference.mixture import Mixture
from estimator.inference.particles import Particles
from estimator.trackers.mixture_state import MixtureState
from humanoid.kinematics.body import Body

_FIELDS = {
    "particle_states": Field("f", ("N", "S")),
    "particle_weights": Field("f", ("N",)),
    "particle_owner": Field("i", ("N",)),
}


@dataclass(frozen=True)
class ParticleState:
    """A particle set, the hypotheses it was summarised by, and the time [s] they belong to."""

    mixture: Mixture
    time: float
    particles: Particles

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return MixtureState(self.mixture, self.time).arrays() | self.particles.arrays()

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], body: Body, width: int) -> ParticleState:
        """Rebuild a state from `arrays`. width: S, how many numbers a particle has. Raises DamageError for invalid
        arrays."""
        summary = MixtureState.from_arrays(arrays, body, minima=False)
        check_arrays(arrays, _FIELDS, {"N": length_of(arrays, "particle_weights"), "S": width})
        particles = Particles.from_arrays(arrays)
        check_weights(particles.weights, "particle_weights")
        if not ((particles.owner >= -1) & (particles.owner < len(summary.mixture.weights))).all():
            raise DamageError("particle_owner is not a hypothesis")
        return ParticleState(summary.mixture, summary.time, particles)
