"""Ours and scipy's `least_squares` from one start: the problem, both searches, and what each of them took."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.speed.mode_search_residuals import Change, Residuals
from benchmarks.speed.mode_search_scipy import Watched, scipy_search
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import CompiledSeeker
from estimator.energy.priors import world_up
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.synthesis.views import scene_cameras
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import COCO17
from humanoid.subject.subject import load_subject

NOISE_PX = 4.0
SPREAD = 0.8  # of the true pose about rest, in standard deviations of the stabilisers
STANDING = np.array([0.0, 0.0, 1.0])  # m, from the room's floor, which its cameras face, to the pelvis
AROUND = 0.4  # standard deviation of further starts about the first [rad], root [rad, m]
TENTH = 0.1  # of scipy's time
EQUAL = 1e-6  # relative difference up to which energies are equal


@dataclass(frozen=True)
class Start:
    """Where both sides begin, and in which energy.

    kind: what the figures are grouped by. q (nq,). observation: the frame's keypoints, as the start reads them.
    q_previous (nq,): from which the change within `dt` [s] is penalised; None where it is not.
    """

    kind: str
    q: np.ndarray
    observation: Observation
    q_previous: np.ndarray | None = None
    dt: float = 0.0


@dataclass(frozen=True)
class Duel:
    """Both sides from one start.

    kind: of the start. energy: at the start. ours, theirs: where each ended.
    in_a_tenth: the lowest of our searches that fit into a tenth of scipy's time.
    our_ms, their_ms: CPU time of ours, and of scipy until it was as low, or to its end. full_ms: of scipy to its end.
    residual_ms: the part of full_ms inside the residuals and their Jacobian.
    our_steps: steps tried. their_steps: number of residual evaluations by scipy.
    converged: whether our KKT residual is below its tolerance.
    """

    kind: str
    energy: float
    ours: float
    theirs: float
    in_a_tenth: float
    our_ms: float
    their_ms: float
    full_ms: float
    residual_ms: float
    our_steps: int
    their_steps: int
    converged: bool


def no_higher(energy: float, other: float) -> bool:
    """Whether one end is as low as the other, up to scipy's tolerances."""
    return energy <= other + EQUAL * max(1.0, abs(other))


class Contest:
    """Problems on human34 with one camera, and both ways to solve them. clock: gives the time [s]."""

    def __init__(self, clock: Callable[[], float] = time.process_time) -> None:
        self._clock = clock
        self.body = Body(load_subject("human34"))
        self.cameras = scene_cameras()[:1]
        self.settings = CostSettings(interpenetration_weight=0.0, pose_prior_weight=0.0)  # neither is a sum of squares
        self.model = CostModel(self.body, self.settings)
        self.seeker = CompiledSeeker(self.body)
        self._seen = np.isin(self.body.landmark_names, COCO17)

    def problem(self, rng: np.random.Generator) -> tuple[np.ndarray, Observation]:
        """A true pose (nq,) and its noisy keypoints, COCO's."""
        body = self.body
        q = body.neutral.copy()
        for s in body.subject.stabilisers:
            q[body.q_names.index(s.joint)] += SPREAD * s.std * rng.normal()
        q = body.clamp(q)
        q[:3] += STANDING
        turned = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        q = body.integrate(q, np.concatenate([rng.normal(0.0, 0.1, 3), turned, np.zeros(body.nv - 6)]))
        pixels = self.cameras[0].project(body.landmarks(body.at(q)))[None]
        pixels = np.where(self._seen[:, None], pixels + rng.normal(0.0, NOISE_PX, pixels.shape), np.nan)
        return q, Observation(0, 0.0, self.cameras, pixels, self._seen[None].astype(float))

    def random_start(self, distance: float, rng: np.random.Generator) -> Start:
        """A problem, and a start off by `distance` in every joint (standard deviation; rad, and m for the root)."""
        truth, observation = self.problem(rng)
        q = self.body.integrate(truth, distance * rng.normal(size=self.body.nv))
        return Start(f"{distance:g}", q, observation)

    def forms(self, start: Start) -> tuple[Cost, Residuals]:
        """The energy as ours and as residuals about a start."""
        s, change = self.settings, None
        observation = replace(start.observation, standing=None)  # terms of standing points are not such a sum
        if start.q_previous is not None:
            change = Change(start.q_previous, self.model.transition_std(start.dt), s.transition_nu)
        cost = self.model.cost(self.model.observation_term(observation), start.q_previous, start.dt)
        sigma, up = self.model.keypoint_sigma(observation), world_up(observation.cameras)
        return cost, Residuals(self.body, start.q, observation, sigma, s.nu, up, change=change)

    def duel(self, start: Start, rng: np.random.Generator) -> Duel:
        """Both from one start; rng: of our further searches."""
        q = start.q
        cost, residuals = self.forms(start)
        before = cost.at(q).value
        began = self._clock()
        solution = self.seeker.seek(cost, q)
        our_time = self._clock() - began
        ours = solution.quadratic.value
        watched = Watched(residuals, ours + EQUAL * max(1.0, abs(ours)), self._clock)
        began = self._clock()
        theirs = scipy_search(watched, residuals)
        full = self._clock() - began
        until = full if watched.reached is None else watched.reached - began
        lowest = self.further(cost, q, ours, TENTH * full - our_time, our_time, rng.spawn(1)[0])
        return Duel(
            start.kind, before, ours, float(theirs.cost), lowest, 1e3 * our_time, 1e3 * until, 1e3 * full,
            1e3 * watched.inside, solution.iterations, int(theirs.nfev), solution.status == "converged",
        )  # fmt: skip

    def further(
        self, cost: Cost, q: np.ndarray, lowest: float, left: float, took: float, rng: np.random.Generator
    ) -> float:
        """The lowest energy after more searches from around q (nq,), as many as fit into the seconds that are left, if
        each takes as long as the first."""
        for _ in range(int(left / took)):
            q_near = self.body.integrate(q, AROUND * rng.normal(size=self.body.nv))
            lowest = min(lowest, self.seeker.seek(cost, q_near).quadratic.value)
        return lowest
