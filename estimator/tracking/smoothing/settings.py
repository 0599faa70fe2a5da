"""Motion prior and effort of the smoothing."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.inference.motion import MotionPrior
from estimator.search.cost_model import CostModel, per_dof
from humanoid.support.settings import setting


@dataclass(frozen=True)
class SmoothSettings:
    """Motion prior and effort.

    turn_acceleration, root_turn_acceleration [rad/s^2], root_slide_acceleration [m/s^2]: standard deviations of the
    accelerations of joints, scaled by their quickness, of the root's orientation and of its position, for a person of
    pace 1. Those of velocities are the transition's (`CostSettings`). nu: of the Lorentzian of both, whose tails allow
    fast movements. correlation, memory [s]: how long a movement and an acceleration last, see `MotionPrior`.
    pace_rounds: how often the pace of a clip's frames is estimated and the clip smoothed with it; pace_span [s]: how
    near frames share it, the standard deviation; pace_count: how firmly it is 1 beforehand, in accelerations of one
    joint and frame, see `pace_of`. Memory and span are those of captured motion (`benchmarks.training.accelerations`),
    whose deviations at pace 1 are about 0.65 of these in the legs, half in the arms. stance [m]: how far a heel or toe
    that stands may lie from one place; 0 leaves feet as they are; hands: whether hands that stand on the floor are
    held, too. reading [m]: standard deviation of a trunk that leaves the reading of the frame's mode, in frames that
    have both; 0 allows it. overconfidence: errors of a mode that was found in pictures over its own standard deviations
    (`benchmarks.training.overconfidence`), by which these are widened where the trajectory of a whole clip is tied to
    the mode (`filtered_mode`); 0: no tie. lasting [s]: correlation time of a frame's evidence and errors, in the
    covariances, in the ties to modes and in keypoints' errors shared by frames (`lasting_errors`); 0: only a frame.
    iterations: Newton steps at most. tolerance: energy a step must gain. window: frames solved at once, which bounds
    the memory on long clips. rounds: where pictures are used, how often at most their features are assigned and flow is
    followed again at the smoothed poses; round_gain: energy that a round must gain for another; renewed: for how many
    frames at once, whose cues are kept in memory. lag, lag_iterations: of the version for live use, how many frames it
    is behind and Newton steps a frame. even_pace: of all frames where none is estimated and accelerations have no
    memory, which is in live use, whose window is too short, and between modes. enabled: off leaves the path as the
    tracker chose it.
    """

    enabled: bool = True
    turn_acceleration: float = setting(5.0, above=0)
    root_turn_acceleration: float = setting(2.5, above=0)
    root_slide_acceleration: float = setting(1.25, above=0)
    nu: float = setting(8.0, above=0)
    correlation: float = setting(0.0, at_least=0)
    memory: float = setting(0.12, at_least=0)
    pace_rounds: int = setting(3, at_least=0)
    pace_span: float = setting(0.1, above=0)
    pace_count: float = setting(4.0, above=0)
    stance: float = setting(0.015, at_least=0)
    hands: bool = False
    reading: float = setting(0.02, at_least=0)
    overconfidence: float = setting(2.0, at_least=0)
    lasting: float = setting(0.25, at_least=0)
    iterations: int = setting(30, at_least=1)
    tolerance: float = setting(1e-3, at_least=0, tiny=True)
    window: int = setting(240, at_least=1)
    rounds: int = setting(4, at_least=0)
    round_gain: float = setting(1.0, at_least=0)
    renewed: int = setting(16, at_least=2)
    lag: int = setting(8, at_least=1)
    lag_iterations: int = setting(4, at_least=1)
    even_pace: float = setting(2.0, above=0)

    def motion(self, model: CostModel) -> MotionPrior:
        """The motion prior of a body."""
        turn, root_turn, root_slide = self.turn_acceleration, self.root_turn_acceleration, self.root_slide_acceleration
        acceleration_std = model.quickness * per_dof(model.body, turn, root_turn, root_slide)
        return MotionPrior(model.transition_std(1.0), acceleration_std, self.nu, self.correlation, self.memory)

    def plain_motion(self, model: CostModel) -> MotionPrior:
        """The motion prior of a body without memory, at `even_pace`."""
        whole = self.motion(model)
        return whole._replace(acceleration_std=self.even_pace * whole.acceleration_std, memory=0.0)
