"""Shared code of the particle trackers: their state, the energy of a frame at any pose, the first set and its
hypotheses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays, check_weights, length_of
from estimator.data.observation import Observation
from estimator.energy.cost import Cost, QuadraticModel
from estimator.energy.descent.solution import SAMPLED
from estimator.energy.term import Term
from estimator.inference.annealing import Particles
from estimator.inference.clusters import clusters, mean_and_covariance
from estimator.inference.mixture import Mixture, Mode, body_size, mixture_of
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.first_pose import start_modes
from estimator.search.hypothesis import AS_DETECTED
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import MixtureState, classify_frame, predict_unobserved
from estimator.vision.cues.base import PastPose
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.settings import unused_where

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


DYNAMICS_ALONE = (
    unused_where("search.follow", "no search begins where its parent was"),
    unused_where("cost.transition_potential cost.transition_nu", "particles move by their dynamics alone"),
    unused_where("search.flow_in_covariance", "covariances are those of the particles"),
)
"""Settings without effect on a particle tracker (`estimator.trackers.spec.Spec.unused`)."""


class FrameEnergy:
    """The energy of one frame that the other trackers descend, but without a penalty of the change, which is in the
    particles' dynamics. Keypoints are read as detected.

    With pictures, features are assigned again for every pose. Flow is that of the surface of the particle's parent
    hypothesis, since computing it costs more than the rest.
    """

    def __init__(self, search: ModeSearch, observation: Observation, before: Mixture) -> None:
        self.body = search.body
        self._base = search.model.cost(search.term(observation, AS_DETECTED))
        self._likelihood = search.likelihood(observation, before.modes[0].q)
        self._flows = self._likelihood.followed_each([PastPose(self.body.at(m.q)) for m in before.modes])
        self._last: PlacedBodies | None = None

    def at(self, q: np.ndarray, owner: int) -> QuadraticModel:
        """The energy at q (nq,), for a particle that came from hypothesis `owner`."""
        posed = self.body.at(q)
        return self._base.plus([*self._flows[owner], *self._likelihood.assigned(posed)]).of(posed)

    def assigned_at(self, q: np.ndarray) -> np.ndarray | None:
        """Pose at which image features are assigned for the energy at q (nq,), None without pictures."""
        return q if self._likelihood.cameras else None

    @property
    def extent(self) -> tuple[float, ...]:
        """See `Origin`."""
        return self._likelihood.extents

    def values(self, q: np.ndarray, owner: np.ndarray) -> np.ndarray:
        """Energies (N,) of configurations (N, nq) that came from hypotheses (N,): those of `at`, to the last bit."""
        placed = self._last = self.body.placed(q)
        values = self._base.values(placed)
        for k, flow in enumerate(self._flows):
            own = owner == k
            if flow and own.any():
                values[own] = self._added(values[own], flow, placed.of(own))
        if self._likelihood.cameras:
            for n, each in enumerate(q):
                for value in self._likelihood.assigned_values(self.body.at(each)):
                    values[n] += value
        return values

    def landmarks(self, q: np.ndarray) -> np.ndarray:
        """Landmarks (N, L, 3) [m] at q (N, nq); those that `values` evaluated last are placed already."""
        placed = self._last
        if placed is None or not np.array_equal(placed.q, q):
            placed = self.body.placed(q)
        return self.body.landmarks_of(placed)

    def _added(self, values: np.ndarray, terms: list[Term], placed: PlacedBodies) -> np.ndarray:
        Cost(self.body, terms).add_values(placed, values)
        return values


def first_particle_set(
    search: ModeSearch, rng: np.random.Generator, observation: Observation, modes: int, count: int
) -> tuple[ParticleState, FrameResult]:
    """State and result of the first frame; the states of its `count` particles are configurations (nq,).

    The start is every tracker's: the best `modes` modes, found by search. Particles are drawn from these Gaussians.
    """
    state, result = classify_frame(search, observation, start_modes(search, rng, observation, modes))
    mixture, body = state.mixture, search.body
    owner = np.sort(rng.choice(len(mixture.modes), size=count, p=mixture.weights))
    factors = [np.linalg.cholesky(m.covariance + 1e-12 * np.eye(body.nv)) for m in mixture.modes]
    q = np.array([body.integrate(mixture.modes[k].q, factors[k] @ rng.standard_normal(body.nv)) for k in owner])
    return ParticleState(mixture, state.time, Particles(q, np.full(count, 1.0 / count), owner)), result


def diffused(rng: np.random.Generator, body: Body, q: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Configurations (N, nq) after independent normal steps of standard deviation (nv,), kept inside the limits."""
    return body.integrated(q, std * rng.standard_normal((len(q), body.nv)))


