"""Shared code of trackers with a mixture of modes: their state, and frames that are searched or only predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.formats.checked_arrays import (
    DamageError,
    Field,
    check_arrays,
    check_configurations,
    check_covariances,
    check_parents,
    check_weights,
    length_of,
    sizes_of,
)
from estimator.data.observation import Observation
from estimator.energy.descent.solution import StepCounts
from estimator.energy.point_targets import marker_distances
from estimator.inference.mixture import MODE_FIELDS, Mixture, mode_arrays, modes_of
from estimator.inference.origin import Family, Origins
from estimator.numerics.newton import ITERATIONS
from estimator.search.mode_search import ModeSearch
from estimator.trackers.frame_result import FrameResult
from humanoid.kinematics.body import Body

FAR = 3.0  # standard deviations beyond which a keypoint is not explained
ENOUGH = 0.5  # of `agreement`; with less a frame is hard
_FIELDS = {
    "time": Field("f"),
    "log_scores": Field("f", ("K",), finite=False),
    "weights": Field("f", ("K",)),
    **MODE_FIELDS,
}


@dataclass(frozen=True)
class MixtureState:
    """A mixture and the time [s] it belongs to. unseen [s]: for how long by then nothing had been seen, for trackers
    that use it."""

    mixture: Mixture
    time: float
    unseen: float = 0.0

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {
            "time": np.array(self.time),
            "log_scores": self.mixture.log_scores,
            "weights": self.mixture.weights,
            **mode_arrays(self.mixture.modes),
            **({"unseen": np.array(self.unseen)} if self.unseen else {}),
        }

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], body: Body, *, minima: bool = True) -> MixtureState:
        """Rebuild a state from `arrays`. minima: covariances are inverse Hessians; those of particles may have any
        rank. Raises DamageError for invalid arrays."""
        check_arrays(arrays, _FIELDS, {**sizes_of(body), "K": length_of(arrays, "weights")})
        check_weights(arrays["weights"], "weights")
        check_parents(arrays["parent"], None)
        check_configurations(body, arrays["q"], "q")
        if minima:
            check_covariances(arrays["covariance"])
        unseen = float(arrays.get("unseen", 0.0))
        if not 0.0 <= unseen < np.inf:
            raise DamageError(f"unseen for {unseen:g} s")
        mixture = Mixture(modes_of(arrays), arrays["weights"], arrays["log_scores"])
        return MixtureState(mixture, float(arrays["time"]), unseen)


class CarriesMixture:
    """Base of trackers whose state is a `MixtureState` (see `estimator.trackers.base.TrackerProtocol`)."""

    body: Body

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> MixtureState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return MixtureState.from_arrays(arrays, self.body)


def predict_unobserved(
    search: ModeSearch, before: Mixture, elapsed: float, observation: Observation
) -> tuple[MixtureState, FrameResult]:
    """An unobserved frame, `elapsed` [s] after the one before: the hypotheses stay where they are and their uncertainty
    grows by the diffusion."""
    growth = np.diag(np.square(search.model.transition_std(elapsed)))
    modes = tuple(
        replace(m, covariance=m.covariance + growth, parent=k, origin=None) for k, m in enumerate(before.modes)
    )
    mixture = replace(before, modes=modes)
    return MixtureState(mixture, observation.time), result_of(observation, mixture, "unobserved")


def agreement(search: ModeSearch, observation: Observation, q: np.ndarray, association: str) -> float:
    """The least share of the keypoints in an association (its name), of the markers, or of what a cue sees in some
    camera, that is explained by a pose q (nq,); 0 where nothing is seen."""
    posed = search.body.at(q)
    distances = search.term(observation, association).distances(posed) if observation.count else np.zeros(0)
    seen = distances[~np.isnan(distances)]
    shares = [float(np.mean(seen < FAR))] if seen.size else []
    off = marker_distances(posed, search.body, observation, search.model.settings.markers)
    shares += [float(np.mean(off < FAR))] if off.size else []
    return min([*shares, *search.model.likelihood(observation, posed).agreement(posed)], default=0.0)


def classify_frame(
    search: ModeSearch,
    observation: Observation,
    mixture: Mixture,
    extra: Mapping[str, np.ndarray] | None = None,
    *,
    explained: float | None = None,
) -> tuple[MixtureState, FrameResult]:
    """State and result of a searched frame; "hard" where the best mode leaves half of the keypoints unexplained,
    did not converge in its budget or overlaps itself. extra: see `FrameResult`. explained: the best mode's `agreement`,
    where it is known."""
    best = mixture.modes[0]
    overlapping = best.penetration > search.settings.contact.limit
    if explained is None:
        explained = agreement(search, observation, best.q, best.association)
    hard = explained < ENOUGH or best.status == ITERATIONS or overlapping
    result = result_of(observation, mixture, "hard" if hard else "tracked", extra)
    return MixtureState(mixture, observation.time), result


def result_of(
    observation: Observation, mixture: Mixture, status: str, extra: Mapping[str, np.ndarray] | None = None
) -> FrameResult:
    """The hand-off to run files and pictures."""
    origins = Origins.of([m.origin for m in mixture.modes], len(mixture.modes[0].q))
    arrays = {"weight": mixture.weights, **mode_arrays(mixture.modes)}
    return FrameResult.of(observation.index, observation.time, status, arrays, origins, extra)


def search_counts(families: Mapping[Family, int], steps: StepCounts) -> dict[str, np.ndarray]:
    """Extra arrays `searches` and `searches_FAMILY`: how many hypotheses a frame was searched from, in all and of each
    family (see `Origin`); `steps_free`, `steps_active_set`, `steps_proxqp`, `steps_failed`: how many steps of all its
    searches were solved by whom (see `StepCounts`)."""
    counts = {"searches": sum(families.values())}
    counts |= {f"searches_{family.replace(' ', '_')}": count for family, count in families.items()}
    counts |= {f"steps_{solver}": count for solver, count in steps._asdict().items()}
    return {name: np.array(count) for name, count in counts.items()}
