"""Two chains that share points which are independent of each other: `exchange.messages` and `kalman.PointChain.update`
for many single features at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.inference.chains.evidence import EvidenceSettings
from estimator.inference.chains.exchange import GATED, PRINTED, WHICH

_LOG_2PI = float(np.log(2.0 * np.pi))


class Normals(NamedTuple):
    """Normal densities of points: mean (..., 2) [px], covariance (..., 2, 2) [px^2]; a mean that is NaN for none."""

    mean: np.ndarray
    covariance: np.ndarray


class PointMessages(NamedTuple):
    """Message to the chain of each of M points: K kernels with log_weight (M, K), known (M, K) bool, whether a kernel
    is informative, and its mean and covariance."""

    log_weight: np.ndarray
    known: np.ndarray
    kernels: Normals


def messages_each(
    detected: Normals, suits: np.ndarray, other: Normals, settings: EvidenceSettings, exchange: str
) -> PointMessages:
    """Message about each of M points to the second of two chains (see `exchange.messages`).

    detected: possible detections of a point (M, A), with suits (M, A), 0 for none. other (M): the first chain's
    prediction. The kernels are those of the detections, then that of none.
    """
    count = len(suits)
    seen = suits > 0.0
    with np.errstate(divide="ignore"):
        of_detections = np.log(settings.detected * suits) - np.log(settings.clutter * 1e-6)
    of_none = np.full((count, 1), np.log1p(-settings.detected))
    mean = np.concatenate([np.where(seen[..., None], detected.mean, 0.0), np.zeros((count, 1, 2))], axis=1)
    covariance = np.concatenate([detected.covariance, np.tile(np.eye(2), (count, 1, 1, 1))], axis=1)
    known = np.concatenate([seen, np.zeros((count, 1), dtype=bool)], axis=1)
    said = np.isfinite(other.mean).all(axis=1) & (exchange in (GATED, PRINTED, WHICH))
    m, C = np.where(said[:, None], other.mean, 0.0)[:, None], np.where(said[:, None, None], other.covariance, np.eye(2))
    fits = _log_normal(mean[:, :-1] - m, covariance[:, :-1] + C[:, None])
    of_detections = of_detections + np.where(said[:, None], fits, 0.0)
    if exchange in (GATED, PRINTED):
        both = _product(Normals(mean[:, :-1], covariance[:, :-1]), Normals(m, C[:, None]))
        mean[:, :-1] = np.where(said[:, None, None], both.mean, mean[:, :-1])
        covariance[:, :-1] = np.where(said[:, None, None, None], both.covariance, covariance[:, :-1])
    if exchange == PRINTED:
        mean[said, -1], covariance[said, -1], known[said, -1] = m[said, 0], C[said], True
    else:  # as high as it is on average, see `exchange`
        of_none[said, 0] -= 0.5 * np.linalg.slogdet(4.0 * np.pi * C[said])[1]
    return PointMessages(np.concatenate([of_detections, of_none], axis=1), known, Normals(mean, covariance))


def updated_each(mean: np.ndarray, covariance: np.ndarray, received: PointMessages) -> tuple[np.ndarray, np.ndarray]:
    """Means (M, 4) and covariances (M, 4, 4) of points after what they received, mixtures as one normal density."""
    S = covariance[:, None, :2, :2] + received.kernels.covariance
    off = received.kernels.mean - mean[:, None, :2]
    gain = np.swapaxes(np.linalg.solve(S, np.broadcast_to(covariance[:, None, :2], (*S.shape[:2], 2, 4))), 2, 3)
    gain = np.where(received.known[..., None, None], gain, 0.0)
    log_weight = received.log_weight + np.where(received.known, _log_normal(off, S), 0.0)
    share = np.exp(log_weight - np.logaddexp.reduce(log_weight, axis=1, keepdims=True))
    means = mean[:, None] + np.einsum("mkij,mkj->mki", gain, off)
    covariances = covariance[:, None] - gain @ covariance[:, None, :2]
    middle = np.einsum("mk,mki->mi", share, means)
    apart = means - middle[:, None]
    spread = np.einsum("mk,mki,mkj->mij", share, apart, apart)
    after = np.einsum("mk,mkij->mij", share, covariances) + spread
    return middle, 0.5 * (after + np.swapaxes(after, 1, 2))


def _product(a: Normals, b: Normals) -> Normals:
    """The normal density that two are proportional to when multiplied."""
    gain = np.swapaxes(np.linalg.solve(a.covariance + b.covariance, a.covariance), -1, -2)
    mean = a.mean + np.einsum("...ij,...j->...i", gain, b.mean - a.mean)
    covariance = a.covariance - gain @ a.covariance
    return Normals(mean, 0.5 * (covariance + np.swapaxes(covariance, -1, -2)))


def _log_normal(off: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Logarithms (...) of normal densities at offsets (..., 2)."""
    square = np.einsum("...i,...i->...", off, np.linalg.solve(covariance, off[..., None])[..., 0])
    return np.asarray(-0.5 * (square + np.linalg.slogdet(covariance)[1]) - _LOG_2PI)
