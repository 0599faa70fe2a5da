"""Gradients against central differences, energies along searches, residuals at their ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.speed.surface import Frame, hypotheses, rendered_frame
from benchmarks.support.common import Json, save
from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation, image_extent
from estimator.energy.cost import Cost
from estimator.energy.descent.qp import StepSolver
from estimator.energy.descent.seek import Seeker
from estimator.energy.descent.solution import Solution
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.point_targets import PointTargets
from estimator.energy.priors import GravityPrior, Stabilisers, Transition, world_up
from estimator.energy.reprojection import Reprojection
from estimator.energy.term import Term
from estimator.numerics.robust import POTENTIALS
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.detector import keypoints
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.views import scene_cameras
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run
from estimator.vision.cues.base import PastPose
from estimator.vision.cues.depth_reading import surface_precision
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageModel
from estimator.vision.stereo import DepthPoints
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, PosedBody, directions_in_world, points_in_world
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

TARGET = 1e-5
KKT_TARGET = 1e-6
ROUNDING = 1e-14  # of the energy: its last digits are noise where the gradient decides
STANDING = np.array([0.0, 0.0, 1.0])  # m, from the room's floor, which its cameras face, to the pelvis


@dataclass
class Errors:
    """Relative errors of one gradient at many poses, and how often there was something to compare."""

    values: list[float] = field(default_factory=list)

    def row(self) -> dict[str, float]:
        v = np.array(self.values)
        return {"cases": len(v), "median": float(np.median(v)), "worst": float(np.max(v)),
                "above_target": int(np.sum(v > TARGET))}  # fmt: skip


def central_difference(value: Callable[[np.ndarray], np.ndarray], body: Body, q: np.ndarray, step: float) -> np.ndarray:
    """Derivative (..., nv) of value(q) (...) through `pin.integrate`, by differences of fourth order."""
    columns = []
    for i in range(body.nv):
        v = np.zeros(body.nv)
        v[i] = step
        f = [value(pin.integrate(body.model, q, k * v)) for k in (-2, -1, 1, 2)]
        columns.append((f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * step))
    return np.stack(columns, axis=-1)


def relative(gradient: np.ndarray, difference: np.ndarray) -> float:
    """Length of the difference over the length of the gradient."""
    return float(np.linalg.norm(gradient - difference) / max(float(np.linalg.norm(gradient)), 1e-3))


def random_pose(
    body: Body, rng: np.random.Generator, middle: np.ndarray | None = None, spread: float = 1.0
) -> np.ndarray:
    """Joints anywhere within their limits, or around a pose; the root turned and moved a little."""
    i = body.bounded_q
    q = (body.neutral if middle is None else middle).copy()
    drawn = rng.uniform(body.lower[i], body.upper[i])
    q[i] = q[i] + spread * (drawn - q[i])
    return pin.integrate(body.model, q, np.concatenate([rng.normal(0.0, 0.3, 6), np.zeros(body.nv - 6)]))


def terms(body: Body, self_collision: SelfCollision, rng: np.random.Generator) -> dict[str, Callable[[], Term]]:
    """A maker for each term under test, with random data of its own."""
    cameras = scene_cameras()

    def observed(count: int) -> tuple[Observation, np.ndarray]:
        points = body.landmarks(body.at(random_pose(body, rng))) + STANDING
        pixels = np.array([c.project(points) for c in cameras[:count]]) + rng.normal(0.0, 20.0, (count, len(points), 2))
        confidence = rng.uniform(0.0, 1.0, pixels.shape[:2]) * (rng.uniform(size=pixels.shape[:2]) > 0.1)
        return Observation(0, 0.0, cameras[:count], pixels, confidence), np.full(confidence.shape, 12.0)

    made: dict[str, Callable[[], Term]] = {}
    for kind in POTENTIALS:
        made[f"keypoints, one camera, {kind}"] = lambda k=kind: Reprojection(body, *observed(1), k)  # type: ignore[misc]
    made["keypoints, two cameras, lorentzian"] = lambda: Reprojection(body, *observed(2))
    made["stabilisers"] = lambda: Stabilisers(body)
    made["upright"] = lambda: GravityPrior(body, world_up(cameras))
    for kind in ("gaussian", "lorentzian"):
        made[f"transition, {kind}"] = lambda k=kind: Transition(  # type: ignore[misc]
            body, random_pose(body, rng), rng.uniform(0.05, 0.5, body.nv), k
        )
    surface = surface_of(body, nodes=200)
    for count in (1, 2):
        made[f"depth, {count} cameras" if count > 1 else "depth, one camera"] = (
            lambda n=count: _depth(  # type: ignore[misc]
                body, surface, random_pose(body, rng), cameras[:n], rng
            )
        )
    for power in (1.0, 2.0):
        made[f"interpenetration, power {power:g}"] = lambda p=power: Interpenetration(self_collision, power=p)  # type: ignore[misc]
    return made


def _depth(
    body: Body, surface: Surface, q: np.ndarray, cameras: tuple[Camera, ...], rng: np.random.Generator
) -> PointTargets:
    """Nodes of a surface paired with noisy points of it in a pose (nq,), as the cue pairs them (ELMO eq. 1)."""
    posed = body.at(q)
    node = np.concatenate([rng.integers(0, len(surface.joint), 60) for _ in cameras])
    places = points_in_world(posed, surface.joint[node], surface.local[node]) + STANDING
    eyes = np.repeat([camera.centre_world for camera in cameras], 60, axis=0)
    away = np.linalg.norm(places - eyes, axis=1)
    rays = (places - eyes) / away[:, None]
    points = DepthPoints(places + rng.normal(0.0, 0.05, places.shape), rays, 0.005 * np.square(away), 0.003 * away)
    normals = directions_in_world(posed, surface.joint[node], surface.normal[node])
    precision = surface_precision(points, normals, 0.02, 0.1)
    return PointTargets(
        body, surface.joint[node], surface.local[node], points.places, precision,
        weight=np.full(len(node), 1.0 / len(node)), potential="lorentzian", nu=6.0, name="depth",
    )  # fmt: skip


def term_errors(body: Body, self_collision: SelfCollision, poses: int, rng: np.random.Generator) -> dict[str, Errors]:
    """Every term at random poses, in front of its cameras; a term that is flat there is drawn again."""
    by_term = {}
    for name, make in terms(body, self_collision, rng).items():
        errors = by_term[name] = Errors()
        step = 1e-6 if name.startswith("inter") else 1e-4
        while len(errors.values) < poses:
            cost, q = Cost(body, [make()]), random_pose(body, rng)
            q[:3] += STANDING
            gradient = cost.at(q).gradient
            if np.any(gradient):
                numeric = central_difference(lambda x, c=cost: np.array(c.at(x).value), body, q, step)  # type: ignore[misc]
                errors.values.append(relative(gradient, numeric))
    return by_term


def image_errors(body: Body, frame: Frame, poses: int, rng: np.random.Generator) -> dict[str, Errors]:
    """Features of a rendered frame, assigned at hypotheses around the truth and then kept, cue by cue and camera by
    camera."""
    model = ImageModel(body)
    by_term: dict[str, Errors] = {}
    before = body.at(frame.q_before)
    for cues in frame.cues:
        points = cues.camera.project(body.landmarks(body.at(frame.q)))
        likelihood = CameraLikelihood(model, cues, image_extent(points, np.ones(len(points))))
        for q in hypotheses(body, frame.q, poses, rng):
            for name, term in image_terms(likelihood, before, body.at(q)).items():
                cost = Cost(body, [term])
                numeric = central_difference(lambda x, c=cost: np.array(c.at(x).value), body, q, 1e-4)  # type: ignore[misc]
                by_term.setdefault(name, Errors()).values.append(relative(cost.at(q).gradient, numeric))
    return by_term


def image_terms(likelihood: CameraLikelihood, before: PosedBody, posed: PosedBody) -> dict[str, Term]:
    """The energy of each cue around a pose, and of all together."""
    prediction = likelihood.predictor.predict(posed)
    matches = likelihood.contours(prediction)
    made: dict[str, Term] = {m.label: likelihood.on_contours(prediction, [m.features]) for m in matches}
    made |= {term.name: term for term in likelihood.others(posed, prediction)}
    for followed in likelihood.follow([PastPose(before, posed)]):
        made |= {term.name: term for term in likelihood.since(followed)}
    made["all on contours"] = likelihood.assigned(posed)[0]
    return made


def self_collision_errors(body: Body, self_collision: SelfCollision, poses: int, rng: np.random.Generator) -> Errors:
    """Distance of every near pair at random poses."""
    errors, wide = Errors(), 2.0 * self_collision.margin
    while len(errors.values) < poses:
        q = random_pose(body, rng)
        here = self_collision.near(body.at(q))
        if not here.pair.size:
            continue

        def distances(x: np.ndarray, pairs: np.ndarray = here.pair) -> np.ndarray:
            near = self_collision.near(body.at(x), wide)
            known = dict(zip(near.pair.tolist(), near.distance.tolist(), strict=True))
            return np.array([known.get(p, np.nan) for p in pairs.tolist()])

        numeric = central_difference(distances, body, q, 1e-6)
        errors.values += [relative(g, n) for g, n in zip(here.gradient, numeric, strict=True)]
    return errors


def proportion_errors(poses: int, rng: np.random.Generator) -> Errors:
    """Landmarks by the proportions, which the fit descends on."""
    subject = load_subject("human34")
    proportions, errors, step = ProportionedBody(subject), Errors(), 1e-4
    for _ in range(poses):
        scales = rng.uniform(proportions.low + step, proportions.high - step)
        body = proportions.at(scales)
        q = random_pose(body, rng)
        D = proportions.landmark_derivatives(body.at(q))
        for k in range(len(scales)):
            sides = []
            for sign in (-1.0, 1.0):
                moved = scales.copy()
                moved[k] += sign * step
                other = proportions.at(moved)
                sides.append(other.landmarks(other.at(q)))
            errors.values.append(relative(D[:, :, k], (sides[1] - sides[0]) / (2.0 * step)))
    return errors


class Watch(StepSolver):
    """A step solver that records where steps were requested: these are the accepted poses of a search."""

    seen: list[np.ndarray]

    def solve(self, hessian, gradient, damping, radius, q, active, rows=None):  # type: ignore[no-untyped-def]
        if not self.seen or self.seen[-1] is not q:
            self.seen.append(q)
        return super().solve(hessian, gradient, damping, radius, q, active, rows)


@dataclass
class Descents:
    """Statistics of many searches: rises are relative to the energy."""

    statuses: dict[str, int] = field(default_factory=dict)
    steps: int = 0
    rose: int = 0
    rose_beyond_rounding: int = 0
    largest_rise: float = 0.0
    largest_residual: float = 0.0
    outside: int = 0

    def add(self, body: Body, cost: Cost, seen: list[np.ndarray], solution: Solution) -> None:
        path = seen if seen and seen[-1] is solution.q else [*seen, solution.q]
        values = np.array([cost.value_at(q) for q in path])
        rises = np.diff(values) / (1.0 + np.abs(values[:-1]))
        self.steps += len(rises)
        self.rose += int(np.sum(rises > 0.0))
        self.rose_beyond_rounding += int(np.sum(rises > ROUNDING))
        self.largest_rise = max(self.largest_rise, float(np.max(rises, initial=0.0)))
        self.statuses[solution.status] = self.statuses.get(solution.status, 0) + 1
        self.outside += bool(np.any((solution.q < body.lower) | (solution.q > body.upper)))
        if solution.status == "converged":
            self.largest_residual = max(self.largest_residual, projected(body, cost, solution.q))


def projected(body: Body, cost: Cost, q: np.ndarray) -> float:
    """Largest entry of the gradient that no active limit holds, recomputed independently of the search's code."""
    gradient = cost.at(q).gradient
    low, high = body.tangent_bounds(q)
    held = ((low >= 0.0) & (gradient > 0.0)) | ((high <= 0.0) & (gradient < 0.0))
    return float(np.max(np.abs(np.where(held, 0.0, gradient)), initial=0.0))


