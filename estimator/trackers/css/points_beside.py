"""Any tracker of hypotheses beside a chain of keypoints, which keeps those that are hidden or missed for a while:
Taycher, Fisher and Darrell 2004, section 3, with that tracker as the chain of poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays
from estimator.data.observation import Observation
from estimator.inference.chains.evidence import EvidenceSettings
from estimator.inference.chains.exchange import APART, EXCHANGES, GATED
from estimator.inference.chains.kalman import PointChain, PointSettings
from estimator.inference.mixture import Mixture
from estimator.search.mode_search import ModeSearch
from estimator.search.point_features import PointFeatures
from estimator.trackers.base import Capabilities, State, TrackerProtocol, capabilities_of
from estimator.trackers.css.each_point import Normals, messages_each, updated_each
from estimator.trackers.frame_result import FrameResult
from humanoid.support.settings import CheckedSettings, setting

_FIELDS = {
    "keypoint_known": Field("b", ("C", "L")),
    "keypoint_mean": Field("f", ("C", "L", "4")),
    "keypoint_covariance": Field("f", ("C", "L", "4", "4")),
}
_FLOOR = 1.0  # px, of where a hypothesis has a landmark


@dataclass(frozen=True)
class BesideSettings(CheckedSettings):
    """The chain of keypoints.

    points: how they move. evidence: how keypoints are detected. exchange: the messages between the chains, see
    `estimator.inference.chains.exchange.messages`. farthest: standard deviation [sizes of the person] up to which a
    missing keypoint is replaced by the chain's estimate; 0 for never.
    Raises InputError where a value is outside its range.
    """

    points: PointSettings = field(default_factory=PointSettings)
    evidence: EvidenceSettings = field(default_factory=lambda: EvidenceSettings(shared=0.0))
    exchange: str = setting(GATED, one_of=EXCHANGES)
    farthest: float = setting(0.3, at_least=0)


class HasMixture(State, Protocol):
    """A state with hypotheses."""

    @property
    def mixture(self) -> Mixture:
        """The hypotheses."""
        ...


@dataclass(frozen=True, eq=False)
class BesideState:
    """The tracker's own state, and keypoints by camera: known (C, L) bool, mean (C, L, 4), covariance (C, L, 4, 4), see
    `Points`; unknown ones were never seen."""

    inner: Any
    known: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    @property
    def time(self) -> float:
        """See `estimator.trackers.base.State`."""
        return float(self.inner.time)

    @property
    def mixture(self) -> Mixture:
        """The hypotheses."""
        made: Mixture = self.inner.mixture
        return made

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {
            **self.inner.arrays(),
            "keypoint_known": self.known,
            "keypoint_mean": self.mean,
            "keypoint_covariance": self.covariance,
        }


class PointsBeside:
    """A tracker of hypotheses that is given missing keypoints at the places expected by the chain of keypoints, with
    the remaining uncertainty, and all others as they are.

    Each keypoint is a chain of its own, as the features are independent. It receives the detected keypoint, which may
    be wrong, and the place expected by the tracker's hypotheses (J Sigma J'). The tracker in turn receives the chain's
    prediction from before this frame, never its own output for this frame. By the default exchange a chain without a
    detection receives nothing, so that in a gap its uncertainty grows by its motion model, whatever the tracker
    estimates.
    """

    def __init__(self, inner: TrackerProtocol[Any], search: ModeSearch, settings: BesideSettings) -> None:
        self.inner, self.search, self.settings = inner, search, settings
        self.body = inner.body
        body = self.body
        on_trunk = np.full(len(body.landmark_names), -1)
        self._features = PointFeatures(body.landmark_names, body.landmark_joint, body.landmark_local, on_trunk)

    @property
    def needs_keypoints(self) -> bool:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return self.inner.needs_keypoints

    @property
    def capabilities(self) -> Capabilities:
        """The capabilities of the inner tracker, which receives keypoints that were not detected."""
        return replace(capabilities_of(self.inner), seen_as=self.seen_as)

    def can_start(self, observation: Observation) -> bool:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return self.inner.can_start(observation)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[BesideState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        inner, result = self.inner.init(rng, observation)
        cameras, marks = observation.confidence.shape
        empty = BesideState(
            inner, np.zeros((cameras, marks), dtype=bool), np.zeros((cameras, marks, 4)),
            np.tile(np.eye(4), (cameras, marks, 1, 1)),
        )  # fmt: skip
        return self._with_new_keypoints(empty, observation), result

    def step(
        self, rng: np.random.Generator, state: BesideState, observation: Observation
    ) -> tuple[BesideState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        expected = self._predicted(state, observation)
        listens = self.settings.exchange != APART and observation.is_observed
        filled = self.filled(expected, observation) if listens else observation
        inner, result = self.inner.step(rng, state.inner, filled)
        after = self._updated(state.inner, expected, observation)
        if result.extra:
            result = replace(result, extra={**result.extra, **_filled_arrays(observation, filled)})
        return self._with_new_keypoints(replace(after, inner=inner), observation), result

    def seen_as(self, observation: Observation, result: FrameResult) -> Observation:
        """See `estimator.trackers.base.Capabilities.seen_as`."""
        if "kept_std" not in result.extra:
            return observation
        return _with(observation, result.extra["kept_pixels"], result.extra["kept_std"])

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> BesideState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        inner = self.inner.state_from({name: value for name, value in arrays.items() if name not in _FIELDS})
        known = arrays.get("keypoint_known", np.zeros((0, 0)))
        sizes = {"C": len(known), "L": len(self.body.landmark_names), "4": 4}
        check_arrays(arrays, _FIELDS, sizes)
        covariance = arrays["keypoint_covariance"]
        symmetric = np.array_equal(covariance, np.swapaxes(covariance, 2, 3))
        if not symmetric or np.linalg.eigvalsh(covariance).min() <= 0.0:
            raise DamageError("keypoint_covariance is not a covariance")
        return BesideState(inner, known, arrays["keypoint_mean"], covariance)

    def filled(self, expected: BesideState, observation: Observation) -> Observation:
        """The same with missing keypoints where they are expected (all from before this frame is used)."""
        missing = expected.known & ~_detected(observation)
        spread = np.sqrt(0.5 * (expected.covariance[..., 0, 0] + expected.covariance[..., 1, 1]))
        missing &= spread <= self.settings.farthest * self._sizes(expected.mixture, observation)[:, None]
        return _with(observation, expected.mean[..., :2], np.where(missing, spread, 0.0))

    def _with_new_keypoints(self, state: BesideState, observation: Observation) -> BesideState:
        """The state with the keypoints that are seen for the first time."""
        new = _detected(observation) & ~state.known
        if not new.any():
            return state
        sigma = self.search.model.keypoint_sigma(observation)
        sizes = self._sizes(state.mixture, observation)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        for c, k in np.argwhere(new):
            began = self._chain(sizes[c]).initial_state(observation.pixels[c, k][None], sigma[c, k] ** 2 * np.eye(2))
            mean[c, k], covariance[c, k] = began.mean[0], began.covariance
        return replace(state, known=state.known | new, mean=mean, covariance=covariance)

    def _predicted(self, state: BesideState, observation: Observation) -> BesideState:
        """All keypoints, moved on to a frame."""
        sizes, dt = self._sizes(state.mixture, observation), observation.time - state.time
        mean, covariance = state.mean.copy(), state.covariance.copy()
        for c, size in enumerate(sizes):
            known = state.known[c]
            going = self._chain(size).predict_each(state.mean[c, known], state.covariance[c, known], dt)
            mean[c, known], covariance[c, known] = going
        return replace(state, mean=mean, covariance=covariance)

    def _updated(self, before: HasMixture, expected: BesideState, observation: Observation) -> BesideState:
        """The chains after the detections and the predictions by the hypotheses of the frame before."""
        sizes, s = self._sizes(before.mixture, observation), self.settings
        sigma = self.search.model.keypoint_sigma(observation)
        mean, covariance = expected.mean.copy(), expected.covariance.copy()
        std = self.search.model.transition_std(observation.time - before.time)
        for c, camera in enumerate(observation.cameras):
            known = expected.known[c]
            # sides that a detector mistakes are the tracker's own to repair; here they are far off, and clutter
            seen = _detected(observation)[c, known].astype(float)[:, None]
            detected = Normals(observation.pixels[c, known, None], sigma[c, known, None, None, None] ** 2 * np.eye(2))
            by_pose = self._by_pose(before.mixture, std, camera)
            theirs = Normals(by_pose.mean[known], by_pose.covariance[known])
            received = messages_each(detected, seen, theirs, s.evidence, s.exchange)
            after, spread = updated_each(mean[c, known], covariance[c, known], received)
            mean[c, known], covariance[c, known] = after, self._chain(sizes[c]).bounded(spread)
        return replace(expected, mean=mean, covariance=covariance)

    def _by_pose(self, mixture: Mixture, std: np.ndarray, camera: Camera) -> Normals:
        """Prediction of each landmark (L) by all hypotheses, a step of standard deviation std (nv,) later, as one
        normal density (J Sigma J'); NaN where one has it behind the camera."""
        q, weights = np.array([m.q for m in mixture.modes]), mixture.weights
        pixels, jacobian = self._features.in_image(self.body, q, camera, np.arange(self._features.count))
        sigma = np.array([m.covariance for m in mixture.modes]) + np.diag(np.square(std))
        covariance = np.einsum("klij,kjm,klnm->klin", jacobian, sigma, jacobian, optimize=True)
        mean = np.einsum("k,kli->li", weights, pixels)
        apart = pixels - mean
        spread = np.einsum("k,klij->lij", weights, covariance) + np.einsum("k,kli,klj->lij", weights, apart, apart)
        return Normals(mean, spread + _FLOOR**2 * np.eye(2))

    def _chain(self, size: float) -> PointChain:
        """Chain of a single keypoint of a person of some size in the image [px]."""
        return PointChain(("keypoint",), size, self.settings.points)

    def _sizes(self, mixture: Mixture, observation: Observation) -> np.ndarray:
        """The person's in the image of each camera, (C,) [px]."""
        return np.array([self.search.model.extent(camera, mixture.modes[0].q) for camera in observation.cameras])


def _with(observation: Observation, pixels: np.ndarray, std: np.ndarray) -> Observation:
    """The observation with keypoints at pixels (C, L, 2), of standard deviations std (C, L) [px], where these are above
    0."""
    is_filled = std > 0.0
    if not is_filled.any():
        return observation
    least = float(observation.confidence[_detected(observation)].min(initial=1.0))
    return replace(
        observation,
        pixels=np.where(is_filled[..., None], pixels, observation.pixels),
        confidence=np.where(is_filled, least, observation.confidence),
        spread=np.where(is_filled, std, 0.0),
    )


def _filled_arrays(observation: Observation, filled: Observation) -> dict[str, np.ndarray]:
    """Which keypoints of a frame were filled in, for `_with`; 0 where none was."""
    std = np.zeros(observation.confidence.shape) if filled.spread is None else filled.spread
    return {"kept_pixels": np.where((std > 0.0)[..., None], filled.pixels, 0.0), "kept_std": std}


def _detected(observation: Observation) -> np.ndarray:
    """Which keypoints there are, (C, L) bool."""
    return np.asarray(observation.confidence > 0.0) & np.isfinite(observation.pixels).all(axis=2)
