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
        self._mean, covariance = np.ascontiguousarray(mean[:, kept]), covariance[:, kept][:, :, kept]
        cholesky = np.linalg.cholesky(covariance)
        whiten = np.linalg.inv(cholesky)
        self._whiten_t = np.ascontiguousarray(whiten.transpose(0, 2, 1))
        product = self._whiten_t @ whiten
        # to the bit: which of two equal sums a matrix product rounds how is the machine's own choice
        self._precision = np.ascontiguousarray(0.5 * (product + product.transpose(0, 2, 1)))
        self._log_share = np.log(share) + _log_heights(cholesky, stds.mean(axis=1))
        self._log_background, self._weight = math.log(mixture.background), float(weight)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value: float = mixture_energy(
            posed.q, self._q_index, self._v_index, self._log_share, self._mean, self._whiten_t, self._precision,
            self._log_background, self._rest, self._rest_precision, self._weight, exact, gradient, hessian,
        )  # fmt: skip
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        mixture_values(
            placed.q, self._q_index, self._log_share, self._mean, self._whiten_t, self._log_background, self._rest,
            self._rest_precision, self._weight, values,
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
    q, q_index, v_index, log_share, mean, whiten_t, precision, log_background, rest, rest_precision, weight, exact,
    gradient, hessian,
):  # fmt: skip
    """-weight log(sum of the densities); adds its gradient (nv,) and hessian (nv, nv).

    q (nq,). q_index, v_index (D,): places of the D angles in q and in the tangent.
    log_share (K,): log of each Gaussian's height. mean (K, D); whiten_t (K, D, D): transposed inverse Cholesky factors,
    so that the loops run along rows; precision (K, D, D). log_background; rest (D,), rest_precision (D, 2), below and
    above it: of the background.
    """
    K, D = mean.shape
    log_density = np.empty(K + 1)
    _log_densities(q, q_index, log_share, mean, whiten_t, log_background, rest, rest_precision, log_density)
    highest = log_density.max()
    share = np.exp(log_density - highest)
    total = share.sum()
    share /= total
    force, own, bend = np.zeros(D), np.empty(D), np.zeros((D, D))
    for k in range(K + 1):
        if share[k] < _NEGLIGIBLE:
            continue
        if k == K:
            _background(q, q_index, share[k], rest, rest_precision, exact, own, bend)
        else:
            _gaussian(q, q_index, share[k], mean[k], precision[k], exact, own, bend)
        for i in range(D):
            force[i] += share[k] * own[i]
    for i in range(D):
        gradient[v_index[i]] += weight * force[i]
        for j in range(D):
            mean_force = force[i] * force[j] if exact else 0.0
            hessian[v_index[i], v_index[j]] += weight * (bend[i, j] + mean_force)
    return -weight * (highest + math.log(total))


@jit
def mixture_values(  # type: ignore[no-untyped-def]
    q, q_index, log_share, mean, whiten_t, log_background, rest, rest_precision, weight, values
):
    """Fill values (N,) with those of `mixture_energy` at q (N, nq)."""
    log_density = np.empty(mean.shape[0] + 1)
    for n in range(q.shape[0]):
        _log_densities(q[n], q_index, log_share, mean, whiten_t, log_background, rest, rest_precision, log_density)
        highest = log_density.max()
        values[n] = -weight * (highest + math.log(np.exp(log_density - highest).sum()))


@jit
def _log_densities(q, q_index, log_share, mean, whiten_t, log_background, rest, rest_precision, log_density):  # type: ignore[no-untyped-def]
    """Fill log_density (K + 1,) at q (nq,): of the K Gaussians, then of the background; see `mixture_energy`."""
    K, D = mean.shape
    log_density[K] = log_background
    for i in range(D):
        e = q[q_index[i]] - rest[i]
        log_density[K] -= 0.5 * NU * math.log1p(e * e * rest_precision[i, 1 if e > 0.0 else 0] / NU)
    white = np.empty(D)
    for k in range(K):
        white[:] = 0.0
        for j in range(D):
            away = q[q_index[j]] - mean[k, j]
            for i in range(j, D):
                white[i] += whiten_t[k, j, i] * away
        square = 0.0
        for i in range(D):
            square += white[i] * white[i]
        log_density[k] = log_share[k] - 0.5 * square


@jit
def _gaussian(q, q_index, share, mean, precision, exact, own, bend):  # type: ignore[no-untyped-def]
    """Fill own (D,), the gradient of -log density of a Gaussian, and add its share of the curvature to bend (D, D).

    The exact curvature lacks the product of the mean forces, added once for all. mean (D,), precision (D, D). The other
    arrays: see `mixture_energy`.
    """
    D = mean.shape[0]
    own[:] = 0.0
    for j in range(D):
        away = q[q_index[j]] - mean[j]
        for i in range(D):
            own[i] += precision[j, i] * away
    for i in range(D):
        pull = own[i] if exact else 0.0
        for j in range(D):
            bend[i, j] += share * (precision[i, j] - pull * own[j])


@jit
def _background(q, q_index, share, rest, rest_precision, exact, own, bend):  # type: ignore[no-untyped-def]
    """The same as `_gaussian` for the background. own (D,), bend (D, D); the other arrays: see `mixture_energy`."""
    D = rest.shape[0]
    for i in range(D):
        e = q[q_index[i]] - rest[i]
        precision = rest_precision[i, 1 if e > 0.0 else 0]
        slope = 1.0 / (1.0 + e * e * precision / NU)
        own[i] = precision * e * slope
        bending = 2.0 * slope * slope * e * e * precision / NU if exact else 0.0
        bend[i, i] += share * precision * (slope - bending)
    if exact:
        for i in range(D):
            for j in range(D):
                bend[i, j] -= share * own[i] * own[j]
