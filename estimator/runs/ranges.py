"""Ranges of motion: the range of every joint in a run, and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.runs.joint_angle import JointAngle
from estimator.runs.run_reader import Run


@dataclass(frozen=True)
class Extreme:
    """The least or greatest value of a joint, its 90 % interval [rad or m], and the frame it is of."""

    value: float
    low: float
    high: float
    frame: int


@dataclass(frozen=True)
class RangeOfMotion:
    """A joint's extremes over a run, and their difference with its 90 % interval [rad, or m where it slides]. seen:
    whether anything shows the joint."""

    joint: str
    slides: bool
    least: Extreme
    greatest: Extreme
    range: float
    range_low: float
    range_high: float
    seen: bool = True


def ranges_of_motion(run: Run) -> tuple[RangeOfMotion, ...]:
    """Range of each joint over the observed frames; joints without a value there are left out.

    The interval of an extreme is that of the frame in which the joint has it, see `JointAngle`, widened to the value
    where that was smoothed or filtered out of it. That of the range takes the errors of both frames as independent: an
    error that all frames share, as of a landmark's place, leaves the range alone.
    """
    seen = np.asarray(run.status) != "unobserved"
    return tuple(r for curve in run.joints.values() if (r := _range(curve, seen)) is not None)


def _range(curve: JointAngle, seen: np.ndarray) -> RangeOfMotion | None:
    rows = np.flatnonzero(seen & np.isfinite(curve.value))
    if len(rows) == 0:
        return None
    least, greatest = (int(rows[pick(curve.value[rows])]) for pick in (np.argmin, np.argmax))
    span = float(curve.value[greatest] - curve.value[least])
    bottom, top = _extreme(curve, least), _extreme(curve, greatest)
    moves = least != greatest
    less = float(np.hypot(top.value - top.low, bottom.high - bottom.value)) if moves else 0.0
    more = float(np.hypot(top.high - top.value, bottom.value - bottom.low)) if moves else 0.0
    return RangeOfMotion(
        curve.name, curve.slides, bottom, top,
        span, max(span - less, 0.0), min(span + more, max(curve.upper - curve.lower, span)), curve.seen,
    )  # fmt: skip


def _extreme(curve: JointAngle, t: int) -> Extreme:
    value = float(curve.value[t])
    return Extreme(value, float(np.minimum(curve.low[t], value)), float(np.maximum(curve.high[t], value)), t)
