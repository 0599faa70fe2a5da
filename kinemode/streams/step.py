"""The body at one frame of a stream, as tracked or smoothed some frames later."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.data.observation import Observation
from estimator.runs.joint_angle import joint_entry, joint_value
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.smoothing import FixedLag
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class Step:
    """One frame of `kinemode.Tracker`, with K hypotheses, best first; none before the person was seen first.

    index: number of the frame, from 0. time [s]: as it was given. status: "tracked", "hard" or "unobserved".
    q (nq,): the best pose; smoothed where the tracker has a lag. NaN where there is no hypothesis.
    hypotheses (K, nq), weights (K,): all poses as the tracker left them, and how likely each of them is.
    covariance (K, nv, nv): of each hypothesis, in the tangent space there.
    """

    body: Body = field(repr=False)
    index: int
    time: float
    status: str
    q: np.ndarray = field(repr=False)
    hypotheses: np.ndarray = field(repr=False)
    weights: np.ndarray
    covariance: np.ndarray = field(repr=False)

    @staticmethod
    def of(body: Body, result: FrameResult, smoothed: np.ndarray | None = None) -> Step:
        """A tracker's result; smoothed (nq,): the pose to show instead of its best hypothesis."""
        best = result.q[0] if len(result.q) else np.full(body.nq, np.nan)
        return Step(
            body, result.index, result.time, result.status, best if smoothed is None else smoothed,
            result.q, result.weight, result.covariance,
        )  # fmt: skip

    @property
    def has_pose(self) -> bool:
        """Whether there is a hypothesis."""
        return len(self.weights) > 0

    @cached_property
    def landmarks(self) -> np.ndarray:
        """(L, 3) of `q`, in the world [m], in the order of `body.landmark_names`; NaN where there is no hypothesis."""
        if not self.has_pose:
            return np.full((len(self.body.landmark_names), 3), np.nan)
        return self.body.landmarks(self.body.at(self.q))

    def angle(self, joint: str, degrees: bool = False) -> float:
        """The angle of a joint [rad] or [deg]; NaN where there is no hypothesis.

        Raises
        ------
        InputError: no such joint, or one that is not measured in an angle.
        """
        entry = joint_entry(self.body, joint)
        if entry.kind == "slide":
            raise InputError("joint", f"{joint!r} slides: it has no angle", remedy="take it from q")
        angle = float(joint_value(entry, self.q[None])[0])
        return float(np.degrees(angle)) if degrees else angle


class Delay:
    """Gives every frame back in order, `lag` frames later and smoothed where there is a smoother.

    A frame without hypotheses, which a smoother leaves out, comes in its turn, as it is.
    """

    def __init__(self, body: Body, smoother: FixedLag | None, lag: int) -> None:
        self._body, self._smoother, self._lag = body, smoother, lag
        self._waiting: deque[FrameResult] = deque()
        self._smoothed: dict[int, np.ndarray] = {}

    def push(self, observation: Observation, result: FrameResult) -> Step | None:
        """Take a frame, with its pictures' cues; the one whose turn it is, None where there is none yet."""
        self._waiting.append(result)
        if self._smoother is not None:
            self._smoothed.update(self._smoother.push(observation, result))
        return self._give() if len(self._waiting) > self._lag and self._ready() else None

    def rest(self) -> Iterator[Step]:
        """The frames that are still held back."""
        if self._smoother is not None:
            self._smoothed.update(self._smoother.flush())
        while self._waiting:
            yield self._give()

    def _ready(self) -> bool:
        first = self._waiting[0]
        return self._smoother is None or not len(first.weight) or first.index in self._smoothed

    def _give(self) -> Step:
        result = self._waiting.popleft()
        return Step.of(self._body, result, self._smoothed.pop(result.index, None))
