"""Modes of one frame's likelihood, found without the past, and weighted by the past's prior (ELMO section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from estimator.inference.mixture import Mixture
from humanoid.kinematics.body import Body


class Reweighted(NamedTuple):
    """log_scores (L,): of the modes, unnormalised. parent (L,) int64: the mode of the prior that contributes most to
    each, -1 for one that none explains better than a jump."""

    log_scores: np.ndarray
    parent: np.ndarray


def reweighted(
    body: Body,
    q: Sequence[np.ndarray],
    log_shares: np.ndarray,
    prior: Mixture,
    std: np.ndarray,
    jump: float = np.inf,
    covariance: Sequence[np.ndarray] | None = None,
) -> Reweighted:
    """Eq. 6: log of ŵ_i sum_j w_j N(mu_i; mu_j, C_eta), and the same without the simplification of eq. 5.

    It is the product of the likelihood, a mixture, with the prior diffused by C_eta, where C_eta is much wider than the
    modes (eq. 5): then a mode stays where it is and how wide it is, and only its weight changes. Differences are taken
    in the tangent space at the prior's modes. In logarithms, and relative to each other, the weights of modes that are
    all far from the prior do not vanish: after a gap the prior is weak, and the likelihood decides.

    q (L) of (nq,): the modes. log_shares (L,): log ŵ, height times volume, not height alone. prior: of the frame
    before. std (nv,): square root of the diagonal of C_eta, all positive. jump [nats]: no pose is less likely than one
    at a mode of the prior by more than this, however far away: the prior may be lost, and modes found again in every
    frame outweigh it in time. The paper has none. covariance (L) of (nv, nv): of the modes; with them the product is
    exact, ŵ_i sum_j w_j N(mu_i; mu_j, C_i + C_j + C_eta): a limb that a picture does not show is found anywhere, and
    eq. 6 treats what is only unknown as far from the past, and rewards its volume.
    """
    away = np.array([[body.difference(mode.q, x) for mode in prior.modes] for x in q])  # (L, K, nv)
    squares, widening = _apart(away / std, std, prior, covariance)
    with np.errstate(divide="ignore"):
        of_pair = np.log(prior.weights)[None, :] - 0.5 * squares
    parent = np.where(of_pair.max(axis=1) > -jump, of_pair.argmax(axis=1), -1)
    explained = logsumexp(of_pair - widening, axis=1)
    return Reweighted(log_shares + np.logaddexp(explained, -jump - widening.min(axis=1)), parent)


def _apart(
    away: np.ndarray, std: np.ndarray, prior: Mixture, covariance: Sequence[np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances of modes from those of the prior, and the decrease of their Gaussians' peaks for being wider
    than C_eta [nats], both (L, K), from differences (L, K, nv) in units of `std`."""
    if covariance is None:
        return np.square(away).sum(axis=-1), np.zeros(away.shape[:2])
    unit = np.outer(std, std)
    own, before = np.array(covariance) / unit, np.array([mode.covariance for mode in prior.modes]) / unit
    L = np.linalg.cholesky(own[:, None] + before[None, :] + np.eye(len(std)))
    white = np.linalg.solve(L, away[..., None])[..., 0]
    return np.square(white).sum(axis=-1), np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum(axis=-1)


def diffusion_std(speed: np.ndarray, seconds: float, floor: np.ndarray) -> np.ndarray:
    """Standard deviations (nv,) of C_eta, `seconds` after the last observed frame.

    speed (nv,) [per second], floor (nv,): least change in a frame, however short: modes are found again in every frame
    and do not lie where the last one's would have moved.
    """
    return np.asarray(np.hypot(speed * seconds, floor))
