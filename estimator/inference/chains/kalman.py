"""Points of an image by a robust Kalman filter: each continues with its velocity, which fades."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.inference.chains.exchange import Message
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.inference.chains.repeated import covariance_of_news
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class PointSettings(CheckedSettings):
    """Settings of the motion of points.

    Defaults are those of wrists, in a picture, of 97 captured motions (`docs/papers/dual-chain.md`).

    keep: share of its velocity that a point keeps in a second. noise: standard deviation of the random acceleration, as
    a change of velocity in one second, in sizes of the person per second. speed: of velocities at first, in sizes per
    second. loose: largest standard deviation [sizes] of a lost point. mistaken: probability that two points which look
    alike have been confused.
    Raises InputError where a value is outside its range.
    """

    keep: float = setting(0.02, at_least=0, at_most=1)
    noise: float = setting(4.5, above=0)
    speed: float = setting(1.0, above=0)
    loose: float = setting(1.0, above=0)
    mistaken: float = setting(0.1, at_least=0, below=0.5)
    lost: float = setting(0.03, at_least=0, below=0.5)


@dataclass(frozen=True, eq=False)
class PointStates:
    """State of the points: mean (F, 4) x, y [px] and velocities [px/s], covariance (4F, 4F)."""

    mean: np.ndarray
    covariance: np.ndarray

    def arrays(self) -> dict[str, np.ndarray]:
        """As plain arrays; `from_arrays` is the inverse."""
        return {"point_mean": self.mean, "point_covariance": self.covariance}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> PointStates:
        """The states in `arrays`, which may include others."""
        return PointStates(arrays["point_mean"], arrays["point_covariance"])


@dataclass(frozen=True, eq=False)
class PointChain:
    """A chain of points with decaying velocities, each with noise of its own.

    names (F,). size [px]: the person's in the image, by which noise is measured. settings. alike: pairs of points, by
    number, that detections do not distinguish, such as both hands. Their prediction includes that one is where the
    other was believed to be, or somewhere else altogether. Otherwise a chain that confused them as they met, or one of
    them with a part of the face, would stay sure of it, and no other chain could correct it.

    An update is by a mixture: every association moves the points by Kalman's rule, and the result is one normal density
    with their mean and covariance. So clutter moves points in proportion to the probability that it is one of them. A
    detection of several points, such as a hand before the face, shows of each little more than that it is inside,
    however often it is repeated (`estimator.inference.chains.repeated`); news: share of its information that is new.
    """

    names: tuple[str, ...]
    size: float
    settings: PointSettings = PointSettings()
    alike: tuple[tuple[int, int], ...] = ()
    news: float = 1.0

    def initial_state(self, mean: np.ndarray, covariance: np.ndarray) -> PointStates:
        """Points at rest, in all likelihood: mean (F, 2) [px], covariance (2F, 2F) [px^2]."""
        count = len(self.names)
        whole = np.eye(4 * count) * (self.settings.speed * self.size) ** 2
        place = self._places
        whole[np.ix_(place, place)] = covariance
        return PointStates(np.hstack([mean, np.zeros((count, 2))]), whole)

    def predict(self, state: PointStates, dt: float) -> PointStates:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        A, Q = self._motion(dt)
        count = len(self.names)
        whole, noise = np.kron(np.eye(count), A), np.kron(np.eye(count), Q)
        covariance = whole @ state.covariance @ whole.T + noise
        return PointStates((whole @ state.mean.ravel()).reshape(count, 4), self.bounded(covariance))

    def predict_each(self, mean: np.ndarray, covariance: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """`predict` of M points that are independent: means (M, 4), covariances (M, 4, 4)."""
        A, Q = self._motion(dt)
        return mean @ A.T, self.bounded(A @ covariance @ A.T + Q)

    def features(self, prior: PointStates) -> FeatureDensity:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        place, ways = self._places, self._taken_for(prior)
        return FeatureDensity(
            self.names,
            np.array([log_weight for log_weight, _ in ways]),
            np.ones((len(ways), len(self.names)), dtype=bool),
            np.array([points.mean[:, :2] for _, points in ways]),
            np.array([points.covariance[np.ix_(place, place)] for _, points in ways]),
        )

    def update(self, prior: PointStates, message: Message) -> tuple[PointStates, float]:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        received = message.evidence.over(self.names)
        means, covariances, log_weights = [], [], []
        for log_share, points in self._taken_for(prior):
            for k in range(len(received.log_weight)):
                m, C, weight = self._kalman_updated(points, received, k)
                means.append(m)
                covariances.append(C)
                log_weights.append(weight + log_share)
        total = float(np.logaddexp.reduce(log_weights))
        share = np.exp(np.array(log_weights) - total)
        mean = np.einsum("k,ki->i", share, np.array(means))
        off = np.array(means) - mean
        covariance = np.einsum("k,kij->ij", share, np.array(covariances)) + (share[:, None] * off).T @ off
        return PointStates(mean.reshape(-1, 4), self.bounded(covariance)), total

    def _taken_for(self, prior: PointStates) -> list[tuple[float, PointStates]]:
        """Predictions with their log-probabilities: unchanged, with each pair of similar points exchanged, and with
        each of them anywhere."""
        mistaken, lost, pairs = self.settings.mistaken, self.settings.lost, len(self.alike)
        ways = [(prior, 1.0 - mistaken - lost if pairs else 1.0)]
        ways += [(_exchanged(prior, a, b), mistaken / pairs) for a, b in self.alike]
        ways += [(self._anywhere(prior, k), lost / (2 * pairs)) for pair in self.alike for k in pair]
        return [(float(np.log(share)), points) for points, share in ways if share > 0.0]

    def _anywhere(self, prior: PointStates, k: int) -> PointStates:
        """The states with one point maximally uncertain, independent of the others."""
        own = slice(4 * k, 4 * k + 4)
        covariance = prior.covariance.copy()
        covariance[own], covariance[:, own] = 0.0, 0.0
        s = self.settings
        covariance[own, own] = self.size**2 * np.diag([s.loose**2, s.loose**2, s.speed**2, s.speed**2])
        return PointStates(prior.mean, covariance)

    def _kalman_updated(
        self, prior: PointStates, received: FeatureDensity, k: int
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Mean (4F,), covariance and log weight after one kernel of a message."""
        mean, C = prior.mean.ravel(), prior.covariance
        dims = received.dims(k)
        if not len(dims):
            return mean, C, float(received.log_weight[k])
        places, own = self._places, np.ix_(dims, dims)
        place, prior_places = places[dims], C[np.ix_(places, places)]
        off, known = received.mean[k].ravel()[dims] - mean[place], prior_places[own]
        S = known + received.covariance[k][own]
        news = covariance_of_news(received, k, prior_places, self.news)
        gain = np.linalg.solve(known + news[own], C[place]).T
        weight = received.log_weight[k] - 0.5 * (off @ np.linalg.solve(S, off) + np.linalg.slogdet(2.0 * np.pi * S)[1])
        return mean + gain @ off, C - gain @ C[place], float(weight)

    @property
    def _places(self) -> np.ndarray:
        """Indices of the positions in the state, (2F,)."""
        return np.flatnonzero(np.tile([True, True, False, False], len(self.names)))

    def _motion(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Transition (4, 4) and noise (4, 4) of one point in `dt` [s]: velocity decays as exp(-rate t), driven by white
        noise (the integrated Ornstein-Uhlenbeck process)."""
        rate = -np.log(np.clip(self.settings.keep, 1e-12, 1.0 - 1e-9))
        fade = np.exp(-rate * dt)
        moved = (1.0 - fade) / rate
        power = (self.settings.noise * self.size) ** 2
        vv = power * (1.0 - fade**2) / (2.0 * rate)
        xv = power * (1.0 - fade) ** 2 / (2.0 * rate**2)
        # by its series where the closed form cancels
        small = rate * dt < 1e-2
        xx = power * (dt**3 / 3.0 - rate * dt**4 / 4.0) if small else power / rate**2 * (
            dt - 2.0 * moved + (1.0 - fade**2) / (2.0 * rate)
        )  # fmt: skip
        eye = np.eye(2)
        A = np.block([[eye, moved * eye], [0.0 * eye, fade * eye]])
        return A, np.block([[xx * eye, xv * eye], [xv * eye, vv * eye]])

    def bounded(self, covariance: np.ndarray) -> np.ndarray:
        """Covariances (..., 4P, 4P) of P points, symmetric, and no position less certain than `loose`: a point that was
        lost for long is still somewhere near."""
        covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
        most = (self.settings.loose * self.size) ** 2
        place = np.tile([True, True, False, False], covariance.shape[-1] // 4)
        variance = np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 1e-300)
        scale = np.where(place, np.minimum(1.0, np.sqrt(most / variance)), 1.0)
        return np.asarray(covariance * scale[..., :, None] * scale[..., None, :])


def _exchanged(points: PointStates, a: int, b: int) -> PointStates:
    """The states with two points exchanged."""
    order = np.arange(len(points.mean))
    order[[a, b]] = b, a
    entries = (4 * order[:, None] + np.arange(4)).ravel()
    return PointStates(points.mean[order], points.covariance[np.ix_(entries, entries)])
