"""Correlated errors of keypoints: an error of a detector in one frame lasts into the next ones.

The energy of a frame treats a keypoint's whole error as independent of other frames. In fact a part of it stays for the
whole clip, a part lasts for some tenths of a second, and the rest is new in every frame, so that keypoints measure a
body's movement better than its position. A trajectory smoothed with the whole error shows the lasting part. Smoothed
again with keypoints without that part, and with the deviation of the new part alone, it follows fast movements. The
distance to which priors pull it from the keypoints in the long run does not change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from estimator.energy.cost import Cost
from estimator.energy.reprojection import Reprojection
from estimator.numerics.robust import measured_deviation
from humanoid.kinematics.body import SHORTEST_STEP, Body
from humanoid.support.spilled import MadeList

_STEP = 1.0 / 30.0  # s over which the new error of a frame is measured, however many frames a second there are
_TINY = 1e-9  # px^2: where nothing lasts


class Residuals(NamedTuple):
    """Keypoints less the body's, along a trajectory of T frames that C cameras see, L landmarks.

    times (T,) [s], rising. pixels (T, C, L, 2) [px], NaN where missing. sigma (T, C, L) [px]: standard deviations of
    the whole error. confidence (T, C, L). left (T, C, L): what the robust potential leaves of a keypoint's pull, 0
    where it is missing.
    """

    times: np.ndarray
    pixels: np.ndarray
    sigma: np.ndarray
    confidence: np.ndarray
    left: np.ndarray


def without_lasting(
    body: Body, costs: Sequence[Cost], times: np.ndarray, q: np.ndarray, lasting: float
) -> Sequence[Cost] | None:
    """Energies of frames, (T) of `costs`, whose keypoints are without the errors that last for some `lasting` [s] along
    poses q (T, nq) at times (T,) [s], rising; None where no camera's keypoints show which these are."""
    residuals = residuals_along(body, costs, times, q)
    share = np.ones(0) if residuals is None else frame_shares(residuals)
    if residuals is None or (share == 1.0).all():
        return None
    errors = lasting_errors(residuals, share, lasting)
    return MadeList(len(costs), lambda t: _corrected(costs[t], errors[t], share))


def by_whole_error(cost: Cost) -> Cost:
    """The energy of a frame by its keypoints as they were detected, which determines a pose's uncertainty."""
    return _with_keypoints(cost, lambda term: term.whole)


def residuals_along(body: Body, costs: Sequence[Cost], times: np.ndarray, q: np.ndarray) -> Residuals | None:
    """Residuals of poses q (T, nq); None where no frame has keypoints."""
    residuals: Residuals | None = None
    for t, cost in enumerate(costs):
        term = _keypoints(cost)
        if term is None:
            continue
        if residuals is None:
            shape = (len(q), *term.sigma.shape)
            missing, nothing = np.full((*shape, 2), np.nan), np.zeros(shape)
            residuals = Residuals(times, missing, np.ones(shape), nothing, nothing.copy())
        pixels = term.residuals(body.at(q[t]))
        residuals.pixels[t], residuals.sigma[t] = pixels, term.sigma
        residuals.confidence[t], residuals.left[t] = term.observation.confidence, term.robust_share(pixels)
    return residuals


def frame_shares(residuals: Residuals) -> np.ndarray:
    """Standard deviation of the new error of a frame over that of the whole error, at most 1, of every camera (C,).

    By the changes of residuals over a thirtieth of a second, without outliers. `measured_deviation` expects that all is
    new, so that few frames change nothing.
    """
    times, whitened = residuals.times, residuals.pixels / residuals.sigma[..., None]
    after = np.searchsorted(times, times + (1.0 - 1e-6) * _STEP)
    first = np.flatnonzero(after < len(times))
    first = first[times[after[first]] - times[first] < 2.0 * _STEP]
    if not len(first):
        return np.ones(whitened.shape[1])
    change = np.linalg.norm(whitened[after[first]] - whitened[first], axis=-1) / np.sqrt(2.0)
    alone = 2.0 / float(np.median(after[first] - first))  # independent numbers of a change: changes overlap
    data = alone * np.isfinite(change).sum(axis=(0, 2))
    return np.array([min(1.0, measured_deviation(change[:, c], own)) for c, own in enumerate(data.tolist())])


def lasting_errors(residuals: Residuals, share: np.ndarray, lasting: float) -> np.ndarray:
    """The lasting part of the residuals, (T, C, L, 2) [px], to be subtracted from keypoints, which then count by share
    (C,) of their deviations.

    What stays for the whole clip, and the mean of a first-order process in time about it, of which the residuals are
    measurements with the new error of a frame as noise. So much of both is left to the keypoints that residuals which
    do not change pull as they did by the whole error; the potential takes less from what is left than it took from
    them.
    """
    errors, process = np.zeros_like(residuals.pixels), _process_precision(residuals.times, lasting)
    weight = np.where(residuals.left > 0.0, residuals.confidence * residuals.left / np.square(residuals.sigma), 0.0)
    for c, k in np.argwhere(weight.any(axis=0)):
        new, left = share[c] ** 2, residuals.left[:, c, k]
        precision = weight[:, c, k] / new
        typical = np.median(residuals.sigma[precision > 0.0, c, k])
        system = process / ((1.0 - new) * typical**2 + _TINY)
        system[0] += precision
        shown = np.nan_to_num(residuals.pixels[:, c, k])
        always = precision @ shown / precision.sum()
        changing = solveh_banded(system, precision[:, None] * (shown - always), lower=True, check_finite=False)
        errors[:, c, k] = (1.0 - new * left ** (1.0 - new))[:, None] * (always + changing)
    return errors


def _process_precision(times: np.ndarray, lasting: float) -> np.ndarray:
    """Precision, (2, T) in lower banded form, of a first-order process of variance 1 at times (T,) [s], rising, that
    lasts for some `lasting` [s]."""
    kept = np.exp(-np.maximum(np.diff(times), SHORTEST_STEP) / lasting)
    new = 1.0 / (1.0 - kept**2)
    bands = np.ones((2, len(times)))
    bands[0, 1:] = new
    bands[0, :-1] += kept**2 * new
    bands[1, :-1] = -kept * new
    return bands


def _keypoints(cost: Cost) -> Reprojection | None:
    return next((term for term in cost.terms if isinstance(term, Reprojection)), None)


def _corrected(cost: Cost, errors: np.ndarray, share: np.ndarray) -> Cost:
    """The energy of a frame whose keypoints are without errors (C, L, 2), and count by share (C,) of their
    deviations."""
    return _with_keypoints(cost, lambda term: term.corrected(errors, share[:, None] * term.sigma))


def _with_keypoints(cost: Cost, changed: Callable[[Reprojection], Reprojection]) -> Cost:
    return Cost(cost.body, [changed(term) if isinstance(term, Reprojection) else term for term in cost.terms])
