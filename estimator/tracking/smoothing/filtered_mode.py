"""Pull towards a filtered mode, which does not fade where the image evidence behind the mode does.

Edges and silhouettes saturate: a pose that leaves them loses a bounded energy, and features that are assigned again at
that pose take even this back. A smoother that has nothing else may therefore shrink a fast motion for a bounded price.
The mode's covariance is the inverse Hessian of the frame's evidence where the filter found it; the energy here
continues that evidence without a bound.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.term import BatchTerm
from estimator.numerics.huber import BEND, huber_values, huber_weights
from estimator.search.cost_model import detected_share
from estimator.trackers.frame_result import FrameResult
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody

_SINGULAR = 1e-12  # of the largest variance, below which an axis has none: particles span few axes


class FilteredMode(BatchTerm):
    """weight sum rho(r_i), Huber's potential of the deviations r = e / (scale sigma) from a mode along the principal
    axes of its covariance, e = q (-) q_mode in the tangent space.

    q (nq,): the mode. covariance (nv, nv): in the tangent space at q, zero along active limits, in which the mode pulls
    at nothing. scale: the factor on its standard deviations. weight: 0 to 1, how much the frame counts.

    Raises
    ------
    ValueError: a covariance of another shape, as of results that were read without.
    """

    name = "filtered mode"

    def __init__(self, body: Body, q: np.ndarray, covariance: np.ndarray, scale: float, weight: float = 1.0) -> None:
        if covariance.shape != (body.nv, body.nv):
            raise ValueError(f"a mode's covariance has the shape {covariance.shape}, not {(body.nv, body.nv)}")
        self._body, self._q, self._weight = body, q, float(weight)
        std, axes = principal_axes(covariance)
        self._whiten = axes / (scale * std[:, None])

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        return np.array([self._value(self._deviations(q)) for q in placed.q])

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`. The exact Hessian leaves out the curvature of (-), as the transition's
        does."""
        r = self._deviations(posed.q)
        weights = self._weight * huber_weights(r)
        rows = self._whiten @ pin.dDifference(self._body.model, self._q, posed.q, pin.ARG1)
        gradient += rows.T @ (weights * r)
        bend = np.where(np.abs(r) > BEND, 0.0, weights) if exact else weights
        hessian += rows.T @ (bend[:, None] * rows)
        return self._value(r)

    def _deviations(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(self._whiten @ self._body.difference(self._q, q))

    def _value(self, r: np.ndarray) -> float:
        return self._weight * float(huber_values(r).sum())


def principal_axes(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (A,) and directions (A, N) of a covariance (N, N) along its principal axes, those without
    variance left out; exactly zero in coordinates that have none, as at active limits."""
    free = np.flatnonzero(np.diag(covariance) > 0.0)
    variance, vectors = np.linalg.eigh(covariance[np.ix_(free, free)])
    some = variance > _SINGULAR * variance.max(initial=0.0)
    axes = np.zeros((int(some.sum()), len(covariance)))
    axes[:, free] = vectors.T[some]
    return np.sqrt(variance[some]), axes


def filtered_pulls(
    body: Body, observation: Observation, result: FrameResult, k: int, overconfidence: float, share: float
) -> list[FilteredMode]:
    """The pull towards mode k of a frame with pictures: one, weighed by the part of the person that no keypoint sees;
    none where keypoints see the whole person, nothing was observed, or the overconfidence is 0.

    share: weight of the frame beside its neighbours, whose modes have the same errors (`frame_shares`). Counted in full
    the modes outvote all that averages their errors out.
    """
    unseen = 1.0 - detected_share(observation)
    if overconfidence <= 0.0 or unseen <= 0.0 or result.status == "unobserved":
        return []
    return [FilteredMode(body, result.q[k], result.covariance[k], overconfidence, share * unseen)]


def without_filtered_modes(cost: Cost) -> Cost:
    """The energy by a frame's own evidence alone, which determines a pose's uncertainty: the pull counts it again."""
    terms = [term for term in cost.terms if not isinstance(term, FilteredMode)]
    return cost if len(terms) == len(cost.terms) else Cost(cost.body, terms)
