"""Roots and limbs that move faster than any body: the track continued with another person, or with something else.

The limit is physiology's: the fastest sprinter measured, 1.95 m tall, ran 12.3 m/s (Graubner and Nixdorf, Biomechanical
analysis of the sprint and hurdles events at the 2009 IAAF World Championships, New Studies in Athletics 26, 2011), 6.3
body lengths a second. The fastest hand or foot beside the trunk of 105 captured clips, a dancer's, moves 8.7 lengths a
second. Lengths rather than metres, because one camera measures no metres, and for bodies of any size.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from estimator.data.formats.checked_arrays import Field, check_arrays
from estimator.inference.mixture import body_size
from estimator.trackers.frame_result import FrameResult
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_PLACE_V, ROOT_TURN_Q, Body
from humanoid.support.errors import first_of

FASTEST = 7.0  # body lengths a second, the sprinter's with some room
_FASTEST_LIMB = 18.0  # the same, of hands and feet: twice the dancer's, for kicks and throws
_DEVIATIONS = 3.0  # standard deviations by which the places themselves may be wrong


_PREFIX = "last_"
_FIELDS = {
    f"{_PREFIX}time": Field("f"),
    f"{_PREFIX}unobserved": Field("f"),
    f"{_PREFIX}root": Field("f", ("K", "root")),
    f"{_PREFIX}covariance": Field("f", ("K", "place", "place")),
}


@dataclass(frozen=True)
class LastFrame:
    """The reference for detecting leaps, passed from frame to frame beside the tracker's state.

    time [s]: of the frame. unobserved [s]: time between it and the last searched frame. root (K, 7), covariance (K, 3,
    3): placement of its hypotheses' roots, as in q, and the covariance of their positions.
    """

    time: float
    unobserved: float
    root: np.ndarray
    covariance: np.ndarray

    @staticmethod
    def after(before: LastFrame | None, result: FrameResult) -> LastFrame | None:
        """The memory after one more frame; a frame without hypotheses leaves the roots unchanged. None before the
        first."""
        unobserved = 0.0
        if before is not None and (result.status == "unobserved" or not len(result.q)):
            unobserved = before.unobserved + result.time - before.time
        if len(result.q):
            return LastFrame(result.time, unobserved, result.q[:, :7].copy(), result.covariance[:, :3, :3].copy())
        return None if before is None else LastFrame(result.time, unobserved, before.root, before.covariance)

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays to be stored, exact to the last bit; `from_arrays` is the inverse."""
        return {_PREFIX + name: np.asarray(value) for name, value in vars(self).items()}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], body: Body) -> LastFrame | None:
        """Rebuild it from `arrays`, which may include others, or from the state of a run made before it was stored;
        None where there is neither. Raises DamageError for invalid arrays."""
        own = {name: arrays[name] for name in _FIELDS if name in arrays}
        if not own:
            if not {"time", "unobserved", "q", "covariance"} <= set(arrays):
                return None
            roots = arrays["q"][:, :7], arrays["covariance"][:, :3, :3]
            own = dict(zip(_FIELDS, (arrays["time"], arrays["unobserved"], *roots), strict=True))
        count = len(np.atleast_1d(own.get(f"{_PREFIX}root", 0.0)))
        check_arrays(own, _FIELDS, {"K": count, "root": min(7, body.nq), "place": min(3, body.nv)})
        time, unobserved, root, covariance = (own[name] for name in _FIELDS)
        return LastFrame(float(time), float(unobserved), root, covariance)


class LeapCheck:
    """Detects leaps of the root of a free body from one frame to the next. A fixed root never leaps."""

    def __init__(self, body: Body) -> None:
        self._free = body.has_free_root
        self._speed = FASTEST * body_size(body)  # [m/s]

    def leapt_since(self, last: LastFrame | None, result: FrameResult) -> bool:
        """`leapt` from the frame before to this one; never to one without hypotheses, nor from none."""
        if last is None or not len(result.q):
            return False
        elapsed = result.time - last.time + last.unobserved
        return self.leapt(last.root, last.covariance, result.q[0], result.covariance[0], elapsed)

    def leapt(
        self, before: np.ndarray, covariance_before: np.ndarray, q: np.ndarray, covariance: np.ndarray, elapsed: float
    ) -> bool:
        """Whether the best hypothesis q (nq,) is farther than a body gets in `elapsed` [s] from every one of the
        hypotheses before (K, nq), beyond what their covariances (nv, nv) and (K, nv, nv) leave open."""
        if not self._free or not len(before):
            return False
        steps = q[ROOT_PLACE_Q] - before[:, ROOT_PLACE_Q]
        length = np.linalg.norm(steps, axis=1)
        if np.any(length <= self._speed * elapsed):
            return False
        along = steps / np.maximum(length, 1e-9)[:, None]
        spread = [
            float(u @ (_placed(a, C) + _placed(q, covariance)) @ u)
            for u, a, C in zip(along, before, covariance_before, strict=True)
        ]
        return bool(np.all(length > self._speed * elapsed + _DEVIATIONS * np.sqrt(np.maximum(spread, 0.0))))


def _placed(q: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) [m^2] of the root's place in the world; in the tangent space it is in the root's own axes."""
    R_world_root = pin.Quaternion(q[ROOT_TURN_Q]).toRotationMatrix()
    return np.asarray(R_world_root @ covariance[ROOT_PLACE_V, ROOT_PLACE_V] @ R_world_root.T)


def leaps(body: Body, results: Iterable[FrameResult]) -> list[int]:
    """Indices of the frames in which the root leapt; unobserved frames lengthen the time there was."""
    check, leapt = LeapCheck(body), []
    last: LastFrame | None = None
    for result in results:
        if result.status != "unobserved" and check.leapt_since(last, result):
            leapt.append(result.index)
        last = LastFrame.after(last, result)
    return leapt


def limb_leaps(body: Body, landmarks: np.ndarray, times: np.ndarray) -> list[int]:
    """Rows of a trajectory's landmarks (T, L, 3) [m], at times (T,) [s], before which a landmark moved faster than any
    limb beside the middle of all; rows without a pose are passed over."""
    rows = np.flatnonzero(np.isfinite(landmarks).all(axis=(1, 2)))
    if not body.has_free_root or len(rows) < 2:
        return []
    beside = landmarks[rows] - landmarks[rows].mean(axis=1, keepdims=True)
    speed = np.linalg.norm(np.diff(beside, axis=0), axis=2).max(axis=1) / np.diff(times[rows])
    return [int(row) for row in rows[1:][speed > _FASTEST_LIMB * body_size(body)]]


def limb_note(rows: list[int]) -> str:
    """Warning about limbs that leap, empty without."""
    if not rows:
        return ""
    count = f"{len(rows)} frame{'s' * (len(rows) != 1)} ({first_of(rows, 8)}; there it is marked hard)"
    return f"limbs move faster than any person's in {count}: check the labels, and the frames before"


def leap_note(frames: list[int]) -> str:
    """Message about leaps, empty where there are none."""
    if not frames:
        return ""
    listed = first_of(frames, 8)
    count = f"{len(frames)} frame{'s' * (len(frames) != 1)}"
    return (
        f"the body leaps faster than any could run in {count} ({listed}; there it is marked hard): is it another person"
        " from there on? --person chooses one of several people"
    )
