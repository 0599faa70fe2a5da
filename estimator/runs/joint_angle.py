"""One joint over a run: its angle, its uncertainty, the angles of the other hypotheses, and all of them as a table."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.runs.coordinates import JointEntry, joint_entries, q_columns, unwrapped
from estimator.runs.marginals import Spread
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, misplaced, nearest
from humanoid.support.summary import Facts, Summarised

ONE_NUMBER = ("turn", "slide", "endless")
"""Kinds of joints that one number places: those that have an angle, or a length."""
_DEGREES = 180.0 / np.pi


@dataclass(frozen=True, eq=False, repr=False)
class JointAngle(Summarised):
    """A joint over the T frames of a run, which has up to K hypotheses a frame.

    name: of the joint. unit: of all its numbers: "rad", "m" where it slides, "deg" of what `degrees` gives.
    time (T,) [s].
    value (T,): of the best hypothesis, as in `Run.q`; joints that turn without limits are unwrapped.
    std (T,): calibrated standard deviation over all hypotheses, as in `Run.std`.
    low, high (T,): ends of the central interval of 90 % of the calibrated posterior, quantiles of all hypotheses
        together. Where the run is smoothed they are around the smoothed trajectory, with all frames in mind; a value
        that was filtered afterwards can lie outside.
    hypotheses, weights (T, K): every hypothesis and its weight, NaN where a frame has fewer.
    lower, upper: the joint's limits, infinite where it has none. seen: whether anything shows the joint in the run;
        else its value is the prior's, and the interval covers nearly all of its limits.

    All are NaN in frames without a pose.
    """

    name: str
    unit: str
    time: np.ndarray
    value: np.ndarray
    std: np.ndarray
    low: np.ndarray
    high: np.ndarray
    hypotheses: np.ndarray
    weights: np.ndarray
    lower: float = -np.inf
    upper: float = np.inf
    seen: bool = True

    @property
    def slides(self) -> bool:
        """Whether its numbers are lengths."""
        return self.unit == "m"

    @property
    def degrees(self) -> JointAngle:
        """The same in degrees; a joint that slides stays in metres."""
        if self.unit != "rad":
            return self
        scaled = {
            name: _DEGREES * getattr(self, name)
            for name in ("value", "std", "low", "high", "hypotheses", "lower", "upper")
        }
        return replace(self, unit="deg", **scaled)

    def _called(self) -> str:
        return self.name

    def _facts(self) -> Facts:
        facts = [("frames", f"{len(self.time)}")]
        if len(self.time):
            facts.append(("time", f"{self.time[0]:.2f} to {self.time[-1]:.2f} s"))
        known = np.isfinite(self.value)
        if known.any():
            least, greatest = self.value[known].min(), self.value[known].max()
            facts.append(("value", f"{least:.4g} to {greatest:.4g} {self.unit}"))
            facts.append(("median std", f"{np.median(self.std[known]):.3g} {self.unit}"))
        facts.append(("hypotheses", f"up to {self.weights.shape[1]}"))
        return facts if self.seen else [*facts, ("but", "it is unobserved: its value comes from the prior")]


def joint_entry(body: Body, name: str) -> JointEntry:
    """The joint of this name, which one number places.

    Raises
    ------
    InputError: an unknown name, or a joint of several degrees of freedom, with the nearest names.
    """
    if not isinstance(name, str):
        raise misplaced("joint", name, "the name of a joint; run.result(i) is a frame")
    entries = {entry.name: entry for entry in joint_entries(body)}
    valid = [entry.name for entry in entries.values() if entry.kind in ONE_NUMBER]
    entry = entries.get(name)
    if entry is None:
        whole = next((e for e in entries.values() if e.kind not in ONE_NUMBER and name in body.q_names[_of(e)]), None)
        if whole is None:
            raise InputError("joint", f"there is no joint {name!r}", remedy=nearest(name, valid, "joints"))
        entry = whole
    if entry.kind not in ONE_NUMBER:
        place = f"entries {entry.start} to {entry.start + entry.count - 1} of q are"
        problem = f"{name!r} is of a joint of several degrees of freedom, which has no angle"
        raise InputError("joint", problem, remedy=f"{place} {', '.join(body.q_names[_of(entry)])}")
    return entry


def _of(entry: JointEntry) -> slice:
    return slice(entry.start, entry.start + entry.count)


def joint_angle(
    entry: JointEntry,
    body: Body,
    time: np.ndarray,
    q: np.ndarray,
    modes: np.ndarray,
    weight: np.ndarray,
    spread: Spread,
    unseen: Collection[str],
) -> JointAngle:
    """A joint of one number over the frames of a run, see `Run`; modes (T, K, nq), weight (T, K): the hypotheses."""
    in_v = int(body.model.idx_vs[body.model.getJointId(entry.name)])  # of a joint that follows, its master's
    value = joint_value(entry, q)
    hypotheses = _number(entry, modes.reshape(-1, body.nq)).reshape(modes.shape[:2])
    ends = _number(entry, spread.best)[:, None] + entry.multiplier * spread.ends[:, :, in_v]
    limits = np.array([-np.inf, np.inf])
    if entry.kind == "endless":
        turns = 2.0 * np.pi * np.round((value[:, None] - hypotheses) / (2.0 * np.pi))
        hypotheses = hypotheses + turns
        ends = ends + 2.0 * np.pi * np.round((value - ends.mean(axis=1)) / (2.0 * np.pi))[:, None]
    else:
        limits = np.sort(entry.multiplier * np.array([body.lower[entry.start], body.upper[entry.start]]) + entry.offset)
    low, high = np.sort(ends, axis=1).T
    return JointAngle(
        entry.name, "m" if entry.kind == "slide" else "rad", time, value,
        abs(entry.multiplier) * spread.std[:, in_v], low, high, hypotheses, weight,
        float(limits[0]), float(limits[1]), seen=body.v_names[in_v] not in unseen,
    )  # fmt: skip


def joint_value(entry: JointEntry, q: np.ndarray) -> np.ndarray:
    """The angle or length (T,) of a joint of one number in q (T, nq) [rad, m], unwrapped where it has no limits."""
    return unwrapped(_number(entry, q)) if entry.kind == "endless" else _number(entry, q)


def _number(entry: JointEntry, q: np.ndarray) -> np.ndarray:
    """The joint's angle or length (T,) in q (T, nq); of a joint without limits from -pi to pi."""
    own = entry.of(q)
    return np.arctan2(own[:, 1], own[:, 0]) if entry.kind == "endless" else own[:, 0]