def descents(body: Body, self_collision: SelfCollision, searches: int, rng: np.random.Generator) -> Descents:
    """Searches on the tracker's energy, transition and interpenetration included, from starts near and far."""
    model, seeker, total = CostModel(body, CostSettings(), self_collision), Seeker(body), Descents()
    seeker.solver = watch = Watch(body)
    motion = authored_motion(body, np.linspace(0.0, 2.9, 60))
    cameras = scene_cameras()
    for k in range(searches):
        t = int(rng.integers(1, len(motion)))
        pixels = np.array([c.project(body.landmarks(body.at(motion[t]))) for c in cameras[: 1 + k % 2]])
        pixels = pixels + rng.normal(0.0, 4.0, pixels.shape)
        observation = Observation(0, 0.0, cameras[: 1 + k % 2], pixels, np.ones(pixels.shape[:2]))
        before = motion[t - 1] if k % 3 else None
        cost = model.cost(model.observation_term(observation), before, 1.0 / 30.0)
        q = body.clamp(random_pose(body, rng, motion[t], spread=float(rng.uniform(0.0, 0.6))))
        watch.seen = []
        total.add(body, cost, watch.seen, seeker.seek(cost, q))
    return total


def tracked(frames: int, seed: int) -> dict[str, Any]:
    """Modes that a tracker keeps, contact searches included: their statuses, and the residuals of the converged."""
    body = Body(load_subject("human34"))
    times = np.arange(frames) / 30.0
    q, cameras = authored_motion(body, times), scene_cameras()[1:]
    (track,) = keypoints(body, q, cameras, np.random.default_rng((seed, 0)), fps=30.0)
    order = [track.names.index(n) if n in track.names else -1 for n in body.landmark_names]
    pixels = np.where(np.array(order)[:, None] >= 0, track.pixels[:, order], np.nan)
    confidence = np.where(np.array(order) >= 0, track.confidence[:, order], 0.0)
    observations = [
        Observation(i, float(times[i]), cameras, pixels[i][None], confidence[i][None]) for i in range(frames)
    ]
    statuses: dict[str, int] = {}
    worst = 0.0
    for _, state in run(make_tracker("css", body), observations, seed):
        for mode in state.mixture.modes if state is not None else ():
            statuses[mode.status] = statuses.get(mode.status, 0) + 1
            if mode.status == "converged":
                worst = max(worst, mode.kkt_residual)
    return {"modes": statuses, "largest_residual": worst}


