"""Inverse kinematics by pink, one frame after the other, as its examples retarget."""

from __future__ import annotations

from time import process_time
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from benchmarks.retargeting.rebuilt import RebuiltTargets
from humanoid.kinematics.body import ROOT_Q, Body
from humanoid.support.errors import InputError

STEPS = 10
"""Of each frame: the velocity limits hold in each, so they hold in the frame."""
SOLVERS = ("daqp", "quadprog", "proxqp")
"""Of quadratic programs, the first that is installed: ProxQP gives up where others do not."""
_FIRST = 200  # steps to the first frame, which no velocity limits
_LM, _POSTURE, _DAMPING = 1e-2, 1e-3, 1e-6


class PinkMotion(NamedTuple):
    """q (T, nq). seconds: processor time of a frame, the first left out. failed: steps without a solution, which were
    not taken."""

    q: np.ndarray
    seconds: float
    failed: int


class _PinkSteps:
    """pink's configuration, tasks and limits of a body.

    Raises InputError where pink is not installed.
    """

    def __init__(self, body: Body, targets: RebuiltTargets) -> None:
        try:
            import pink
            import qpsolvers
            from pink.limits import ConfigurationLimit, VelocityLimit
            from pink.tasks import FrameTask, PostureTask
        except ImportError as error:
            remedy = "pip install -e .[benchmark], or --methods without pink"
            raise InputError("pink", f"{error.name} is not installed", remedy=remedy) from None
        self._solve, self._failure, model = pink.solve_ik, pink.exceptions.NoSolutionFound, pin.Model(body.model)
        self.solver = next(name for name in SOLVERS if name in qpsolvers.available_solvers)
        self._tasks: list[Any] = []
        for name in targets.names:
            k = body.landmark_names.index(name)
            place = pin.SE3(np.eye(3), body.landmark_local[k])
            model.addFrame(pin.Frame(f"at_{name}", int(body.landmark_joint[k]), place, pin.FrameType.OP_FRAME))
            self._tasks.append(FrameTask(f"at_{name}", position_cost=1.0, orientation_cost=0.0, lm_damping=_LM))
        self._posture = PostureTask(cost=_POSTURE)
        self._posture.set_target(body.neutral)
        self._configuration = pink.Configuration(model, model.createData(), _start(body, targets))
        self._within, self._slow = ConfigurationLimit(model), VelocityLimit(model)
        self.failed = 0

    def frame(self, points: np.ndarray, steps: int, duration: float, *, limited: bool) -> np.ndarray:
        """q (nq,) after some steps towards points (L, 3) [m] that last `duration` [s] together; limited: in speed."""
        here, dt = self._configuration, duration / steps
        limits = [self._within, self._slow] if limited else [self._within]
        for _ in range(steps):
            for task, target in zip(self._tasks, points, strict=True):
                turn = here.get_transform_frame_to_world(task.frame).rotation
                task.set_target(pin.SE3(turn, target))  # its error is the position's alone
            try:
                velocity = self._solve(
                    here, [*self._tasks, self._posture], dt, solver=self.solver, damping=_DAMPING, limits=limits,
                    safety_break=False,
                )  # fmt: skip
            except self._failure:
                self.failed += 1
                continue
            here.integrate_inplace(velocity, dt)
        return np.array(here.q)

    @property
    def q(self) -> np.ndarray:
        """Where it is."""
        return np.array(self._configuration.q)


def pink_motion(body: Body, targets: RebuiltTargets, times: np.ndarray) -> PinkMotion:
    """Position tasks of all landmarks of equal cost and a weak posture task, within pink's configuration and velocity
    limits, at times (T,) [s]; a frame with an unknown target repeats the one before it.

    Raises InputError where pink is not installed.
    """
    steps, q, begun = _PinkSteps(body, targets), list[np.ndarray](), process_time()
    for t, points in enumerate(targets.points):
        if not np.isfinite(points).all():
            q.append(steps.q)
        elif t == 0:
            q.append(steps.frame(points, _FIRST, 1.0, limited=False))
            begun = process_time()
        else:
            q.append(steps.frame(points, STEPS, float(times[t] - times[t - 1]), limited=True))
    return PinkMotion(np.array(q), (process_time() - begun) / max(len(q) - 1, 1), steps.failed)


def _start(body: Body, targets: RebuiltTargets) -> np.ndarray:
    """The neutral pose at the hips' place in the first frame, facing as they do."""
    left, right = (targets.points[0, targets.names.index(f"{side}_hip")] for side in ("left", "right"))
    q, at_rest = body.neutral.copy(), body.landmarks(body.at(body.neutral))
    hips = np.mean([at_rest[body.landmark_names.index(f"{side}_hip")] for side in ("left", "right")], axis=0)
    if not np.isfinite([left, right]).all():
        return q
    heading = np.arctan2(-(left - right)[0], (left - right)[1])  # forward is across x up
    turn = pin.Quaternion(pin.utils.rotate("z", float(heading)))
    q[ROOT_Q] = [*(0.5 * (left + right) - turn.matrix() @ hips), *turn.coeffs()]
    return q