def joint_columns(body: Body, q: np.ndarray, angles: Mapping[str, JointAngle], degrees: bool) -> dict[str, np.ndarray]:
    """Columns (T,) by name, joint by joint, of configurations q (T, nq) and all angles by the joints' names:
    `root_x_m`, `root_qw`, `left_knee_flexion_rad`, `left_knee_flexion_std_rad`.

    degrees: `left_knee_flexion_deg` and `left_knee_flexion_std_deg` instead. Joints that slide are `_m`. Of a joint of
    several degrees of freedom, as a free root, there are the entries of q, without standard deviations: its tangent
    space has other axes (`Run.std`).
    """
    names, columns = q_columns(body), dict[str, np.ndarray]()
    for entry in joint_entries(body):
        if entry.kind in ONE_NUMBER:
            angle = angles[entry.name]
            columns |= _entries_of(angle.degrees if degrees else angle)
        else:
            columns |= {names[k]: q[:, k] for k in range(entry.start, entry.start + entry.count)}
    return columns


def std_columns(angles: Iterable[JointAngle]) -> dict[str, np.ndarray]:
    """The standard deviations alone (T,) [rad or m], by the names of `joint_columns`."""
    return dict(list(_entries_of(angle).items())[1] for angle in angles)


def _entries_of(angle: JointAngle) -> dict[str, np.ndarray]:
    """The value, NaN for an unobserved joint, then its standard deviation."""
    value = angle.value if angle.seen else np.full_like(angle.value, np.nan)
    return {f"{angle.name}_{angle.unit}": value, f"{angle.name}_std_{angle.unit}": angle.std}
