"""Which poses people take: a mixture learned from captured motion, in place of independent rest positions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from estimator.energy.pose_mixture import PoseMixture
from estimator.energy.priors import STABILISER_NU as NU
from estimator.energy.priors import stabiliser_log_integral
from estimator.energy.term import BatchTerm
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError, first_of

_LISTED = 4  # joints in a message
_NEGLIGIBLE = 1e-12  # a component's share of a pose below which it neither pulls nor bends


class PosePrior(BatchTerm):
    """-log p(joint angles), p = background + components, scaled by `weight` and up to a constant.

    The background is what the stabilisers say (CSS 3.2.2): exp(-their energy) is a product of Student's t with 3
    degrees of freedom, so it can be normalised and mixed with the Gaussians. A pose far from everything captured
    therefore costs what the stabilisers ask, plus -log of the background's share; one that was captured costs less and
    is held by the joints together, as correlations have it. Nothing is forbidden. The constant makes the background
    alone equal to the stabilisers, so it lowers the energy of known poses below zero. Limits are not considered in
    any normalisation.

    A body some of whose joints are locked has the marginal density of the others.

    Parameters
    ----------
    body: it suits the mixture (`misfit`). mixture: see `PoseMixture`. weight: 1 is honest for a single frame.

    Raises
    ------
    InputError: the mixture is not for this body.
    """

    name = "pose prior"

    def __init__(self, body: Body, mixture: PoseMixture, weight: float = 1.0) -> None:
        problem = misfit(body, mixture)
        if problem is not None:
            raise InputError(body.subject.source, f"the pose prior needs {problem}", remedy=_REMEDY)
        moving = _moving(body)
        kept = [i for i, name in enumerate(mixture.joints) if name in moving]
        joints = [mixture.joints[i] for i in kept]
        model = body.model
        self._q_index = np.array([model.idx_qs[moving[name]] for name in joints], dtype=np.int64)
        self._v_index = np.array([model.idx_vs[moving[name]] for name in joints], dtype=np.int64)
        rests = {s.joint: s for s in body.subject.stabilisers}
        self._rest = np.array([rests[name].rest for name in joints])
        stds = np.array([(rests[name].std, rests[name].std_above) for name in joints])
        self._rest_precision = 1.0 / np.square(stds)
        share, mean, covariance = mixture.both_sides()
        mean, covariance = mean[:, kept], covariance[:, kept][:, :, kept]
        cholesky = np.linalg.cholesky(covariance)
        self._whiten = np.linalg.inv(cholesky)
        self._whiten_t = np.ascontiguousarray(self._whiten.reshape(-1, len(kept)).T)
        self._white_mean = np.einsum("kij,kj->ki", self._whiten, mean).ravel()
        product = self._whiten.transpose(0, 2, 1) @ self._whiten
        precision = 0.5 * (product + product.transpose(0, 2, 1))
        self._pull = np.einsum("kij,kj->ki", precision, mean)
        below = np.tril_indices(len(kept))
        self._precision = np.ascontiguousarray(precision[:, below[0], below[1]])
        self._log_share = np.log(share) + _log_heights(cholesky, stds.mean(axis=1))
        self._log_background, self._weight = math.log(mixture.background), float(weight)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value: float = mixture_energy(
            posed.q, self._q_index, self._v_index, self._log_share, self._whiten, self._whiten_t, self._white_mean,
            self._precision, self._pull, self._log_background, self._rest, self._rest_precision, self._weight, exact,
            gradient, hessian,
        )  # fmt: skip
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        mixture_values(
            placed.q, self._q_index, self._log_share, self._whiten_t, self._white_mean, self._log_background,
            self._rest, self._rest_precision, self._weight, values,
        )  # fmt: skip
        return values


def _log_heights(cholesky: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Log density of every Gaussian (K, D, D) at its mean over that of the background, whose scales
    are std (D,) in the mean of either side, at rest."""
    gaussians = -np.log(np.diagonal(cholesky, axis1=1, axis2=2)).sum(axis=1) - 0.5 * len(std) * math.log(2.0 * math.pi)
    return np.asarray(gaussians + np.log(std).sum() + len(std) * stabiliser_log_integral())


