"""The posterior of the pose after a frame: a density over configurations, made of the frame's weighted modes.

Every mode gives a Gaussian in its tangent space (CSS section 4.2), cut off at the joint limits. A mode that leans on
a limit has no variance there; its density falls off from the limit exponentially, with a mean distance that is part
of the calibration (`estimator.runs.posterior`).

Calibration of a tracker's own uncertainties, fitted by `python -m benchmarks calibration --fit`, see there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular
from scipy.special import logsumexp, ndtr, ndtri

from estimator.data.cameras.camera import Camera
from estimator.energy.priors import Stabilisers
from estimator.runs.lasting_spread import camera_covariances, lasting_by_landmarks, lasting_by_places, points_on_body
from estimator.runs.marginals import Marginals
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing import Smoothed
from humanoid.kinematics.body import Body, PosedBody
from humanoid.support.errors import InputError

_LOWEST = {"scale_spread": 0.0, "size_std": 0.0, "landmark_std": 0.0, "prior_weight": 1.0}


@dataclass(frozen=True)
class PosteriorCalibration:
    """Calibration of a tracker's hypotheses to a frame's posterior.

    covariance_scale: factor on the covariances. scale_spread: the noise of a clip's keypoints is not known well, so the
    factor on standard deviations is itself log-normal with this standard deviation, which makes tails longer.
    weight_temperature: weights are taken to the power of its inverse, so more than 1 makes them more even.
    prior_weight: how many times as much as in the tracker's energy the prior on rest positions counts in the
    covariances, 1 or more: wide priors are good for finding poses, but poses are less spread than these.
    limit_lean [rad or m]: mean distance from a limit that a mode leans on. size_std: relative standard deviation of the
    body's size, which one camera does not measure. It is an uncertainty of the distance, and counts only where the
    posterior is conditioned on the camera's place. landmark_std [m]: standard deviation of a detector's bias from a
    landmark, the same in all frames, averaged over the landmarks by their spread (`landmark_spread`), for names that
    detectors of people use. No number of frames removes this uncertainty, least of all for a foot, whose keypoints are
    near each other. It is 0 for a detector without such a bias, such as a simulated one. Where the places of keypoints
    were fitted by several cameras, the uncertainty of the fit counts instead.

    Raises
    ------
    InputError: a number that is not positive (`scale_spread` and the last two may be zero), `prior_weight` below 1.
    """

    covariance_scale: float = 1.0
    scale_spread: float = 0.2
    weight_temperature: float = 8.0
    prior_weight: float = 2.0
    limit_lean: float = 0.05
    size_std: float = 0.03
    landmark_std: float = 0.025

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            low = _LOWEST.get(name, 1e-6)
            if not (np.isfinite(value) and value >= low):
                raise InputError("calibration", f"{name} is {value:g}", remedy=f"{low:g} or more")


TRAJECTORY = PosteriorCalibration(covariance_scale=1.05, scale_spread=0.3, prior_weight=1.0, landmark_std=0.04)
"""The calibration of smoothed trajectories, whose covariances count the prior once and the weights the frames by their
correlation (`estimator.tracking.smoothing.clip`); fitted like the other."""


_FAINT = 1e-3  # modes with less weight than this are left out
_NODES = np.array(np.polynomial.hermite_e.hermegauss(7)).T / (1.0, np.sqrt(2.0 * np.pi))  # of a standard normal
JITTER = 1e-12  # added to variances, so that factors exist
_OVERDRAW = 4  # samples made for each one kept


@dataclass(frozen=True)
class Posterior:
    """A density over configurations, a mixture of K components; several may share a mode.

    q (K, nq), weight (K,), covariance (K, nv, nv): the modes; covariances in the tangent space at their own mode, zero
    where they lean on a limit. lean (K, nv): where they do, the mean distance to it, with the sign of the way inside;
    zero elsewhere.
    """

    body: Body
    q: np.ndarray
    weight: np.ndarray
    covariance: np.ndarray
    lean: np.ndarray

    @staticmethod
    def of(
        body: Body,
        result: FrameResult,
        calibration: PosteriorCalibration | None = None,
        seen_by: Sequence[Camera] = (),
        *,
        size_known: bool = False,
    ) -> Posterior:
        """The posterior of a frame.

        seen_by: the cameras, for what these leave open. size_known: whether the body is as large as it is modelled,
        which one camera does not see.

        Raises
        ------
        InputError: the frame has no hypotheses.
        """
        c = calibration or PosteriorCalibration()
        if len(result.weight) == 0:
            raise InputError(f"frame {result.index}", "has no hypotheses", remedy="take a later frame")
        weight = tempered(result.weight, c.weight_temperature)
        some = weight > _FAINT
        modes = result.q[some], weight[some] / weight[some].sum(), result.covariance[some]
        return Posterior._calibrated(body, *modes, c, seen_by, size_known)

    @staticmethod
    def of_trajectory(
        body: Body,
        result: FrameResult,
        smoothed: Smoothed,
        row: int,
        calibration: PosteriorCalibration | None = None,
        seen_by: Sequence[Camera] = (),
        *,
        size_known: bool = False,
    ) -> Posterior:
        """The posterior of a frame with all frames in mind: around the smoothed trajectory's pose in this `row`, and
        around it as it would be by the frame's other modes, by as much as these differ from the mode that it goes
        through. Others as in `of`.

        Raises
        ------
        InputError: the frame has no hypotheses, or the trajectory has no covariances.
        """
        c = calibration or TRAJECTORY
        if len(result.weight) == 0 or smoothed.covariance is None:
            problem = "has no hypotheses" if len(result.weight) == 0 else "has no covariance of the smoothed trajectory"
            raise InputError(f"frame {result.index}", problem, remedy="take a later frame, or track again")
        pose, covariance = smoothed.q[row], smoothed.covariance[row]
        if smoothed.mode is None or smoothed.weight is None:
            return Posterior._calibrated(body, pose[None], np.ones(1), covariance[None], c, seen_by, size_known)
        own, weight = int(smoothed.mode[row]), tempered(smoothed.weight[row], c.weight_temperature)
        count = len(result.weight)
        some = [own, *(k for k in range(count) if k != own and weight[k] > _FAINT)]
        others = [_other(body, result, own, k, pose, covariance) for k in some[1:]]
        q, covariances = (np.array(part) for part in zip((pose, covariance), *others, strict=True))
        modes = q, weight[some] / weight[some].sum(), covariances
        return Posterior._calibrated(body, *modes, c, seen_by, size_known)

    @staticmethod
    def _calibrated(
        body: Body,
        q: np.ndarray,
        weight: np.ndarray,
        covariance: np.ndarray,
        c: PosteriorCalibration,
        seen_by: Sequence[Camera],
        size_known: bool,
    ) -> Posterior:
        """Posterior of modes q (K, nq) with weights (K,) that sum to one and covariances (K, nv, nv)."""
        posed = [body.at(mode) for mode in q]
        stabilisers = Stabilisers(body)
        priors = [_prior_precision(stabilisers, body, mode) for mode in posed]
        covariances = [_with_prior(*mode, c.prior_weight) for mode in zip(priors, covariance, strict=True)]
        covariance = c.covariance_scale * np.array(covariances)
        lasting = np.zeros_like(covariance)
        if (points := points_on_body(body, len(seen_by))) is not None:
            lasting = lasting_by_places(body, points, posed, priors, covariance)
        elif c.landmark_std > 0.0:
            lasting = lasting_by_landmarks(body, posed, priors, covariance, c.landmark_std)
        modes = zip(q, covariance, lasting, strict=True)
        lean = np.array([_leaning(body, mode, cov, c.limit_lean, own) for mode, cov, own in modes])
        covariance = covariance + _where_free(covariance, lasting)
        size_std = 0.0 if size_known else c.size_std
        covariance = covariance + camera_covariances(body, posed, priors, covariance, seen_by, size_std)
        return Posterior(body, q, weight, covariance, lean)._spread(c.scale_spread)

    def _spread(self, spread: float) -> Posterior:
        """The same with each mode several times, at scales and weights of a quadrature over the log-normal factor."""
        if spread == 0.0:
            return self
        factors = [(np.exp(spread * node), share) for node, share in _NODES]
        return Posterior(
            self.body,
            np.concatenate([self.q for _ in factors]),
            np.concatenate([share * self.weight for _, share in factors]),
            np.concatenate([f**2 * self.covariance for f, _ in factors]),
            np.concatenate([f * self.lean for f, _ in factors]),
        )

    @property
    def best(self) -> np.ndarray:
        """Configuration (nq,) of the mode with the largest weight."""
        return np.asarray(self.q[np.argmax(self.weight)])

    def marginals(self, reference: np.ndarray | None = None) -> Marginals:
        """Every degree of freedom on its own, in the tangent space at `reference` (nq,), by default the best mode.

        Values are angles [rad] and lengths [m] from the reference on; each is cut off at its own limits, and what that
        means for the others is not followed up.
        """
        body, at = self.body, self.best if reference is None else reference
        about: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}  # several components share a mode
        for mode in self.q:
            if mode.tobytes() not in about:
                carry = pin.dDifference(body.model, at, mode, pin.ARG1)
                about[mode.tobytes()] = body.difference(at, mode), carry
        mean, carry = (np.array(part) for part in zip(*(about[mode.tobytes()] for mode in self.q), strict=True))
        std = np.sqrt(np.maximum(np.sum((carry @ self.covariance) * carry, axis=2), 0.0))
        low, high = body.tangent_bounds(at)
        return Marginals(self.weight, mean.T, std.T, self.lean.T, low, high)

    def landmarks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weights (K,), means (K, L, 3) [m] and covariances (K, L, 3, 3) of every landmark in the world: a mixture of
        Gaussians, first order in the landmarks' Jacobians."""
        means, covariances = [], []
        for mode, covariance, lean in zip(self.q, self.covariance, self.lean, strict=True):
            posed = self.body.at(mode)
            J = self.body.landmark_jacobians(posed)
            full = covariance + np.diag(np.square(lean))
            means.append(self.body.landmarks(posed) + J @ lean)
            covariances.append(J @ full @ J.transpose(0, 2, 1))
        return self.weight, np.array(means), np.array(covariances)

    def landmark_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (L, 3) [m] and covariance (L, 3, 3) [m^2] of every landmark, over all modes."""
        weight, means, covariances = self.landmarks()
        mean = np.einsum("k,kli->li", weight, means)
        off = means - mean
        return mean, np.einsum("k,klij->lij", weight, covariances + off[..., :, None] * off[..., None, :])

    def landmark_credible_levels(self, rng: np.random.Generator, points: np.ndarray, count: int = 500) -> np.ndarray:
        """Credible levels (N, L) of points (N, L, 3) [m]: probability of the smallest region of each landmark's places
        that contains them, from `count` samples."""
        weight, means, covariances = self.landmarks()
        factors = np.linalg.cholesky(covariances + JITTER * np.eye(3))
        modes = rng.choice(len(weight), size=count, p=weight)
        normal = rng.normal(size=(count, *means.shape[1:]))
        drawn = means[modes] + (factors[modes] @ normal[..., None])[..., 0]
        densities = points_density(np.concatenate([points, drawn]), weight, means, factors)
        own, others = densities[: len(points)], densities[len(points) :]
        return np.array([np.mean(others > density, axis=0) for density in own])

    def log_density(self, q: np.ndarray) -> np.ndarray:
        """Log density (N,) at configurations q (N, nq) within the limits, up to what the limits cut off."""
        gaps: dict[bytes, np.ndarray] = {}
        logs = []
        for w, mode, covariance, lean in zip(self.weight, self.q, self.covariance, self.lean, strict=True):
            key = mode.tobytes()
            if key not in gaps:
                gaps[key] = np.array([self.body.difference(mode, pose) for pose in q])
            logs.append(np.log(w) + log_around_mode(gaps[key], covariance, lean))
        return np.asarray(logsumexp(np.array(logs), axis=0))

    def credible_levels(self, rng: np.random.Generator, q: np.ndarray, count: int = 300) -> np.ndarray:
        """Credible levels (N,) of q (N, nq): probability of the smallest region of whole poses that contains each, from
        `count` samples.

        0 at the highest density, 1 far out; where the posterior is right, levels of truths are spread evenly.
        """
        logs = self.log_density(np.concatenate([q, self.sample(rng, count)]))
        own, others = logs[: len(q)], logs[len(q) :]
        return np.asarray(np.mean(others > own[:, None], axis=1))

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Configurations (count, nq) drawn from it, all within the limits."""
        modes = rng.choice(len(self.weight), size=count, p=self.weight)
        drawn = np.zeros((count, self.body.nq))
        for k in np.unique(modes):
            here = np.flatnonzero(modes == k)
            low, high = self.body.tangent_bounds(self.q[k])
            steps = draw_around_mode(rng, len(here), self.covariance[k], self.lean[k], low, high)
            drawn[here] = [self.body.integrate(self.q[k], step) for step in steps]
        return drawn