def main(
    *, poses: int = 40, searches: int = 400, frames: int = 60, seed: int = 0,
    json: Json = None,
) -> None:  # fmt: skip
    """Compare gradients with central differences; watch energies and residuals of many searches.

    Parameters
    ----------
    poses
        Random poses of each term, of the image's over both cameras, and pairs of signed distances.
    searches
        Single searches on the tracker's energy.
    frames
        Frames of the built-in motion that are tracked for the statuses of modes.
    seed
        Of everything.
    """
    rng = np.random.default_rng(seed)
    body = Body(load_subject("human34"))
    self_collision = SelfCollision(body)
    errors = term_errors(body, self_collision, poses, rng)
    errors |= image_errors(body, rendered_frame(body, rng, cameras=2), max(1, poses // 2), rng)
    errors["signed distance, each pair"] = self_collision_errors(body, self_collision, 5 * poses, rng)
    errors["landmarks by proportions"] = proportion_errors(max(1, poses // 4), rng)
    rows = {name: e.row() for name, e in errors.items()}
    down = descents(body, self_collision, searches, rng)
    modes = tracked(frames, seed)
    show(rows, down, modes)
    save(json, {"measure": "gradients", "target": TARGET, "gradients": rows, "descents": vars(down), "tracked": modes})


def show(rows: dict[str, dict[str, float]], down: Descents, modes: dict[str, Any]) -> None:
    made = report.table(
        f"relative error against central differences, target {TARGET:.0e}", "gradient of", "cases", "median", "worst",
        "above",
    )  # fmt: skip
    for name, row in rows.items():
        made.add_row(name, str(row["cases"]), f"{row['median']:.1e}", f"{row['worst']:.1e}", str(row["above_target"]))
    out = report.console()
    out.print(made)
    made = report.table("searches on the tracker's energy", "", "")
    made.add_row("ended", ", ".join(f"{n} {s}" for s, n in down.statuses.items()))
    made.add_row("accepted steps", str(down.steps))
    made.add_row("of them the energy rose", f"{down.rose} ({down.rose / max(1, down.steps):.3%})")
    made.add_row(f"by more than {ROUNDING:.0e} of it", str(down.rose_beyond_rounding))
    made.add_row("largest rise, relative", f"{down.largest_rise:.1e}")
    made.add_row("largest KKT residual where converged", f"{down.largest_residual:.1e}")
    made.add_row("ended outside the limits", str(down.outside))
    made.add_section()
    made.add_row("tracked modes", ", ".join(f"{n} {s}" for s, n in modes["modes"].items()))
    made.add_row("largest KKT residual where converged", f"{modes['largest_residual']:.1e}")
    made.add_row("target", f"{KKT_TARGET:.0e}")
    out.print(made)
