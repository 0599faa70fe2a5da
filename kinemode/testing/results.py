"""What every result of a tracker is (see `estimator.trackers.frame_result.FrameResult`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from estimator.data.formats.checked_arrays import sizes_of
from estimator.data.observation import Observation
from estimator.trackers.frame_result import RESULT_FIELDS, FrameResult
from estimator.trackers.statuses import STATUS_MEANINGS
from humanoid.kinematics.body import Body
from kinemode.testing.laws import require

_WEIGHTS, _UNIT, _SYMMETRIC, _DEFINITE = 1e-9, 1e-9, 1e-9, 1e-9
Law = Callable[[bool, str, str], None]
"""Told whether a law is kept, which one, and what was seen."""
_FINITE = ("q", "weight", "energy", "covariance", "velocity")


def check_result(
    who: str,
    body: Body,
    seen: Observation,
    result: FrameResult | None,
    before: FrameResult | None = None,
    *,
    keeps_limits: bool = True,
) -> None:
    """Check a tracker's result of a frame: shapes, a known status, weights that fall and sum to 1, configurations that
    are some and keep to the limits, symmetric positive semi-definite covariances, parents in the frame before, and
    that numbers are finite.

    Parameters
    ----------
    who: the tracker, for messages. body: what is tracked. seen: the frame. before: the result of the frame before,
    None for the first.

    Raises
    ------
    ContractError: the first promise that is not kept.
    """
    where = f"frame {seen.index}"

    def law(kept: bool, name: str, detail: str) -> None:
        require(kept, who, name, f"{where}: {detail}")

    law(result is not None, "every frame from the first has a result", "there is none")
    assert result is not None
    at = (result.index, result.time)
    law(at == (seen.index, seen.time), "a result is of its frame", f"it is of {at}, seen was {(seen.index, seen.time)}")
    law(result.status in STATUS_MEANINGS, "a status is a known one", f"{result.status!r}")
    _shapes(law, body, result)
    for name in _FINITE:
        array = getattr(result, name)
        wrong = 0 if array is None else np.count_nonzero(~np.isfinite(array))
        law(wrong == 0, "numbers are finite", f"{wrong} of {name} are not")
    for name, array in getattr(result, "extra", {}).items():
        wrong = np.count_nonzero(~np.isfinite(array)) if array.dtype.kind == "f" else 0
        law(wrong == 0, "numbers are finite", f"{wrong} of extra {name!r} are not")
    _weights(law, result)
    _poses(law, body, result, keeps_limits)
    for k, covariance in enumerate(result.covariance):
        largest = np.abs(covariance).max()
        apart = np.abs(covariance - covariance.T).max()
        law(apart <= _SYMMETRIC * largest, "covariances are symmetric", f"hypothesis {k} to {apart:.3g} only")
        least = np.linalg.eigvalsh(covariance)[0]
        detail = f"hypothesis {k} has the eigenvalue {least:.3g}, its largest entry is {largest:.3g}"
        law(least >= -_DEFINITE * largest, "covariances are positive semi-definite", detail)
    most = 0 if before is None else len(before.weight)
    outside = [int(p) for p in result.parent if not -1 <= p < most]
    law(not outside, "parents are in the frame before", f"{outside}, there are {most}")


def _shapes(law: Law, body: Body, result: FrameResult) -> None:
    count = len(result.weight)
    law(count >= 1, "there is a hypothesis", "there is none")
    sizes = {**sizes_of(body), "K": count}
    for name, field in RESULT_FIELDS.items():
        array, shape = getattr(result, name), tuple(sizes[size] for size in field.shape)
        if array is not None:
            law(np.shape(array) == shape, "arrays have their shapes", f"{name} is {np.shape(array)}, not {shape}")


def _weights(law: Law, result: FrameResult) -> None:
    total, least = float(result.weight.sum()), float(result.weight.min())
    law(abs(total - 1.0) <= _WEIGHTS, "weights sum to 1", f"they sum to {total!r}")
    law(least >= 0.0, "weights are not negative", f"one is {least:.3g}")
    rise = float(np.diff(result.weight).max(initial=0.0))
    law(rise <= 0.0, "the best hypothesis comes first", f"a weight is {rise:.3g} above the one before it")


def _poses(law: Law, body: Body, result: FrameResult, keeps_limits: bool) -> None:
    for k, q in enumerate(result.q):
        unit = pin.isNormalized(body.model, q, _UNIT)
        law(unit, "configurations are normalised", f"hypothesis {k} is none of the model's: {np.round(q, 4).tolist()}")
        if keeps_limits:
            beyond = np.maximum(body.lower - q, q - body.upper)
            worst = int(np.argmax(beyond))
            detail = f"hypothesis {k} is {beyond[worst]:.3g} beyond, at {body.q_names[worst]}"
            law(beyond[worst] <= 0.0, "configurations keep to the limits", detail)