def tempered(weight: np.ndarray, temperature: float) -> np.ndarray:
    """Weights (K,), NaN of those there are not, to the power of the inverse temperature; they sum to one."""
    with np.errstate(divide="ignore"):
        log = np.log(np.nan_to_num(weight)) / temperature
    return np.asarray(np.exp(log - np.logaddexp.reduce(log)))


def _other(
    body: Body, result: FrameResult, own: int, k: int, pose: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A smoothed pose (nq,) and its covariance (nv, nv) as they would be by mode k instead of the mode `own`: moved by
    their difference, with the smoothed one's covariance, on the limits that k leans on. Where the smoothed pose leans
    on a limit and k does not, k's own covariance is used."""
    moved = body.integrate(pose, body.difference(result.q[own], result.q[k]))
    leans = np.diagonal(result.covariance[k]) <= 0.0
    on_limit = leans[body.bounded_v]
    moved[body.bounded_q[on_limit]] = result.q[k][body.bounded_q[on_limit]]
    changed = covariance * (~leans[:, None] & ~leans)
    freed = np.flatnonzero((np.diagonal(covariance) <= 0.0) & ~leans)
    changed[np.ix_(freed, freed)] = result.covariance[k][np.ix_(freed, freed)]
    return moved, changed


def _prior_precision(stabilisers: Stabilisers, body: Body, posed: PosedBody) -> np.ndarray:
    """Gauss-Newton Hessian (nv, nv) of the prior on rest positions at a mode."""
    prior = np.zeros((body.nv, body.nv))
    stabilisers.accumulate(posed, np.zeros(body.nv), prior)
    return prior


def _with_prior(prior: np.ndarray, covariance: np.ndarray, prior_weight: float) -> np.ndarray:
    """Covariance (nv, nv) of a mode with the prior on rest positions, of a given precision, counted a number of
    times."""
    free = np.flatnonzero(np.diagonal(covariance) > 0.0)
    if prior_weight == 1.0 or len(free) == 0:
        return covariance.astype(np.float64)
    block = np.ix_(free, free)
    known = covariance[block].astype(np.float64)
    posterior = np.zeros_like(prior)
    # (known^-1 + more)^-1, without the inverse of what may be nearly singular
    posterior[block] = np.linalg.solve(np.eye(len(free)) + (prior_weight - 1.0) * known @ prior[block], known)
    return 0.5 * (posterior + posterior.T)


def _where_free(covariance: np.ndarray, lasting: np.ndarray) -> np.ndarray:
    """Covariances (K, nv, nv) of what lasts where the modes are free, by their own (K, nv, nv); zero elsewhere."""
    free = np.diagonal(covariance, axis1=1, axis2=2) > 0.0
    return np.asarray(np.where(free[:, :, None] & free[:, None, :], lasting, 0.0))


def _leaning(body: Body, q: np.ndarray, covariance: np.ndarray, distance: float, lasting: np.ndarray) -> np.ndarray:
    """See `Posterior.lean`, for one mode: the mean distance from a limit is `distance` or, if larger, that of a joint
    at the limit with a lasting error, lasting (nv, nv), of half a Gaussian."""
    v, i = body.bounded_v, body.bounded_q
    held = np.diagonal(covariance)[v] <= 0.0
    inward = np.where(q[i] <= body.lower[i], 1.0, -1.0)
    lean = np.zeros(body.nv)
    far = np.maximum(distance, math.sqrt(2.0 / math.pi) * np.sqrt(np.diagonal(lasting)[v]))
    lean[v] = np.where(held, inward * np.minimum(far, body.upper[i] - body.lower[i]), 0.0)
    return lean


def log_around_mode(gap: np.ndarray, covariance: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """Log density (N,) of a mode at the tangents gap (N, nv) from it."""
    held = lean != 0.0
    free = ~held
    factor = np.linalg.cholesky(covariance[np.ix_(free, free)] + JITTER * np.eye(free.sum()))
    z = solve_triangular(factor, gap[:, free].T, lower=True)
    away = gap[:, held] / lean[held]
    logs = -0.5 * np.sum(z * z, axis=0) - np.log(np.diagonal(factor)).sum() - 0.5 * free.sum() * np.log(2.0 * np.pi)
    return np.asarray(logs - np.sum(np.maximum(away, 0.0), axis=1) - np.log(np.abs(lean[held])).sum())


def draw_around_mode(
    rng: np.random.Generator, count: int, covariance: np.ndarray, lean: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Tangents (count, nv) from a mode's Gaussian within low, high (nv,), and from its exponentials along limits.

    Coordinate by coordinate along the Cholesky factor, each from its truncated normal, then chosen by the
    probability that the truncations left out (Geweke 1991; Hajivassiliou and McFadden 1998).
    """
    factor = np.linalg.cholesky(covariance + JITTER * np.eye(len(lean)))
    steps, z = np.zeros((_OVERDRAW * count, len(lean))), np.zeros((_OVERDRAW * count, len(lean)))
    log_weight = np.zeros(len(steps))
    for i, scale in enumerate(np.diagonal(factor)):
        centre = z[:, :i] @ factor[i, :i]
        a, b = ndtr((low[i] - centre) / scale), ndtr((high[i] - centre) / scale)
        inside = np.maximum(b - a, 1e-12)
        z[:, i] = ndtri(np.clip(a + rng.random(len(z)) * inside, 1e-12, 1.0 - 1e-12))
        log_weight += np.log(inside)
        steps[:, i] = np.clip(centre + scale * z[:, i], low[i], high[i])
    chance = np.exp(log_weight - logsumexp(log_weight))
    chosen = steps[rng.choice(len(steps), size=count, p=chance)]
    along = rng.exponential(size=chosen.shape) * lean
    return np.where(lean == 0.0, chosen, np.clip(along, low, high))


def points_density(points: np.ndarray, weight: np.ndarray, means: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Density (N, L) of points (N, L, 3) under mixtures with means (K, L, 3) and Cholesky factors (K, L, 3, 3)."""
    inverse = np.linalg.inv(factors)
    scale = weight[:, None] * np.abs(np.linalg.det(inverse))
    total = np.zeros(points.shape[:2])
    for mean, whiten, peak in zip(means, inverse, scale, strict=True):
        z = (whiten @ (points - mean)[..., None])[..., 0]
        total += peak * np.exp(-0.5 * np.sum(z * z, axis=-1))
    return total
