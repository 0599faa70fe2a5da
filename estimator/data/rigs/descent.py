"""Levenberg's and Marquardt's steps, whatever is adjusted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

_FASTER = 6.0  # by which the damping changes

State = TypeVar("State")
Model = TypeVar("Model")


@dataclass(frozen=True)
class Descent:
    """steps: at most. damping: to begin with, between least and most. gain: of the cost, less than which ends it."""

    steps: int
    damping: float
    least: float
    most: float
    gain: float

    def lowest(
        self,
        at: State,
        cost: Callable[[State], float],
        model: Callable[[State], Model],
        step: Callable[[State, Model, float], State],
    ) -> tuple[State, float]:
        """The state of least cost near one, and its cost. model: what steps from a state are made of; step: the state
        that is tried from a state, its model and a damping."""
        value, damping = cost(at), self.damping
        for _ in range(self.steps):
            known, gain = model(at), 0.0
            while damping <= self.most:
                tried = step(at, known, damping)
                gain = value - cost(tried)
                if gain > 0.0:
                    break
                damping *= _FASTER
            if not gain > 0.0:
                break
            at, value, damping = tried, value - gain, max(damping / _FASTER, self.least)
            if gain < self.gain * value:
                break
        return at, value