_REMEDY = "the shipped prior is for human34; without one: pose_prior_weight = 0"
_SAME_AXIS = math.cos(math.radians(30.0))  # locked joints may turn those behind them a little


def misfit(body: Body, mixture: PoseMixture) -> str | None:
    """What a body lacks for a mixture of joint angles, None where nothing.

    Each of the mixture's joints has to be a joint of one angle there, about the same axis and with a stabiliser, or is
    locked: fixed, under the same name.
    """
    moving, model = _moving(body), body.model
    locked = {frame.name for frame in model.frames if frame.type == pin.FrameType.FIXED_JOINT}
    missing = [name for name in mixture.joints if name not in moving and name not in locked]
    if missing:
        return f"joints it does not have: {first_of(missing, _LISTED)}"
    kept = [i for i, name in enumerate(mixture.joints) if name in moving]
    joints = [mixture.joints[i] for i in kept]
    if not joints:
        return "joints that move"
    held = {s.joint for s in body.subject.stabilisers}
    if not held.issuperset(joints):
        return f"a <stabiliser> for {first_of([name for name in joints if name not in held], _LISTED)}"
    along = np.einsum("ij,ij->i", joint_axes(body, joints), mixture.axes[kept])
    turned = [name for name, same in zip(joints, along, strict=True) if same < _SAME_AXIS]
    return f"another axis of {first_of(turned, _LISTED)}" if turned else None


def joint_axes(body: Body, joints: Sequence[str]) -> np.ndarray:
    """Unit vectors (D, 3) about which joints of one angle turn, in the root's frame with all angles at zero."""
    moving = _moving(body)
    rows = [body.model.idx_vs[moving[name]] for name in joints]
    return np.asarray(body.dof_jacobian(body.at(pin.neutral(body.model)))[rows, 3:])


def _moving(body: Body) -> dict[str, int]:
    """Its joints of one angle, by name."""
    model = body.model
    return {model.names[j]: j for j in range(1, body.njoints) if model.nqs[j] == 1 and model.nvs[j] == 1}


@jit
def mixture_energy(  # type: ignore[no-untyped-def]
    q, q_index, v_index, log_share, whiten, whiten_t, white_mean, precision, pull, log_background, rest,
    rest_precision, weight, exact, gradient, hessian,
):  # fmt: skip
    """-weight log(sum of the densities); adds its gradient (nv,) and hessian (nv, nv).

    q (nq,). q_index, v_index (D,): places of the D angles in q and in the tangent.
    log_share (K,): log of each Gaussian's height. whiten (K, D, D): inverse Cholesky factors, whiten_t (D, K * D) and
    white_mean (K * D,): the rows of all of them as columns, and what these make of the means, so that the loops run
    along many numbers. precision (K, T): lower triangles of T numbers, row by row, pull (K, D): precisions times means.
    log_background; rest (D,), rest_precision (D, 2), below and above it: of the background.
    """
    K, D = pull.shape
    log_density, white, angles = np.empty(K + 1), np.empty(K * D), q[q_index]
    _log_densities(angles, log_share, whiten_t, white_mean, log_background, rest, rest_precision, white, log_density)
    highest = log_density.max()
    share = np.exp(log_density - highest)
    total = share.sum()
    share /= total
    force, own, bend = np.zeros(D), np.empty(D), np.zeros(precision.shape[1])
    for k in range(K):
        if share[k] >= _NEGLIGIBLE:
            _add_to(bend, share[k], precision[k])
            _add_to(force, -share[k], pull[k])
    _add_product(bend, angles, force)
    _background(angles, share[K], rest, rest_precision, exact, own, bend)
    _add_to(force, share[K], own)
    if exact:
        _subtract_square(bend, share[K], own)
        for k in range(K):
            if share[k] >= _NEGLIGIBLE:
                own[:] = 0.0
                for i in range(D):
                    _add_to(own, white[k * D + i], whiten[k, i])
                _subtract_square(bend, share[k], own)
        _subtract_square(bend, -1.0, force)
    n = 0
    for i in range(D):
        gradient[v_index[i]] += weight * force[i]
        for j in range(i):
            hessian[v_index[i], v_index[j]] += weight * bend[n]
            hessian[v_index[j], v_index[i]] += weight * bend[n]
            n += 1
        hessian[v_index[i], v_index[i]] += weight * bend[n]
        n += 1
    return -weight * (highest + math.log(total))


