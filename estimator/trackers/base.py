"""What every tracker is: `init` makes a state, `step` carries it to the next frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from estimator.imaging.observation import Observation
from estimator.inference.particles import Particles
from estimator.modes.mixture import Mixture, Mode
from estimator.modes.origin import Origins
from estimator.optimise.solution import ITERATIONS
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult
from humanoid.kinematics.body import Body

MIN_KEYPOINTS = 4  # fewer say nothing worth a search
FAR = 3.0  # standard deviations beyond which a keypoint is not explained
NUMBERS = ("energy", "kkt_residual", "penetration")


@dataclass(frozen=True)
class TrackState:
    """State carried between frames: the mixture and the time [s] it belongs to; of a particle filter its particles.

    unobserved: seconds since the last frame that was searched, in which the hypotheses were only carried.
    """

    mixture: Mixture
    time: float
    particles: Particles | None = None
    unobserved: float = 0.0

    def arrays(self) -> dict[str, np.ndarray]:
        """All that the next frame needs as plain arrays, exact to the last bit; `from_arrays` is the inverse."""
        modes = self.mixture.modes
        return {
            "time": np.array(self.time),
            "unobserved": np.array(self.unobserved),
            "log_scores": self.mixture.log_scores,
            "weights": self.mixture.weights,
            "q": np.array([m.q for m in modes]),
            "covariance": np.array([m.covariance for m in modes]),
            "velocity": np.array([m.velocity for m in modes]),
            "parent": np.array([m.parent for m in modes]),
            "status": np.array([m.status for m in modes], dtype=np.str_),
            "association": np.array([m.association for m in modes], dtype=np.str_),
            **{name: np.array([getattr(m, name) for m in modes]) for name in NUMBERS},
            **({} if self.particles is None else self.particles.arrays()),
        }

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> TrackState:
        """Rebuild a state from `arrays`."""
        modes = tuple(
            Mode(
                q=arrays["q"][k],
                covariance=arrays["covariance"][k],
                velocity=arrays["velocity"][k],
                status=str(arrays["status"][k]),
                parent=int(arrays["parent"][k]),
                association=str(arrays["association"][k]),
                energy=float(arrays["energy"][k]),
                kkt_residual=float(arrays["kkt_residual"][k]),
                penetration=float(arrays["penetration"][k]),
            )
            for k in range(len(arrays["weights"]))
        )
        mixture = Mixture(modes, arrays["weights"], arrays["log_scores"])
        unobserved = float(arrays.get("unobserved", 0.0))  # states stored before leaps were looked for have none
        return TrackState(mixture, float(arrays["time"]), Particles.from_arrays(arrays), unobserved)


class Tracker(Protocol):
    """The family of trackers. Equal random generators give equal tracks; a hard frame is flagged, never raised."""

    body: Body
    search: ModeSearch

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[TrackState, FrameResult]:
        """First state, from a frame with keypoints and no manual pose."""
        ...

    def step(
        self, rng: np.random.Generator, state: TrackState, observation: Observation
    ) -> tuple[TrackState, FrameResult]:
        """Carry the state to a later frame."""
        ...


def startable(observation: Observation) -> bool:
    """Whether a frame has enough keypoints for a first pose."""
    return observation.count >= MIN_KEYPOINTS


def observable(observation: Observation) -> bool:
    """Whether a frame has enough to be searched: keypoints, or pictures."""
    return startable(observation) or bool(observation.cues)


def carried(search: ModeSearch, state: TrackState, observation: Observation) -> tuple[TrackState, FrameResult]:
    """An unobserved frame: the hypotheses stay where they are and their uncertainty grows by the diffusion."""
    growth = np.diag(np.square(search.model.transition_std(observation.time - state.time)))
    modes = tuple(
        replace(m, covariance=m.covariance + growth, parent=k, origin=None) for k, m in enumerate(state.mixture.modes)
    )
    mixture = replace(state.mixture, modes=modes)
    unobserved = state.unobserved + observation.time - state.time
    after = TrackState(mixture, observation.time, unobserved=unobserved)
    return after, result_of(observation, mixture, "unobserved")


def judged(search: ModeSearch, observation: Observation, mixture: Mixture) -> tuple[TrackState, FrameResult]:
    """State and result of a searched frame; "hard" where the best mode leaves half of the keypoints unexplained,
    did not converge in its budget or overlaps itself."""
    best = mixture.modes[0]
    posed = search.body.at(best.q)
    distances = search.term(observation, best.association).distances(posed)
    seen = distances[~np.isnan(distances)]
    likelihood = search.model.likelihood(observation, posed)
    agreement = [float(np.mean(seen < FAR))] if seen.size else []
    agreement += [] if likelihood is None else likelihood.agreement(posed)
    overlapping = best.penetration > search.settings.contact.limit
    hard = min(agreement, default=0.0) < 0.5 or best.status == ITERATIONS or overlapping
    return TrackState(mixture, observation.time), result_of(observation, mixture, "hard" if hard else "tracked")


def result_of(observation: Observation, mixture: Mixture, status: str) -> FrameResult:
    """The hand-off to run files and pictures."""
    modes = mixture.modes
    return FrameResult(
        index=observation.index,
        time=observation.time,
        status=status,
        q=np.array([m.q for m in modes]),
        weight=mixture.weights,
        energy=np.array([m.energy for m in modes]),
        covariance=np.array([m.covariance for m in modes]),
        parent=np.array([m.parent for m in modes]),
        kkt_residual=np.array([m.kkt_residual for m in modes]),
        penetration=np.array([m.penetration for m in modes]),
        association=tuple(m.association for m in modes),
        velocity=np.array([m.velocity for m in modes]),
        origins=Origins.of([m.origin for m in modes], len(modes[0].q)),
    )
