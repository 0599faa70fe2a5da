"""One constrained step of the 34-degree body on 17 landmarks, side by side with `pink.solve_ik` on the same tasks.

Both start at the same q, have the same landmarks with the same targets in the world and the same joint limits, and end
with a new q. Repeats alternate in one process, so that a busy machine slows both.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pink
import pinocchio as pin
from pink.limits import ConfigurationLimit
from pink.tasks import FrameTask

from benchmarks.support.common import Json, save
from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.descent.qp import PROXQP, STEP_SOLVERS, StepSolver
from estimator.energy.descent.seek import trust_box
from estimator.energy.point_targets import PointTargets
from estimator.energy.priors import Stabilisers
from estimator.energy.reprojection import Reprojection
from estimator.energy.term import Term
from estimator.synthesis.views import scene_cameras
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import COCO17
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

TARGET = 0.2
DAMPING = 1e-6
WIDE = 1e3  # a trust box that never binds: pink has none
STANDING = np.array([0.0, 0.0, 1.0])  # m, from the room's floor, which its cameras face, to the pelvis
OURS, PINK, STRAIGHT = "kinemode", "pink", "pink, errors linear in the world"
OFFSET = 0.15  # standard deviation of the joints between start and target [rad]; root moved by as many metres


@dataclass(frozen=True)
class Problem:
    """Start q (nq,) and targets (17, 3) in the world [m]."""

    q: np.ndarray
    targets: np.ndarray


class StraightTask(FrameTask):
    """The same error, a point's place less its target in the frame's axes, with the derivative of the point alone.

    pink's is the logarithm of a placement: as the frame turns its axes turn too, half of which its derivative has.
    """

    def compute_jacobian(self, configuration: pink.Configuration) -> np.ndarray:
        """The Jacobian of the error (6,), as the frame moves: (6, nv)."""
        return np.asarray(-configuration.get_frame_jacobian(self.frame))


class Contest:
    """The two sides of the comparison, on the same problems."""

    def __init__(self, problems: int, rng: np.random.Generator) -> None:
        subject = load_subject("human34")
        self.body = Body(subject)
        self.index = np.array([self.body.landmark_names.index(name) for name in COCO17])
        self.problems = [self._problem(rng) for _ in range(problems)]
        self.radius = trust_box(self.body, WIDE, WIDE)
        self.solvers = {name: StepSolver(self.body, name) for name in STEP_SOLVERS}
        self._pink_model(pin.Model(subject.model))
        camera = scene_cameras()[:1]
        self.costs = [Cost(self.body, [self._targets(p.targets)]) for p in self.problems]
        self.image_costs = [self._image_cost(p, camera) for p in self.problems]

    def _targets(self, targets: np.ndarray) -> PointTargets:
        """Least squares 1/2 sum |p - target|^2 of landmarks: pink's sum of position tasks as a term of the cost."""
        joint, local = self.body.landmark_joint[self.index], self.body.landmark_local[self.index]
        return PointTargets(self.body, joint, local, targets, np.tile(np.eye(3), (len(joint), 1, 1)))

    def _problem(self, rng: np.random.Generator) -> Problem:
        """A start with joints anywhere within their limits, some on them; targets from a pose near it, within them."""
        body, i = self.body, self.body.bounded_q
        q = body.neutral.copy()
        q[i] = rng.normal(q[i], 0.35 * (body.upper[i] - body.lower[i]))
        q = body.integrate(q, np.concatenate([rng.normal(0.0, 0.3, 6), np.zeros(body.nv - 6)]))
        other = body.integrate(q, rng.normal(0.0, OFFSET, body.nv))
        return Problem(q, body.landmarks(body.at(other))[self.index])

    def _image_cost(self, problem: Problem, cameras: tuple[Camera, ...]) -> Cost:
        """The tracker's own energy of a frame: keypoints in a camera, and stabilisers."""
        body = self.body
        pixels = np.full((1, len(body.landmark_names), 2), np.nan)
        pixels[0, self.index] = cameras[0].project(problem.targets + STANDING)
        confidence = np.isfinite(pixels[..., 0]).astype(float)
        observation = Observation(0, 0.0, cameras, pixels, confidence)
        terms: list[Term] = [Reprojection(body, observation, np.full(confidence.shape, 5.0)), Stabilisers(body)]
        return Cost(body, terms)

    def _pink_model(self, model: pin.Model) -> None:
        for k in self.index:
            joint, local = int(self.body.landmark_joint[k]), self.body.landmark_local[k]
            frame = pin.Frame(f"at_{k}", joint, pin.SE3(np.eye(3), local), pin.FrameType.OP_FRAME)
            model.addFrame(frame)
        self.model, self.data = model, model.createData()
        self.tasks, self.straight = (
            [kind(f"at_{k}", position_cost=1.0, orientation_cost=0.0) for k in self.index]
            for kind in (FrameTask, StraightTask)
        )
        self.limits = [ConfigurationLimit(model, config_limit_gain=1.0)]
        self.configuration = pink.Configuration(model, self.data, self.body.neutral)

    def prepare_pink(self, problem: Problem) -> None:
        """Targets keep the frames' own orientation: then pink's error is the position's alone."""
        self.configuration.update(problem.q)
        for tasks in (self.tasks, self.straight):
            for task, target in zip(tasks, problem.targets, strict=True):
                here = self.configuration.get_transform_frame_to_world(task.frame)
                task.set_target(pin.SE3(here.rotation, target))

    def ours(self, cost: Cost, q: np.ndarray, solver: StepSolver) -> np.ndarray:
        """Posing, quadratic, bounded step, new q."""
        here = cost.at(q)
        active = np.zeros(self.body.nv, dtype=np.int8)
        step = solver.solve(here.hessian, here.gradient, DAMPING, self.radius, q, active)
        return self.body.integrate(q, np.zeros(self.body.nv) if step is None else step[0])

    def pink_solve(self, tasks: list[FrameTask] | None = None) -> np.ndarray:
        """`pink.solve_ik` alone: the body is posed already."""
        return np.asarray(
            pink.solve_ik(
                self.configuration, tasks or self.tasks, 1.0, solver="proxqp", damping=DAMPING, limits=self.limits,
                safety_break=False,
            )
        )  # fmt: skip

    def pink_step(self, q: np.ndarray, tasks: list[FrameTask] | None = None) -> np.ndarray:
        """Posing, solve, new q."""
        self.configuration.update(q)
        return np.asarray(self.configuration.integrate(self.pink_solve(tasks), 1.0))

    def error(self, problem: Problem, q: np.ndarray) -> float:
        """Root mean square distance of the landmarks from their targets [mm]."""
        off = self.body.landmarks(self.body.at(q))[self.index] - problem.targets
        return 1e3 * float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


