"""phi(O, F), the likelihood of features by an image: detections that are of a feature, of several, or of none."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from estimator.inference.chains.feature_density import FeatureDensity, heaviest
from humanoid.support.settings import CheckedSettings, setting

_WAYS = 600  # that are considered
_CLOSER = 4  # times as many as are kept are examined more closely
_NEVER = -1e12  # score of what is impossible


@dataclass(frozen=True)
class EvidenceSettings(CheckedSettings):
    """Settings of the evidence of detections.

    detected: probability that a visible feature is detected; hidden: that a feature hidden by a limb is detected.
    clutter: false detections, per million pixels. shared: weight of a feature in a detection that is another's too, as
    a hand before the face, beside the 1 - detected of one that is missed elsewhere. inside: correlation
    time [s] of a feature's place inside such a detection, 0 where each frame measures it anew; of hands before the
    face and before each other in captured motion (`python -m benchmarks shared_places`).
    most: associations that are kept.
    Raises InputError where a value is outside its range.
    """

    detected: float = setting(0.9, above=0, below=1)
    hidden: float = setting(0.05, above=0, below=1)
    clutter: float = setting(0.5, above=0)
    shared: float = setting(1.0, at_least=0, at_most=1)
    inside: float = setting(0.3, at_least=0)
    most: int = setting(40, at_least=1)

    @property
    def if_hidden(self) -> tuple[float, float]:
        """Additional log-weight of an association for a hidden feature with a detection of its own, and for one
        without."""
        return math.log(self.hidden / self.detected), math.log((1.0 - self.hidden) / (1.0 - self.detected))


@dataclass(frozen=True, eq=False)
class Detections:
    """Detections of one image: D places in which some of the features F may be.

    names (F,). mean (D, 2) [px], covariance (D, 2, 2) [px^2]: of the feature, if it is this detection. suits (D, F):
    probability that a detection of the feature looks like this, 0 where that is impossible. merged (D,) bool: it may
    well be of several features at once, which are then anywhere in it. together (D, 2, 2) [px^2]: covariance of a
    feature that is in it with another; None where that is the same.
    """

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    suits: np.ndarray
    merged: np.ndarray
    together: np.ndarray | None = None

    @property
    def shared(self) -> np.ndarray:
        """Covariances (D, 2, 2) [px^2] of features that share them."""
        return self.covariance if self.together is None else self.together

    def of(self, rows: np.ndarray) -> Detections:
        """Some of the detections."""
        together = None if self.together is None else self.together[rows]
        return Detections(
            self.names, self.mean[rows], self.covariance[rows], self.suits[rows], self.merged[rows], together
        )

    @staticmethod
    def none(names: tuple[str, ...]) -> Detections:
        """An image in which nothing was detected."""
        return Detections(names, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, len(names))), np.zeros(0, bool))


@dataclass(frozen=True, eq=False)
class Evidence:
    """phi(O, F) = sum_a w_a prod_f phi_a(F_f), over associations a.

    density: a kernel for each association, over the features that have a detection in it. detection (K, F): the number
    of each feature's, -1 where it has none.
    """

    density: FeatureDensity
    detection: np.ndarray


def evidence_of(detections: Detections, settings: EvidenceSettings, prior: FeatureDensity | None = None) -> Evidence:
    """All ways in which detections may be those of features, the likeliest `settings.most` of them.

    A detection is of one feature, of none, or of several. The first feature that has it weighs detected * suits /
    clutter times the normal density of the detection about it, one that has none 1 - detected: what is not explained by
    a feature is clutter (joint probabilistic data association, Fortmann et al. 1983). Each further one in the same
    detection weighs `shared`, or 1 in one that is merged, in its middle, and falls off as its density does.

    prior: what is expected of the features. It decides which associations are kept, and is in none of the weights.
    Where there are more than some hundreds, the unlikeliest pairs of a feature and a detection are in none.
    """
    pairs = _Pairs.of(detections, settings, prior)
    able = _candidates(pairs)
    ways = np.array(list(_associations(detections, able, settings.shared)), dtype=np.int64)
    ways = ways.reshape(-1, len(detections.names))
    log_weight, roughly = pairs.summed(ways)
    likely = np.isfinite(log_weight)
    if prior is not None and likely.sum() > _CLOSER * settings.most:
        # features are only combined where each of them alone is possible
        likely[np.argsort(-roughly, kind="stable")[_CLOSER * settings.most :]] = False
    ways, log_weight = ways[likely], log_weight[likely]
    density = _density(detections, ways, log_weight)
    if len(ways) > settings.most:
        most = settings.most
        kept = heaviest(log_weight, most) if prior is None else density.likeliest(prior.over(density.names), most)
        ways, density = ways[kept], _density(detections, ways[kept], log_weight[kept])
    return Evidence(density, ways)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Log-weights (F, D + 1) of a feature and a detection together, the last for none; -inf where impossible. first:
    where no feature before has the same detection, second: where another has. expected: of the detection under the
    prediction of the feature, 0 without one."""

    first: np.ndarray
    second: np.ndarray
    expected: np.ndarray

    @staticmethod
    def of(detections: Detections, settings: EvidenceSettings, prior: FeatureDensity | None) -> _Pairs:
        size, count = len(detections.names), len(detections.mean)
        first, second = np.full((2, size, count + 1), np.log1p(-settings.detected))
        with np.errstate(divide="ignore"):
            first[:, :-1] = np.log(settings.detected * detections.suits.T) - np.log(settings.clutter * 1e-6)
        for d in range(count):
            # what another hides makes no detection of its own: it is somewhere in that one, a density without clutter
            share = 1.0 if detections.merged[d] else settings.shared
            second[:, d] = np.log(max(share, 1e-300)) + _log_area(detections.shared[d])
        expected = np.zeros_like(first)
        if prior is not None:
            expected[:, :-1] = _expected(detections, prior.over(detections.names).collapsed())
        return _Pairs(first, second, expected)

    def summed(self, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log-weights (K,) of ways (K, F), and those with the prediction of each feature alone."""
        feature = np.arange(ways.shape[1])
        before = np.tri(ways.shape[1], k=-1, dtype=bool)
        again = (((ways[:, :, None] == ways[:, None, :]) & before).any(axis=2)) & (ways >= 0)
        each = np.where(again, self.second[feature, ways], self.first[feature, ways])
        log_weight = each.sum(axis=1)
        return log_weight, log_weight + self.expected[feature, ways].sum(axis=1)


def _expected(detections: Detections, prior: FeatureDensity) -> np.ndarray:
    """Logarithms (F, D) of the densities of detections by what one kernel expects of each feature."""
    out = np.zeros((len(prior.names), len(detections.mean)))
    for f in np.flatnonzero(prior.known[0]):
        own = slice(2 * f, 2 * f + 2)
        S = prior.covariance[0][own, own] + detections.covariance
        off = detections.mean - prior.mean[0, f]
        square = np.einsum("di,di->d", off, np.linalg.solve(S, off[..., None])[..., 0])
        out[f] = -0.5 * (square + np.linalg.slogdet(2.0 * np.pi * S)[1])
    return out


def _candidates(pairs: _Pairs) -> list[list[int]]:
    """For every feature the detections that may be its, -1 for none, in order; of all of them, limited to at most
    `_WAYS` ways to choose, the likeliest beside those of the likeliest exclusive way, which stays."""
    count = pairs.first.shape[1] - 1
    score = pairs.first + pairs.expected
    able = [[d for d in range(-1, count) if np.isfinite(row[d])] for row in pairs.first]
    if math.prod(len(each) for each in able) <= _WAYS:
        return able
    best = _likeliest(score)
    gain = [(score[f, d] - score[f, best[f]], f, d) for f, each in enumerate(able) for d in each if d != best[f]]
    for _, f, d in sorted(gain):
        if math.prod(len(each) for each in able) <= _WAYS:
            break
        able[f].remove(d)
    return able


def _likeliest(score: np.ndarray) -> np.ndarray:
    """The detection (F,) of each feature, -1 for none, no two features with the same, that has the largest sum of
    scores (F, D + 1), the last for none."""
    size, count = len(score), score.shape[1] - 1
    value = np.full((size, count + size), -np.inf)
    value[:, :count] = score[:, :-1]
    value[np.arange(size), count + np.arange(size)] = score[:, -1]
    _, chosen = linear_sum_assignment(np.maximum(value, _NEVER), maximize=True)
    return np.where(chosen < count, chosen, -1)


def _associations(detections: Detections, able: list[list[int]], shared: float) -> Iterator[tuple[int, ...]]:
    """The number of every feature's detection, of those that it is able to have; several share one only
    where that is possible."""
    size = len(detections.names)

    def extended(way: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        if len(way) == size:
            yield way
            return
        for d in able[len(way)]:
            if d < 0 or d not in way or shared > 0.0 or detections.merged[d]:
                yield from extended((*way, d))

    yield from extended(())


def _log_area(covariance: np.ndarray) -> float:
    """Logarithm of the area [px^2] of a detection: a normal density times it is 1 in the middle."""
    return float(np.log(2.0 * np.pi) + 0.5 * np.linalg.slogdet(covariance)[1])


def _density(detections: Detections, ways: np.ndarray, log_weight: np.ndarray) -> FeatureDensity:
    size = len(detections.names)
    known = ways >= 0
    mean = np.zeros((len(ways), size, 2))
    mean[known] = detections.mean[ways[known]]
    covariance = np.tile(np.eye(2 * size), (len(ways), 1, 1))
    sharers = np.where(known, (ways[:, :, None] == ways[:, None, :]).sum(axis=2), 0)
    for k, f in np.argwhere(known):
        own = detections.covariance if sharers[k, f] == 1 else detections.shared
        covariance[k, 2 * f : 2 * f + 2, 2 * f : 2 * f + 2] = own[ways[k, f]]
    return FeatureDensity(detections.names, log_weight, known, mean, covariance, sharers)
