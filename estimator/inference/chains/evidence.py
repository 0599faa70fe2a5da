"""phi(O, F), what an image says of features: detections that are of a feature, of two, or of nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimator.inference.chains.feature_density import FeatureDensity
from humanoid.support.settings import check, setting


@dataclass(frozen=True)
class EvidenceSettings:
    """How detections become evidence.

    detected: probability that a feature that can be seen is detected. clutter: false detections, per million pixels.
    shared: weight of a feature in a detection that is another's too, as a hand before the face, beside the 1 - detected
    of one that is missed elsewhere. most: associations that are kept.
    Raises InputError where a value cannot be.
    """

    detected: float = setting(0.9, above=0, below=1)
    clutter: float = setting(0.5, above=0)
    shared: float = setting(0.3, at_least=0, at_most=1)
    most: int = setting(40, at_least=1)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, eq=False)
class Detections:
    """Of one image: D places in which some of the features F may be.

    names (F,). mean (D, 2) [px], covariance (D, 2, 2) [px^2]: of the feature, if it is this detection. suits (D, F):
    probability that a detection of the feature looks like this, 0 where it cannot be. merged (D,) bool: it may well be
    of several features at once, which are then anywhere in it.
    """

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    suits: np.ndarray
    merged: np.ndarray

    @staticmethod
    def none(names: tuple[str, ...]) -> Detections:
        """An image in which nothing was detected."""
        return Detections(names, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, len(names))), np.zeros(0, bool))


@dataclass(frozen=True, eq=False)
class Evidence:
    """phi(O, F) = sum_a w_a prod_f phi_a(F_f), over associations a.

    density: a kernel for each association, which knows the features that have a detection in it. detection (K, F): the
    number of each feature's, -1 where it has none.
    """

    density: FeatureDensity
    detection: np.ndarray


def evidence_of(detections: Detections, settings: EvidenceSettings, prior: FeatureDensity | None = None) -> Evidence:
    """All ways in which detections may be those of features, the likeliest `settings.most` of them.

    A detection is of one feature, of none, or of two. The first feature that has it weighs detected * suits / clutter
    times the normal density of the detection about it, one that has none 1 - detected: what is not explained by a
    feature is clutter (joint probabilistic data association, Fortmann et al. 1983). A second one in the same detection
    weighs `shared`, or 1 in one that is merged, in its middle, and falls off as its density does.

    prior: what is expected of the features. It decides which associations are kept, and is in none of the weights.
    """
    ways = np.array(list(_associations(detections, settings.shared)), dtype=np.int64).reshape(-1, len(detections.names))
    log_weight = np.array([_log_weight(detections, settings, way) for way in ways])
    ways, log_weight = ways[np.isfinite(log_weight)], log_weight[np.isfinite(log_weight)]
    density = _density(detections, ways, log_weight)
    if len(ways) > settings.most:
        score = log_weight if prior is None else _agreement(density, prior)
        kept = np.sort(np.argsort(-score, kind="stable")[: settings.most])
        ways, density = ways[kept], _density(detections, ways[kept], log_weight[kept])
    return Evidence(density, ways)


def _associations(detections: Detections, shared: float) -> Iterator[tuple[int, ...]]:
    """The number of every feature's detection, -1 for none; at most two features have the same one."""
    size = len(detections.names)
    able = [np.flatnonzero(detections.suits[:, f] > 0.0).tolist() for f in range(size)]

    def extended(way: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        if len(way) == size:
            yield way
            return
        for d in (-1, *able[len(way)]):
            taken = way.count(d)
            if d < 0 or taken == 0 or (taken == 1 and (shared > 0.0 or detections.merged[d])):
                yield from extended((*way, d))

    yield from extended(())


def _log_weight(detections: Detections, settings: EvidenceSettings, way: np.ndarray) -> float:
    clutter = settings.clutter * 1e-6
    total = 0.0
    for f, d in enumerate(way):
        if d < 0:
            total += np.log1p(-settings.detected)
        elif d in way[:f]:
            # what another hides makes no detection of its own: it is somewhere in that one, a density without clutter
            share = 1.0 if detections.merged[d] else settings.shared
            total += np.log(max(share, 1e-300)) + _log_area(detections.covariance[d])
        else:
            total += np.log(settings.detected * detections.suits[d, f]) - np.log(clutter)
    return float(total)


def _log_area(covariance: np.ndarray) -> float:
    """Logarithm of the area [px^2] of a detection: a normal density times it is 1 in the middle."""
    return float(np.log(2.0 * np.pi) + 0.5 * np.linalg.slogdet(covariance)[1])


def _density(detections: Detections, ways: np.ndarray, log_weight: np.ndarray) -> FeatureDensity:
    size = len(detections.names)
    known = ways >= 0
    mean = np.zeros((len(ways), size, 2))
    mean[known] = detections.mean[ways[known]]
    covariance = np.tile(np.eye(2 * size), (len(ways), 1, 1))
    for k, f in np.argwhere(known):
        covariance[k, 2 * f : 2 * f + 2, 2 * f : 2 * f + 2] = detections.covariance[ways[k, f]]
    return FeatureDensity(detections.names, log_weight, known, mean, covariance)


def _agreement(density: FeatureDensity, prior: FeatureDensity) -> np.ndarray:
    """Logarithms (K,) of the mass of each kernel under what was expected."""
    expected = prior.over(density.names).collapsed()
    return density.times(expected).log_weight