def main(
    *,
    problems: int = 60,
    rounds: int = 15,
    seed: int = 0,
    json: Json = None,
) -> None:
    """Time one constrained step against `pink.solve_ik` (ProxQP through qpsolvers).

    Parameters
    ----------
    problems
        Different poses and targets.
    rounds
        How often all of them are stepped by each side in turn.
    seed
        Of the poses.
    """
    contest = Contest(problems, np.random.default_rng(seed))
    times = timed(contest, rounds)
    figures = compared(contest, times)
    show(figures)
    save(json, {"measure": "step", "problems": problems, "rounds": rounds, "versions": versions(), **figures})


def timed(contest: Contest, rounds: int) -> dict[str, np.ndarray]:
    """Microseconds of every side on every problem, (rounds, problems), in turn; the first round is thrown away.

    Who comes first changes from problem to problem: caches are cold for the first.
    """
    times: dict[str, list[list[float]]] = {}
    rng = np.random.default_rng(0)
    for _ in range(rounds + 1):
        for k, problem in enumerate(contest.problems):
            contest.prepare_pink(problem)
            q, cost, image = problem.q, contest.costs[k], contest.image_costs[k]
            sides: dict[str, Callable[[], object]] = {
                "pink.solve_ik": contest.pink_solve,
                "pink: pose, solve_ik, integrate": partial(contest.pink_step, q),
                **{
                    f"kinemode: the same tasks, {name}": partial(contest.ours, cost, q, solver)
                    for name, solver in contest.solvers.items()
                },
                "kinemode: keypoints, stabilisers": partial(contest.ours, image, q, contest.solvers[PROXQP]),
            }
            for i in rng.permutation(len(sides)):
                name, side = list(sides.items())[i]
                start = time.perf_counter()
                side()
                times.setdefault(name, [[] for _ in contest.problems])[k].append(1e6 * (time.perf_counter() - start))
    return {name: np.array(times[name])[:, 1:].T for name in sides}