@jit
def mixture_values(  # type: ignore[no-untyped-def]
    q, q_index, log_share, whiten_t, white_mean, log_background, rest, rest_precision, weight, values
):
    """Fill values (N,) with those of `mixture_energy` at q (N, nq)."""
    log_density, white = np.empty(log_share.shape[0] + 1), np.empty(white_mean.shape[0])
    for n in range(q.shape[0]):
        angles = q[n][q_index]
        _log_densities(
            angles, log_share, whiten_t, white_mean, log_background, rest, rest_precision, white, log_density
        )
        highest = log_density.max()
        values[n] = -weight * (highest + math.log(np.exp(log_density - highest).sum()))


@jit
def _log_densities(  # type: ignore[no-untyped-def]
    angles, log_share, whiten_t, white_mean, log_background, rest, rest_precision, white, log_density
):
    """Fill log_density (K + 1,) at angles (D,): of the K Gaussians, then of the background; and white (K * D,), the
    angles as standard normal numbers of each Gaussian. The other arrays: see `mixture_energy`."""
    K, D = log_share.shape[0], angles.shape[0]
    log_density[K] = log_background
    for i in range(D):
        e = angles[i] - rest[i]
        log_density[K] -= 0.5 * NU * math.log1p(e * e * rest_precision[i, 1 if e > 0.0 else 0] / NU)
    white[:] = 0.0
    for j in range(D):
        _add_to(white, angles[j], whiten_t[j])
    _add_to(white, -1.0, white_mean)
    for k in range(K):
        square = 0.0
        for i in range(k * D, k * D + D):
            square += white[i] * white[i]
        log_density[k] = log_share[k] - 0.5 * square


@jit
def _add_to(sums, factor, numbers):  # type: ignore[no-untyped-def]
    """Add factor times numbers (N,) to sums (N,)."""
    for n in range(sums.shape[0]):
        sums[n] += factor * numbers[n]


@jit
def _add_product(triangle, x, out):  # type: ignore[no-untyped-def]
    """Add to out (D,) the product of a symmetric matrix, given by its lower triangle (T,), with x (D,)."""
    n = 0
    for i in range(x.shape[0]):
        for j in range(i):
            out[i] += triangle[n] * x[j]
            out[j] += triangle[n] * x[i]
            n += 1
        out[i] += triangle[n] * x[i]
        n += 1


@jit
def _subtract_square(triangle, factor, x):  # type: ignore[no-untyped-def]
    """Subtract factor x x' of x (D,) from a symmetric matrix, given by its lower triangle (T,)."""
    n = 0
    for i in range(x.shape[0]):
        f = factor * x[i]
        for j in range(i + 1):
            triangle[n + j] -= f * x[j]
        n += i + 1


@jit
def _background(angles, share, rest, rest_precision, exact, own, bend):  # type: ignore[no-untyped-def]
    """Fill own (D,), the gradient of -log density of the background at angles (D,), and add its share of the curvature
    of single angles to the diagonal of the lower triangle bend (T,). The other arrays: see
    `mixture_energy`."""
    n = 0
    for i in range(rest.shape[0]):
        e = angles[i] - rest[i]
        precision = rest_precision[i, 1 if e > 0.0 else 0]
        slope = 1.0 / (1.0 + e * e * precision / NU)
        own[i] = precision * e * slope
        bending = 2.0 * slope * slope * e * e * precision / NU if exact else 0.0
        bend[n + i] += share * precision * (slope - bending)
        n += i + 1
