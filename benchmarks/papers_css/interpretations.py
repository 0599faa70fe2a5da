"""Forward and backward: which of the interpretations of one picture are found within the budget of one frame.

Random poses are seen by one camera with exact keypoints. Every limb of two segments (upper arm and forearm, thigh and
shank) has up to four solutions, so that a person has up to 2^8 interpretations. Which of them the joint limits allow is
decided by another method: for each of the four signs of each limb, scipy's bounded least squares brings the limb's two
outer joints onto their pixels from many random angles, root and trunk being held, with a price for the wrong sign. A
solution is reachable exactly if some start ends within 0.05 pixels of the image; solutions that the limits keep up to a
pixel off are counted beside these. Limbs share no joint, so the reachable interpretations are the
products of the limbs' solutions.

An interpretation is found if one of the configurations that `KinematicJumps.interpretations` yields has every limb's
joints
within 5 cm of it and within a pixel. The pose itself counts as found: it is the parent. Two budgets: the first 40, as
many as the searches of one frame of `css`; and those that are made and searched from in 66 ms of processor time, a
frame at 15 a second.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import product
from typing import Annotated, Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from benchmarks.support.common import Json, Several, in_processes, save, tell
from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.search.cost_model import CostModel
from estimator.search.jumps import KinematicJumps
from estimator.search.mode_search import ModeSearch
from humanoid.kinematics.body import ROOT_TURN_Q, Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

SEARCHES, FRAME = 40, 1.0 / 15.0  # searches and seconds of a frame
TARGET = 0.95
LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
NEARLY = 1.0  # px
REACHABLE = {"exactly": 0.05, "within a pixel": NEARLY}  # px
SAME_SOLUTION = 0.05  # m
STARTS = 16  # of every sign of every limb
DISTANCE = 3.5  # m


class Task(NamedTuple):
    """A subject and the seed of one pose of it."""

    subject: str
    seed: int
    starts: int


class Known(NamedTuple):
    """A solution of a limb: its middle and end (2, 3) [m], and how far from their pixels they are at most [px]."""

    points: np.ndarray
    off: float


class Outcome(NamedTuple):
    """The result for one pose.

    reachable: its interpretations. early, in_time, ever: how many of them are among the first 40, among those made and
    searched from in a frame's time, and among all. made: how many configurations that time allows. seconds: of making
    all, without searches.
    """

    reachable: int
    early: int
    in_time: int
    ever: int
    made: int
    seconds: float


def limbs_of(body: Body) -> list[list[int]]:
    """Landmarks of the limbs: root, middle, end."""
    names = body.landmark_names
    chains = [[f"{side}_{p}" for p in limb] for limb in LIMBS for side in ("left", "right")]
    return [[names.index(n) for n in chain] for chain in chains if all(n in names for n in chain)]


def plausible_pose(body: Body, rng: np.random.Generator) -> np.ndarray:
    """Joints at deviations from rest as the stabilisers have them, within limits; a free root upright but for 0.2
    rad."""
    q = body.neutral.copy()
    for s in body.subject.stabilisers:
        i = body.model.idx_qs[body.model.getJointId(s.joint)]
        q[i] = s.rest + s.std * rng.standard_normal()
    q = body.clamp(q)
    if body.has_free_root:
        turn = pin.exp3(0.2 * rng.standard_normal(3)) @ pin.exp3(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        q[ROOT_TURN_Q] = pin.Quaternion(turn).coeffs()
    return q


def camera_for(body: Body, q: np.ndarray, rng: np.random.Generator) -> Camera:
    """A 640 x 480 camera anywhere around the body, up to 0.6 m above or below it, facing its middle."""
    middle = body.landmarks(body.at(q)).mean(axis=0)
    angle = rng.uniform(-np.pi, np.pi)
    eye = middle + DISTANCE * np.array([np.cos(angle), np.sin(angle), 0.0]) + [0.0, 0.0, rng.uniform(-0.6, 0.6)]
    forward = (middle - eye) / np.linalg.norm(middle - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[700.0, 0.0, 319.5], [0.0, 700.0, 239.5], [0.0, 0.0, 1.0]])
    return Camera("cam", (640, 480), K, np.zeros(5), R, -R @ eye)


class Oracle:
    """The solutions of a limb by brute force."""

    def __init__(self, body: Body, q: np.ndarray, camera: Camera, limb: list[int]) -> None:
        self.body, self.q, self.camera, self.limb = body, q, camera, limb
        middle = q.copy()  # a pose in which no limb is straight
        middle[body.bounded_q] = 0.5 * (body.lower[body.bounded_q] + body.upper[body.bounded_q])
        moves = np.abs(body.landmark_jacobians(body.at(middle))[limb]).max(axis=1) > 1e-9
        self.dofs = np.intersect1d(np.flatnonzero((moves[1] | moves[2]) & ~moves[0]), body.bounded_v)
        low, high = body.tangent_bounds(q)
        self.low, self.high = low[self.dofs], high[self.dofs]
        points = body.landmarks(body.at(q))
        self.pixels = camera.project(points[limb[1:]])
        self.rays = points[limb[1:]] - camera.centre_world
        self.rays /= np.linalg.norm(self.rays, axis=1)[:, None]

    def points(self, turns: np.ndarray) -> np.ndarray:
        """Root, middle and end [m], (3, 3)."""
        step = np.zeros(self.body.nv)
        step[self.dofs] = turns
        return np.asarray(self.body.landmarks(self.body.at(pin.integrate(self.body.model, self.q, step)))[self.limb])

    def residual(self, turns: np.ndarray, signs: tuple[int, ...], price: float) -> np.ndarray:
        """Pixels off, and `price` pixels a centimetre that a segment slopes the wrong way."""
        points = self.points(turns)
        off = (self.camera.project(points[1:]) - self.pixels).ravel()
        slope = np.einsum("ij,ij->i", np.diff(points, axis=0), self.rays)
        return np.concatenate([np.nan_to_num(off, nan=1e3), price * np.minimum(100.0 * slope * signs, 0.0)])

    def solutions(self, rng: np.random.Generator, starts: int) -> list[Known]:
        """Every reachable solution; of those that nearly coincide the one nearest to its pixels."""
        ends = [Known(self.points(np.zeros(len(self.dofs)))[1:], 0.0)]
        for signs in product((-1, 1), repeat=2):
            for _ in range(starts):
                turns = rng.uniform(self.low, self.high)
                for price in (5.0, 0.0):  # driven to the sign, then let go
                    turns = least_squares(
                        self.residual, np.clip(turns, self.low + 1e-9, self.high - 1e-9), bounds=(self.low, self.high),
                        args=(signs, price), max_nfev=40,
                    ).x  # fmt: skip
                ends.append(Known(self.points(turns)[1:], float(np.abs(self.residual(turns, signs, 0.0)).max())))
        distinct: list[Known] = []
        for end in sorted(ends, key=lambda e: e.off):
            apart = all(np.linalg.norm(end.points - f.points, axis=1).max() > SAME_SOLUTION for f in distinct)
            if end.off < NEARLY and apart:
                distinct.append(end)
        return distinct


def measured(task: Task) -> dict[str, Outcome]:
    """One pose: what is reachable, exactly and within a pixel, and what is found."""
    rng = np.random.default_rng([task.seed, len(task.subject)])
    body = Body(load_subject(task.subject))
    q = plausible_pose(body, rng)
    camera = camera_for(body, q, rng)
    limbs = limbs_of(body)
    solutions = [Oracle(body, q, camera, limb).solutions(rng, task.starts) for limb in limbs]
    jumps = KinematicJumps(body)
    list(jumps.interpretations(q, camera))  # compiles
    begin = time.process_time()
    made = [q, *jumps.interpretations(q, camera)]
    seconds = time.process_time() - begin
    in_time = searched_in_time(body, q, camera, jumps)
    seen = [found_by(body, x, camera, q, limbs, solutions) for x in made]
    outcomes = {}
    for name, off in REACHABLE.items():
        wanted = set(product(*([i for i, known in enumerate(r) if known.off < off] for r in solutions)))
        first, timely, ever = (len(wanted.intersection(seen[:n])) for n in (SEARCHES + 1, in_time + 1, len(seen)))
        outcomes[name] = Outcome(len(wanted), first, timely, ever, in_time, seconds)
    return outcomes


def found_by(
    body: Body, q: np.ndarray, camera: Camera, truth: np.ndarray, limbs: list[list[int]], solutions: list[list[Known]]
) -> tuple[int, ...] | None:
    """The interpretation of a configuration, by the solution of every limb; None without one."""
    points, true = body.landmarks(body.at(q)), body.landmarks(body.at(truth))
    outer = [k for limb in limbs for k in limb[1:]]
    if np.abs(camera.project(points[outer]) - camera.project(true[outer])).max() > NEARLY:
        return None
    which = []
    for limb, known in zip(limbs, solutions, strict=True):
        off = [np.linalg.norm(points[limb[1:]] - k.points, axis=1).max() for k in known]
        if min(off) > SAME_SOLUTION:
            return None
        which.append(int(np.argmin(off)))
    return tuple(which)


def searched_in_time(body: Body, q: np.ndarray, camera: Camera, jumps: KinematicJumps) -> int:
    """The number of interpretations made and explored, as a frame's hypotheses are, in the time of a frame."""
    model = CostModel(body)
    search = ModeSearch(model)
    pixels = camera.project(body.landmarks(body.at(q)))[None]
    observed = Observation(0, 0.0, (camera,), pixels, np.ones(pixels.shape[:2]))
    cost = model.cost(model.observation_term(observed))
    search.seeker.seek(cost, q, search.settings.explore)  # compiles
    begin, count = time.process_time(), 0
    for other in jumps.interpretations(q, camera):
        search.seeker.seek(cost, other, search.settings.explore)
        if time.process_time() - begin > FRAME:
            break
        count += 1
    return count


