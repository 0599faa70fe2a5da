"""Which poses people take: a mixture learned from captured motion, in place of independent rest positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from estimator.energy.kernels.mixture import mixture_record, mixture_values
from estimator.energy.kernels.records import MIXTURE, Record
from estimator.energy.kernels.stabilisers import stabiliser_log_integral
from estimator.energy.pose_mixture import PoseMixture
from estimator.energy.recorded import RecordedTerm
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.errors import InputError, first_of

_LISTED = 4  # joints in a message


class PosePrior(RecordedTerm):
    """-log p(joint angles), p = background + components, scaled by `weight` and up to a constant.

    The background is the density of the stabilisers (CSS 3.2.2): exp(-their energy) is a product of Student's t with 3
    degrees of freedom, so it can be normalised and mixed with the Gaussians. A pose far from all captured ones
    therefore has the energy of the stabilisers, plus -log of the background's share. A captured one has less, and is
    held by the correlations of the joints. Nothing is forbidden. The constant makes the background alone equal to the
    stabilisers, so it lowers the energy of known poses below zero. Limits are not considered in any normalisation.

    A body some of whose joints are locked has the marginal density of the others.

    Parameters
    ----------
    body: it suits the mixture (`misfit`). mixture: see `PoseMixture`. weight: 1 is the probabilistic one for a single
    frame.

    Raises
    ------
    InputError: the mixture is not for this body.
    """

    name, kind, lasting = "pose prior", MIXTURE, True

    def __init__(self, body: Body, mixture: PoseMixture, weight: float = 1.0) -> None:
        self._body = body
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
        whiten = np.linalg.inv(cholesky)
        self._whiten = np.concatenate([whiten[:, j:, j].T.ravel() for j in range(len(kept))])
        self._white_mean = np.einsum("kij,kj->ik", whiten, mean).ravel()
        product = whiten.transpose(0, 2, 1) @ whiten
        precision = 0.5 * (product + product.transpose(0, 2, 1))
        self._pull = np.einsum("kij,kj->ki", precision, mean)
        below = np.tril_indices(len(kept))
        self._precision = np.ascontiguousarray(precision[:, below[0], below[1]])
        self._log_share = np.log(share) + _log_heights(cholesky, stds.mean(axis=1))
        self._log_background, self._weight = math.log(mixture.background), float(weight)

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return mixture_record(
            self._q_index, self._v_index, self._log_share, self._whiten, self._white_mean,
            self._precision, self._pull, self._log_background, self._rest, self._rest_precision, self._weight,
        )  # fmt: skip

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        mixture_values(
            placed.q, self._q_index, self._log_share, self._whiten, self._white_mean, self._log_background,
            self._rest, self._rest_precision, self._weight, values,
        )  # fmt: skip
        return values


def _log_heights(cholesky: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Log density of every Gaussian (K, D, D) at its mean over that of the background, whose scales are std (D,), the
    mean of both sides, at rest."""
    gaussians = -np.log(np.diagonal(cholesky, axis1=1, axis2=2)).sum(axis=1) - 0.5 * len(std) * math.log(2.0 * math.pi)
    return np.asarray(gaussians + np.log(std).sum() + len(std) * stabiliser_log_integral())


_REMEDY = "the shipped prior is for human34; without one: pose_prior_weight = 0"
_SAME_AXIS = math.cos(math.radians(30.0))  # locked joints may turn those behind them a little


def misfit(body: Body, mixture: PoseMixture) -> str | None:
    """The requirement of a mixture of joint angles that a body lacks, None where it suits.

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
