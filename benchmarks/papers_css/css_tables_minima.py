"""Samples of a proposal, the minima that searches from them end in, and the rules by which these are counted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from benchmarks.papers_css.css_tables_problem import PAPERS, SEARCH, Problem, Regime, joint_image_problem
from estimator.energy.descent.seek import Seeker
from estimator.energy.descent.solution import Solution, free_directions
from estimator.search.proposals import CovarianceScaledProposal, Proposal, SphericalProposal, WeakestDirections


def _weakest(problem: Problem, scale: float) -> Proposal:
    """Half of the scale, the scale and so on along the eight weakest directions, blurred by the mode's covariance."""
    radii = scale * np.array([0.5, 1.0, 1.5, 2.0])
    return WeakestDirections(problem.body, problem.mode.q, problem.covariance, 8, radii.tolist(), blur=1.0)


def _about_mode(kind: Callable[..., Proposal], problem: Problem, scale: float) -> Proposal:
    return kind(problem.body, problem.mode.q, problem.covariance, scale)


PROPOSALS: dict[str, Callable[[Problem, float], Proposal]] = {
    "CSS": partial(_about_mode, CovarianceScaledProposal),
    "SS": partial(_about_mode, SphericalProposal),
    "CSS, Student t of 4": partial(_about_mode, partial(CovarianceScaledProposal, degrees_of_freedom=4.0)),
    "8 weakest directions": _weakest,
}


class Starts(Protocol):
    """The source of starts: a proposal, or one without a density."""

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """One configuration (nq,), within the joint limits."""
        ...


@runtime_checkable
class Learns(Protocol):
    """Starts that receive where each search from them has ended."""

    def offer(self, solution: Solution) -> None:
        """The end of the search from the last sample."""
        ...


class RowTask(NamedTuple):
    """One row of the table: a random pose, a key of PROPOSALS, scale of standard deviations, samples, seed, and the
    projected gradient at which its searches end."""

    pose: int
    method: str
    scale: float
    samples: int
    seed: int = 0
    tolerance: float = 1e-6


@dataclass(frozen=True)
class Searches:
    """The starts and ends of a row's searches.

    raw_q (N, nq), raw_energy (N,): samples. q (N, nq), energy (N,), landmarks (N, L, 3) [m]: where searches ended.
    residual (N,): the projected gradient there, recomputed. curvature (N,): least eigenvalue of the exact Hessian on
    the directions that no active limit holds. cpu [s]: of drawing and searching.
    """

    raw_q: np.ndarray
    raw_energy: np.ndarray
    q: np.ndarray
    energy: np.ndarray
    landmarks: np.ndarray
    residual: np.ndarray
    curvature: np.ndarray
    cpu: float

    def first(self, count: int) -> Searches:
        """The first so many of the searches; cpu stays that of all."""
        return replace(self, **{f.name: getattr(self, f.name)[:count] for f in fields(self) if f.name != "cpu"})

    def minima(self, tolerance: float = 1e-6) -> np.ndarray:
        """Which ends are minima, (N,) bool: projected gradient below the tolerance, no direction of descent left."""
        minimum: np.ndarray = (self.residual < tolerance) & (self.curvature > 0.0)
        return minimum


@cache
def known_problem(pose: int, seen: str = "body", regime: Regime = PAPERS) -> Problem:
    """`joint_image_problem`, made once a process."""
    return joint_image_problem(pose, seen, regime=regime)


def proposal(problem: Problem, name: str, scale: float) -> Proposal:
    """The named one of `PROPOSALS`."""
    return PROPOSALS[name](problem, scale)


def searched(task: RowTask) -> Searches:
    """The row's samples, each searched to its end within the limits."""
    problem, rng = known_problem(task.pose), np.random.default_rng([task.seed, task.pose])
    made = partial(proposal, name=task.method, scale=task.scale)
    return searched_from(problem, made, rng, task.samples, task.tolerance)


def searched_from(
    problem: Problem, made: Callable[[Problem], Starts], rng: np.random.Generator, samples: int, tolerance: float = 1e-6
) -> Searches:
    """So many samples of a proposal, each searched until the projected gradient is below the tolerance."""
    seeker = Seeker(problem.body, replace(SEARCH, kkt_tolerance=tolerance))
    began = time.process_time()
    proposal, raw, solutions = made(problem), [], []
    for _ in range(samples):
        raw.append(proposal.sample(rng))
        solutions.append(seeker.seek(problem.cost, raw[-1]))
        if isinstance(proposal, Learns):
            proposal.offer(solutions[-1])
    cpu = time.process_time() - began
    raw_energy = problem.cost.values_at(np.array(raw))
    return search_results(problem, seeker, np.array(raw), raw_energy, solutions, cpu)


def search_results(
    problem: Problem, seeker: Seeker, raw: np.ndarray, raw_energy: np.ndarray, solutions: list[Solution], cpu: float
) -> Searches:
    """Ends of searches with everything that the rules of counting need, recomputed from the energy."""
    body = problem.body
    ends = [problem.cost.at(f.q, exact=True) for f in solutions]
    least = []
    for end in ends:
        free = free_directions(body, end.posed.q, end.gradient)
        least.append(float(np.linalg.eigvalsh(end.hessian[np.ix_(free, free)])[0]) if len(free) else np.inf)
    return Searches(
        raw,
        raw_energy,
        np.array([end.posed.q for end in ends]),
        np.array([end.value for end in ends]),
        np.array([body.landmarks(end.posed) for end in ends]),
        np.array([seeker.kkt_residual(end) for end in ends]),
        np.array(least),
        cpu,
    )


class Rule(NamedTuple):
    """When two minima differ: some parameter by more than `threshold` [rad, m], or some landmark by more [m]."""

    unit: str  # "parameter" or "landmark"
    threshold: float


RULE = Rule("parameter", 0.1)
WITHIN = 10.0
"""Energy above the known mode up to which a minimum is low: a likelihood ratio of exp(10), 22000."""


def distinct(problem: Problem, searches: Searches, rule: Rule = RULE, tolerance: float = 1e-6) -> np.ndarray:
    """Indices of the distinct minima besides the mode the samples came from, lowest energy first."""
    ends = np.flatnonzero(searches.minima(tolerance))
    ends = ends[np.argsort(searches.energy[ends], kind="stable")]
    if rule.unit == "parameter":
        places, known = problem.steps(searches.q[ends]), np.zeros((1, problem.body.nv))
    else:
        places = searches.landmarks[ends]
        known = problem.body.landmarks(problem.mode.quadratic.posed)[None]
    distinct_ends: list[int] = []
    for k, place in enumerate(places):
        if np.all(_apart(known, place, rule) > rule.threshold):
            distinct_ends.append(k)
            known = np.concatenate([known, place[None]])
    return ends[distinct_ends]


def low(problem: Problem, searches: Searches) -> np.ndarray:
    """Indices of the distinct minima that are `WITHIN` of the known mode's energy, or below it."""
    kept = distinct(problem, searches)
    indices: np.ndarray = kept[searches.energy[kept] < problem.mode.quadratic.value + WITHIN]
    return indices


def _apart(known: np.ndarray, place: np.ndarray, rule: Rule) -> np.ndarray:
    """Largest difference of each known place from this one, (K,)."""
    gaps = np.abs(known - place) if rule.unit == "parameter" else np.linalg.norm(known - place, axis=-1)
    largest: np.ndarray = gaps.max(axis=1)
    return largest
