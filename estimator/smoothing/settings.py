"""Motion prior and effort of the smoothing."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.cost.model import CostModel, per_dof
from estimator.modes.motion import MotionPrior


@dataclass(frozen=True)
class SmoothSettings:
    """Motion prior and effort.

    turn_acceleration, root_turn_acceleration [rad/s^2], root_slide_acceleration [m/s^2]: standard deviations of the
    accelerations of joints, of the root's orientation and of its position. The velocities' are those of the transition
    (`CostSettings`). iterations: Newton steps at most. tolerance: energy a step must gain. window: frames solved at
    once, which bounds the memory on long clips. lag, lag_iterations: of the version for live use, how many frames it is
    behind and Newton steps a frame. enabled: off leaves the path as the tracker chose it.
    """

    enabled: bool = True
    turn_acceleration: float = 10.0
    root_turn_acceleration: float = 5.0
    root_slide_acceleration: float = 2.5
    iterations: int = 30
    tolerance: float = 1e-3
    window: int = 240
    lag: int = 8
    lag_iterations: int = 4

    def motion(self, model: CostModel) -> MotionPrior:
        """The motion prior of a body."""
        turn, root_turn, root_slide = self.turn_acceleration, self.root_turn_acceleration, self.root_slide_acceleration
        return MotionPrior(model.transition_std(1.0), per_dof(model.body, turn, root_turn, root_slide))
