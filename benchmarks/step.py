"""One constrained step of the 34-degree body on 17 landmarks, side by side with `pink.solve_ik` on the same tasks.

Both start at the same q, have the same landmarks with the same targets in the world and the same joint limits, and end
with a new q. Repeats alternate in one process, so that a busy machine slows both.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pink
import pinocchio as pin
from cyclopts import Parameter
from pink.limits import ConfigurationLimit
from pink.tasks import FrameTask

from benchmarks.common import save, start
from estimator.cameras.camera import Camera
from estimator.imaging.observation import Observation
from estimator.optimise.qp import StepSolver
from estimator.optimise.seek import trust_box
from estimator.synthesis import scene_cameras
from estimator.terms.point_targets import PointTargets
from estimator.terms.priors import Stabilisers
from estimator.terms.reprojection import Reprojection
from estimator.terms.term import Cost, Term
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import COCO17
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

TARGET = 0.2
DAMPING = 1e-6
WIDE = 1e3  # a trust box that never binds: pink has none
STANDING = np.array([0.0, 0.0, 1.0])  # m, from the room's floor, which its cameras look at, to the pelvis
OFFSET = 0.15  # standard deviation of the joints between start and target [rad]; root moved by as many metres


@dataclass(frozen=True)
class Problem:
    """Start q (nq,) and targets (17, 3) in the world [m]."""

    q: np.ndarray
    targets: np.ndarray


class Contest:
    """The two sides of the comparison, on the same problems."""

    def __init__(self, problems: int, rng: np.random.Generator) -> None:
        subject = load_subject("human34")
        self.body = Body(subject)
        self.index = np.array([self.body.landmark_names.index(name) for name in COCO17])
        self.problems = [self._problem(rng) for _ in range(problems)]
        self.radius = trust_box(self.body, WIDE, WIDE)
        self.guessing, self.solving = StepSolver(self.body), StepSolver(self.body, active_set_rounds=0)
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
        self.tasks = [FrameTask(f"at_{k}", position_cost=1.0, orientation_cost=0.0) for k in self.index]
        self.limits = [ConfigurationLimit(model, config_limit_gain=1.0)]
        self.configuration = pink.Configuration(model, self.data, self.body.neutral)

    def prepare_pink(self, problem: Problem) -> None:
        """Targets keep the frames' own orientation: then pink's error is the position's alone."""
        self.configuration.update(problem.q)
        for task, target in zip(self.tasks, problem.targets, strict=True):
            here = self.configuration.get_transform_frame_to_world(task.frame)
            task.set_target(pin.SE3(here.rotation, target))

    def ours(self, cost: Cost, q: np.ndarray, solver: StepSolver) -> np.ndarray:
        """Posing, quadratic, bounded step, new q."""
        here = cost.at(q)
        active = np.zeros(self.body.nv, dtype=np.int8)
        step = solver.solve(here.hessian, here.gradient, DAMPING, self.radius, q, active)
        return self.body.integrate(q, np.zeros(self.body.nv) if step is None else step[0])

    def pink_solve(self) -> np.ndarray:
        """`pink.solve_ik` alone: the body is posed already."""
        return np.asarray(
            pink.solve_ik(
                self.configuration, self.tasks, 1.0, solver="proxqp", damping=DAMPING, limits=self.limits,
                safety_break=False,
            )
        )  # fmt: skip

    def pink_step(self, q: np.ndarray) -> np.ndarray:
        """Posing, solve, new q."""
        self.configuration.update(q)
        return np.asarray(self.configuration.integrate(self.pink_solve(), 1.0))

    def error(self, problem: Problem, q: np.ndarray) -> float:
        """Root mean square distance of the landmarks from their targets [mm]."""
        off = self.body.landmarks(self.body.at(q))[self.index] - problem.targets
        return 1e3 * float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


def main(
    *,
    problems: int = 60,
    rounds: int = 15,
    seed: int = 0,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
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
    json
        Also write the figures here.
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
                "kinemode: the same tasks": partial(contest.ours, cost, q, contest.guessing),
                "kinemode: the same, ProxQP forced": partial(contest.ours, cost, q, contest.solving),
                "kinemode: keypoints, stabilisers": partial(contest.ours, image, q, contest.guessing),
            }
            for i in rng.permutation(len(sides)):
                name, side = list(sides.items())[i]
                start = time.perf_counter()
                side()
                times.setdefault(name, [[] for _ in contest.problems])[k].append(1e6 * (time.perf_counter() - start))
    return {name: np.array(times[name])[:, 1:].T for name in sides}


def compared(contest: Contest, times: dict[str, np.ndarray]) -> dict[str, Any]:
    before, ours, theirs, forced, inside, active = [], [], [], [], 0, []
    i = contest.body.bounded_q
    for problem, cost in zip(contest.problems, contest.costs, strict=True):
        contest.prepare_pink(problem)
        q_pink = contest.pink_step(problem.q)
        q_ours = contest.ours(cost, problem.q, contest.guessing)
        before.append(contest.error(problem, problem.q))
        ours.append(contest.error(problem, q_ours))
        forced.append(contest.error(problem, contest.ours(cost, problem.q, contest.solving)))
        theirs.append(contest.error(problem, q_pink))
        body = contest.body
        inside += bool(np.all((q_ours >= body.lower) & (q_ours <= body.upper)))
        active.append(int(np.sum((q_ours[i] <= body.lower[i]) | (q_ours[i] >= body.upper[i]))))
    counts = contest.guessing.counts
    base = times["pink.solve_ik"]
    return {
        "us": {name: float(np.median(t)) for name, t in times.items()},
        "ratio": {name: float(np.median(t / base)) for name, t in times.items()},
        "rms_error_mm": {"start": np.median(before), "kinemode": np.median(ours), "kinemode, ProxQP": np.median(forced),
                         "pink": np.median(theirs)},
        "reduced_by_both": int(np.sum((np.array(ours) < before) & (np.array(theirs) < before))),
        "within_limits": inside,
        "limits_active_after": float(np.mean(active)),
        "settled_by_guess": counts.guessed / max(1, counts.guessed + counts.proxqp),
        "count": len(before),
    }  # fmt: skip


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
    made = report.table("root mean square distance from the targets, median", "", "mm")
    for name, error in f["rms_error_mm"].items():
        made.add_row(name, f"{error:.1f}")
    out.print(made)
    out.print(
        f"both steps reduce it in {f['reduced_by_both']} of {f['count']} problems; ours end within the limits in"
        f" {f['within_limits']}, with {f['limits_active_after']:.1f} limits active; {f['settled_by_guess']:.1%} of our"
        " steps were settled on the guessed active set"
    )


if __name__ == "__main__":
    start(main)
