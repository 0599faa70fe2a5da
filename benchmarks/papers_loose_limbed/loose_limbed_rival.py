"""The annealed particle filter on the likelihood of limbs, as Sigal et al. 2004 compared it (section 6)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.support.common import tell
from benchmarks.support.pose_prior_clips import captured_files
from benchmarks.training.limb_learning import motion, unseen_by
from estimator.inference.annealing import Annealing, Particles, anneal, normalised
from estimator.inference.clusters import mean_and_covariance
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements

LAYERS, PARTICLES = 10, 200
_SURVIVAL, _DIFFUSION = 0.5, 0.5


class AnnealedOnLimbs:
    """Driftless dynamics on the tree, with noise (nv,) a frame that was learned; the energy is minus the sum of the
    limbs' log likelihood ratios at a pose.

    q (nq,): the first pose, of which all particles start. likely (N,): weights of the particles by the likelihood as it
    is, of which Sigal et al. take their expected distances; the particles' own are of the last layer's power.
    """

    def __init__(
        self, body: Body, graph: LimbGraph, noise: np.ndarray, q: np.ndarray, particles: int = PARTICLES
    ) -> None:
        self._body, self._graph, self._noise = body, graph, noise
        self._annealing = Annealing(LAYERS, _SURVIVAL, _DIFFUSION)
        self.particles = Particles(
            np.repeat(q[None], particles, axis=0), np.full(particles, 1.0 / particles), np.zeros(particles, dtype=int)
        )
        self.likely = self.particles.weights

    def step(self, rng: np.random.Generator, likelihood: LimbLikelihood | None) -> Particles:
        """The particles of the next frame; None where no person is seen."""

        def disperse(q: np.ndarray, scale: np.ndarray | float) -> np.ndarray:
            return self._body.integrated(q, scale * self._noise * rng.standard_normal((len(q), self._body.nv)))

        if likelihood is None:
            p = self.particles
            self.particles, self.likely = Particles(disperse(p.states, 1.0), p.weights, p.owner), p.weights
            return self.particles

        def energies(q: np.ndarray, owner: np.ndarray) -> np.ndarray:
            t, R = limb_placements(self._graph, self._body, q)
            ratios = [likelihood.log_ratio(k, t[:, k], R[:, k]) for k in range(len(self._graph.limbs))]
            return -np.maximum(np.sum(ratios, axis=0), -1e6)

        self.particles, _ = anneal(rng, self.particles, self._annealing, disperse, energies, self._spread)
        self.likely = normalised(-energies(self.particles.states, self.particles.owner))[0]
        return self.particles

    def _spread(self, q: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.sqrt(np.diag(mean_and_covariance(self._body, q, weights)[1]))


def learned_noise(body: Body, data: Path | None, folder: Path) -> np.ndarray:
    """Standard deviation (nv,) of the change from frame to frame, the mean motion included, of the captured clips that
    no tracker is measured on; kept in the folder."""
    kept = folder / "noise.npy"
    if not kept.is_file():
        files = {f.stem: f for f in captured_files(data)}
        squares, count = np.zeros(body.nv), 0
        for name in unseen_by(data, list(files)):
            q, good = motion(body, "human34", files[name], folder)
            for a in np.flatnonzero(good[:-1] & good[1:]):
                squares += np.square(body.difference(q[a], q[a + 1]))
                count += 1
        tell(f"noise learned from {count} changes")
        np.save(kept, np.sqrt(squares / max(count, 1)))
    return np.asarray(np.load(kept))