def tasks_of(subjects: tuple[str, ...], poses: int, starts: int, seed: int) -> Iterator[Task]:
    for subject in subjects:
        yield from (Task(subject, seed + k, starts) for k in range(poses))


def main(
    *,
    subjects: Annotated[tuple[str, ...], Several] = ("human34", "upper13", "arm8"),
    poses: int = 10,
    starts: int = STARTS,
    seed: int = 100,
    jobs: int = 1,
    json: Json = None,
) -> None:
    """Count the interpretations of random poses that are found within a frame's budget.

    Parameters
    ----------
    subjects
        Bodies with arms or legs.
    poses
        Random poses of each.
    starts
        Random starts of the brute force for each sign of each limb.
    seed
        Of the first pose; the others follow.
    jobs
        Poses measured at a time; above 1 the times are of busy cores.
    """
    tasks = list(tasks_of(subjects, poses, starts, seed))
    tell(f"{len(tasks)} poses, {starts} starts for each sign of each limb")
    outcomes = in_processes(measured, tasks, jobs)
    figures = {
        subject: {
            name: summary([o[name] for o, t in zip(outcomes, tasks, strict=True) if t.subject == subject])
            for name in REACHABLE
        }
        for subject in subjects
    }
    show(figures)
    save(json, {"measure": "interpretations", "target": TARGET, "searches": SEARCHES, "subjects": figures})


