"""Ranges of motion: how far every joint went in a run, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.results.coordinates import JointEntry, joint_entries
from estimator.results.run_reader import Run

NINETY = 1.6448536269514722
"""Standard deviations of a normal distribution on either side of its mean within which 90 % of it lie."""
_ONE_VALUE = ("turn", "slide", "endless")


@dataclass(frozen=True)
class JointCurve:
    """A joint over a run's frames: value (T,) of the best hypothesis and its calibrated standard deviation (T,), [rad],
    or [m] where it slides; NaN where there is no pose. lower, upper: its limits, infinite without.

    Turns without limits are unwrapped. Joints that follow others have their masters' deviations, multiplied.
    """

    joint: str
    slides: bool
    value: np.ndarray
    std: np.ndarray
    lower: float
    upper: float


@dataclass(frozen=True)
class Extreme:
    """The least or greatest value of a joint, its 90 % interval [rad or m], and the frame it is of."""

    value: float
    low: float
    high: float
    frame: int


@dataclass(frozen=True)
class RangeOfMotion:
    """A joint's extremes over a run, and their difference with its 90 % interval [rad, or m where it slides]."""

    joint: str
    slides: bool
    least: Extreme
    greatest: Extreme
    range: float
    range_low: float
    range_high: float


def joint_curves(run: Run) -> tuple[JointCurve, ...]:
    """Every joint of one degree of freedom, in the order of q."""
    entries = [entry for entry in joint_entries(run.body) if entry.kind in _ONE_VALUE]
    return tuple(_curve(run, entry) for entry in entries)


def _curve(run: Run, entry: JointEntry) -> JointCurve:
    body, own = run.body, entry.of(run.q)
    value = own[:, 0]
    if entry.kind == "endless":
        value = np.arctan2(own[:, 1], own[:, 0])
        known = np.isfinite(value)
        value[known] = np.unwrap(value[known])
    std = abs(entry.multiplier) * run.std[:, body.model.idx_vs[body.model.getJointId(entry.name)]]
    ends = (
        np.array([body.lower[entry.start], body.upper[entry.start]]) if entry.kind != "endless" else [-np.inf, np.inf]
    )
    ends = np.sort(entry.multiplier * np.asarray(ends) + entry.offset)
    return JointCurve(entry.name, entry.kind == "slide", value, std, float(ends[0]), float(ends[1]))


def ranges_of_motion(run: Run) -> tuple[RangeOfMotion, ...]:
    """How far each joint went in the frames in which something was seen; joints without a value there are left out.

    The interval of an extreme is that of the frame in which the joint has it, within the joint's limits. That of the
    range takes the errors of both frames as independent: an error that all frames share, as of a landmark's place,
    leaves the range alone.
    """
    seen = np.asarray(run.status) != "unobserved"
    return tuple(r for curve in joint_curves(run) if (r := _range(curve, seen)) is not None)


def _range(curve: JointCurve, seen: np.ndarray) -> RangeOfMotion | None:
    rows = np.flatnonzero(seen & np.isfinite(curve.value))
    if len(rows) == 0:
        return None
    least, greatest = (int(rows[pick(curve.value[rows])]) for pick in (np.argmin, np.argmax))
    span = float(curve.value[greatest] - curve.value[least])
    off = 0.0 if least == greatest else NINETY * float(np.hypot(curve.std[least], curve.std[greatest]))
    widest = curve.upper - curve.lower
    return RangeOfMotion(
        curve.joint, curve.slides, _extreme(curve, least), _extreme(curve, greatest),
        span, max(span - off, 0.0), min(span + off, max(widest, span)),
    )  # fmt: skip


def _extreme(curve: JointCurve, t: int) -> Extreme:
    value, off = float(curve.value[t]), NINETY * float(curve.std[t])
    return Extreme(value, max(value - off, min(curve.lower, value)), min(value + off, max(curve.upper, value)), t)