def compared(contest: Contest, times: dict[str, np.ndarray]) -> dict[str, Any]:
    ends: dict[str, list[float]] = {"start": [], **{side: [] for side in (OURS, PINK, STRAIGHT)}}
    body, solver, equal, inside, active = contest.body, StepSolver(contest.body), 0, 0, []
    i = body.bounded_q
    for problem, cost in zip(contest.problems, contest.costs, strict=True):
        contest.prepare_pink(problem)
        q_ours = contest.ours(cost, problem.q, solver)
        ends["start"].append(contest.error(problem, problem.q))
        ends[OURS].append(contest.error(problem, q_ours))
        ends[PINK].append(contest.error(problem, contest.pink_step(problem.q)))
        ends[STRAIGHT].append(contest.error(problem, contest.pink_step(problem.q, contest.straight)))
        equal += all(np.array_equal(q_ours, contest.ours(cost, problem.q, s)) for s in contest.solvers.values())
        inside += bool(np.all((q_ours >= body.lower) & (q_ours <= body.upper)))
        active.append(int(np.sum((q_ours[i] <= body.lower[i]) | (q_ours[i] >= body.upper[i]))))
    reduced = [np.array(ends[side]) < ends["start"] for side in (OURS, PINK)]
    base = times["pink.solve_ik"]
    return {
        "us": {name: float(np.median(t)) for name, t in times.items()},
        "ratio": {name: float(np.median(t / base)) for name, t in times.items()},
        "rms_error_mm": {side: float(np.median(errors)) for side, errors in ends.items()},
        "reduced_by_both": int(np.sum(reduced[0] & reduced[1])),
        "within_limits": inside,
        "limits_active_after": float(np.mean(active)),
        "steps": solver.counts._asdict(),
        "equal_bits": equal,
        "count": len(contest.problems),
    }


def versions() -> dict[str, str]:
    import qpsolvers

    return {"pink": pink.__version__, "qpsolvers": qpsolvers.__version__, "pinocchio": pin.__version__}


def show(f: dict[str, Any]) -> None:
    out = report.console()
    made = report.table("one constrained step, 34 degrees of freedom, 17 landmarks", "median", "us", "of pink.solve_ik")
    for name, us in f["us"].items():
        made.add_row(name, f"{us:.0f}", f"{f['ratio'][name]:.3f}")
    made.add_row("target", "", f"{TARGET:.3f}")
    out.print(made)
    made = report.table("after one step: root mean square distance from the targets, median", "", "mm")
    for name, error in f["rms_error_mm"].items():
        made.add_row(name, f"{error:.1f}")
    out.print(made)
    steps = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in f["steps"].items())
    out.print(
        f"both steps reduce it in {f['reduced_by_both']} of {f['count']} problems; ours end within the limits in"
        f" {f['within_limits']}, with {f['limits_active_after']:.1f} limits active; by solver: {steps}; with every"
        f" search.step_solver the same to the last bit in {f['equal_bits']}"
    )