def summary(outcomes: list[Outcome]) -> dict[str, Any]:
    """Shares of all reachable interpretations of all poses, and their numbers."""
    total = sum(o.reachable for o in outcomes)
    return {
        "poses": len(outcomes),
        "reachable": total,
        "most": max(o.reachable for o in outcomes),
        "first_40": sum(o.early for o in outcomes) / total,
        "in_time": sum(o.in_time for o in outcomes) / total,
        "ever": sum(o.ever for o in outcomes) / total,
        "searches_in_time": float(np.median([o.made for o in outcomes])),
        "ms_to_make_all": 1e3 * float(np.median([o.seconds for o in outcomes])),
    }


def show(figures: dict[str, dict[str, dict[str, Any]]]) -> None:
    made = report.table(
        "reachable forward/backward interpretations found", "", "limits allow it", "poses", "reachable",
        "most of a pose", f"first {SEARCHES}", "made and searched in 66 ms", "of all made", "made all in [ms]",
    )  # fmt: skip
    for subject, by_reach in figures.items():
        for name, f in by_reach.items():
            made.add_row(
                subject, name, str(f["poses"]), str(f["reachable"]), str(f["most"]), f"{f['first_40']:.1%}",
                f"{f['in_time']:.1%}", f"{f['ever']:.1%}", f"{f['ms_to_make_all']:.1f}",
            )  # fmt: skip
    report.console().print(made)
