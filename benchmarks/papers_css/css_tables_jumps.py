"""Low-energy minima a second: covariance-scaled samples alone, and with kinematic jumps between them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.papers_css.css_tables_minima import RULE, WITHIN, known_problem
from benchmarks.papers_css.css_tables_problem import SEARCH, Problem
from estimator.energy.descent.seek import Seeker
from estimator.energy.descent.solution import Solution, free_directions, mode_covariance
from estimator.search.jumps import KinematicJumps
from estimator.search.proposals import CovarianceScaledProposal, SphericalProposal

SAME = 0.10  # m; a jump nearer than this to a pose already searched from is not searched again
SEARCHERS = ("CSS about the first mode", "CSS about every known minimum", "CSS and jumps")


class HuntTask(NamedTuple):
    """A random pose, which landmarks are seen of it, one of SEARCHERS, the scale of samples, searches, and a seed."""

    pose: int
    seen: str
    searcher: str
    scale: float
    searches: int
    seed: int = 0


class Hunt(NamedTuple):
    """known (S,): distinct low-energy minima, the first mode not counted, after each search. cpu (S,) [s]: until then.
    energies (K,): of those minima."""

    known: np.ndarray
    cpu: np.ndarray
    energies: np.ndarray


@dataclass
class Pool:
    """The low-energy minima known so far, the first mode leading, with the proposal about each once it is needed."""

    problem: Problem
    scale: float
    spherical: bool = False

    def __post_init__(self) -> None:
        self.minima: list[Solution] = [self.problem.mode]
        self._steps = np.zeros((1, self.problem.body.nv))
        self._proposals: dict[int, CovarianceScaledProposal] = {}

    def offer(self, solution: Solution) -> None:
        """Keep a converged minimum that is low and new."""
        problem = self.problem
        if solution.status != "converged" or solution.quadratic.value > problem.mode.quadratic.value + WITHIN:
            return
        step = problem.body.difference(problem.mode.q, solution.q)
        if np.all(np.abs(self._steps - step).max(axis=1) > RULE.threshold) and is_minimum(problem, solution):
            self.minima.append(solution)
            self._steps = np.concatenate([self._steps, step[None]])

    def sample(self, rng: np.random.Generator, k: int) -> np.ndarray:
        """A covariance-scaled, or spherical, sample (nq,) about the minimum k."""
        if k not in self._proposals:
            body, quadratic = self.problem.body, self.problem.cost.at(self.minima[k].q)
            covariance = mode_covariance(body, quadratic.posed.q, quadratic.gradient, quadratic.hessian, np.inf)
            kind = SphericalProposal if self.spherical else CovarianceScaledProposal
            self._proposals[k] = kind(body, quadratic.posed.q, covariance, self.scale)
        return self._proposals[k].sample(rng)


def is_minimum(problem: Problem, solution: Solution) -> bool:
    """Whether no direction of descent is left where a search converged: the exact Hessian is positive where limits do
    not hold."""
    here = problem.cost.at(solution.q, exact=True)
    free = free_directions(problem.body, solution.q, here.gradient)
    return len(free) == 0 or float(np.linalg.eigvalsh(here.hessian[np.ix_(free, free)])[0]) > 0.0


class _Jumps:
    """The jumps from every known minimum, each once, and none to where a search has been before."""

    def __init__(self, problem: Problem, pool: Pool) -> None:
        self._problem, self._pool, self._jumps = problem, pool, KinematicJumps(problem.body)
        self._queue: deque[np.ndarray] = deque()
        self._expanded: set[int] = set()
        self._visited = np.zeros((0, len(problem.body.landmark_names), 3))  # landmarks [m] of poses searched from
        self._count = 0

    def next(self) -> np.ndarray | None:
        """A start (nq,); None where all minima known have been jumped from."""
        while True:
            while self._queue:
                q = self._queue.popleft()
                if self._is_new(q):
                    return q
            left = [k for k in range(len(self._pool.minima)) if k not in self._expanded]
            if not left:
                return None
            k = min(left, key=lambda i: self._pool.minima[i].quadratic.value)
            self._expanded.add(k)
            self._is_new(self._pool.minima[k].q)
            self._queue.extend(self._jumps.of(self._pool.minima[k].q, self._problem.camera))

    def _is_new(self, q: np.ndarray) -> bool:
        """Whether q (nq,) is away from all poses remembered; it then joins them."""
        body = self._problem.body
        points = body.landmarks(body.at(q))
        gaps = np.square(self._visited[: self._count] - points).sum(axis=-1).max(axis=1, initial=0.0)
        if np.any(gaps < SAME**2):
            return False
        if self._count == len(self._visited):  # doubled, so that remembering stays cheap
            self._visited = np.concatenate([self._visited, np.zeros((self._count + 64, *points.shape))])
        self._visited[self._count] = points
        self._count += 1
        return True


def hunted(task: HuntTask, clock: Callable[[], float] = time.process_time) -> Hunt:
    """Searches from samples, and with jumps from every other start, about minima drawn evenly from those known. clock:
    gives the time that they take [s]."""
    problem, rng = known_problem(task.pose, task.seen), np.random.default_rng([task.seed, task.pose, 1])
    seeker, pool = Seeker(problem.body, SEARCH), Pool(problem, task.scale)
    next(
        iter(KinematicJumps(problem.body).of(problem.mode.q, problem.camera)), None
    )  # kernels are compiled before the clock starts
    jumps = _Jumps(problem, pool) if task.searcher == SEARCHERS[2] else None
    pool.sample(rng, 0)
    known, cpu, began = [], [], clock()
    for k in range(task.searches):
        about = 0 if task.searcher == SEARCHERS[0] else int(rng.integers(len(pool.minima)))
        q = jumps.next() if jumps is not None and k % 4 else None
        pool.offer(seeker.seek(problem.cost, pool.sample(rng, about) if q is None else q))
        known.append(len(pool.minima) - 1)
        cpu.append(clock() - began)
    return Hunt(np.array(known), np.array(cpu), np.array([f.quadratic.value for f in pool.minima[1:]]))