@dataclass(frozen=True)
class Summary:
    """Settings of the summary of a particle set as hypotheses. modes: their largest number. radius [m]: of a cluster,
    see `clusters`."""

    modes: int
    radius: float

    @staticmethod
    def of(body: Body, modes: int, cluster: float) -> Summary:
        """`cluster`: the radius as a fraction of the body's size."""
        return Summary(modes, cluster * body_size(body))


def summarised(
    search: ModeSearch,
    energy: FrameEnergy,
    particles: Particles,
    q: np.ndarray,
    before: Mixture,
    dt: float,
    summary: Summary,
) -> tuple[Mixture, np.ndarray]:
    """The hypotheses of a particle set, and the one (N,) each particle belongs to.

    A hypothesis is the mean of a cluster on the manifold, with its covariance (of rank below the cluster's count) and
    its share of the weights; clusters are distinguished by the root mean square distance of their landmarks. A compact
    particle set thus has one hypothesis, its mean, which is what the papers report. Energies and KKT residuals are
    those of the means, which are not minima.

    Parameters
    ----------
    particles: weights, and the hypothesis of `before` that each particle came from. q (N, nq): its configurations.
    before: the mixture of the frame before, `dt` [s] ago.
    """
    body = search.body
    points = energy.landmarks(q).reshape(len(q), -1) / np.sqrt(len(body.landmark_names))
    label = clusters(points, particles.weights, summary.radius, summary.modes)
    modes, weights = [], []
    for k in range(int(label.max()) + 1):
        own = label == k
        weight = particles.weights[own]
        mean, covariance = mean_and_covariance(body, q[own], weight)
        parent = int(np.argmax(np.bincount(particles.owner[own], weights=weight)))
        q_previous = before.modes[parent].q
        velocity = body.velocity(q_previous, mean, dt)
        previous = PreviousPose(q_previous, has_transition=False)
        origin = Origin(Family.PARTICLES, previous, q_assigned=energy.assigned_at(mean), extent=energy.extent)
        modes.append(_mode(search, energy.at(mean, parent), covariance, parent, velocity, origin))
        weights.append(weight.sum())
    return mixture_of(tuple(modes), np.log(weights)), label


def _mode(
    search: ModeSearch, at: QuadraticModel, covariance: np.ndarray, parent: int, velocity: np.ndarray, origin: Origin
) -> Mode:
    return Mode(
        q=at.posed.q,
        covariance=covariance,
        energy=at.value,
        status=SAMPLED,
        velocity=velocity,
        kkt_residual=search.seeker.kkt_residual(at),
        penetration=0.0 if search.self_collision is None else search.self_collision.penetration(at.posed),
        parent=parent,
        origin=origin,
    )


def unseen(
    search: ModeSearch, state: ParticleState, observation: Observation, states: np.ndarray
) -> tuple[ParticleState, FrameResult]:
    """An unobserved frame: the hypotheses are carried, the particles go where their dynamics took them, (N, S)."""
    after, result = predict_unobserved(search, state.mixture, observation.time - state.time, observation)
    kept = state.particles
    return ParticleState(after.mixture, after.time, Particles(states, kept.weights, kept.owner)), result
