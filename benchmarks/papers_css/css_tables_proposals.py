"""Other distributions of starts about a mode, to be compared with covariance scaling and spheres."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from benchmarks.papers_css.css_tables_jumps import Pool
from benchmarks.papers_css.css_tables_minima import PROPOSALS, Starts, proposal
from benchmarks.papers_css.css_tables_problem import Problem
from estimator.energy.descent.solution import Solution, mode_covariance
from estimator.search.jumps import KinematicJumps
from estimator.search.proposals import CovarianceScaledProposal, LimbProposal

HOPS = 3  # jumps one after the other, at most


class Shaped:
    """A Gaussian along the covariance's eigenvectors with standard deviations (n,) of its own, clamped into the
    limits."""

    def __init__(self, problem: Problem, std: np.ndarray) -> None:
        self._problem, self._factor = problem, problem.axes * std

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        step = self._factor @ rng.standard_normal(self._factor.shape[1])
        return self._problem.body.integrate(self._problem.mode.q, step)


def tempered(problem: Problem, scale: float, power: float) -> Shaped:
    """The covariance to a power between the sphere's, 0, and its own, 1; the volume is the same."""
    mean = _mean_std(problem)
    return Shaped(problem, scale * mean * (problem.std / mean) ** power)


def with_floor(problem: Problem, scale: float, floor: float) -> Shaped:
    """Covariance scaled, and a sphere's standard deviation [rad, m] added to strong directions too."""
    return Shaped(problem, np.hypot(scale * problem.std, floor))


def with_ceiling(problem: Problem, scale: float, ceiling: float, floor: float = 0.0) -> Shaped:
    """Covariance scaled, no direction wider than the ceiling [rad, m]: beyond, samples end clamped into corners."""
    return Shaped(problem, np.maximum(np.minimum(scale * problem.std, ceiling), floor))


def _mean_std(problem: Problem) -> float:
    return math.exp(float(np.log(problem.std).mean()))


class Mixed:
    """One of several starts at random."""

    def __init__(self, parts: list[Starts]) -> None:
        self._parts = parts

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        return self._parts[int(rng.integers(len(self._parts)))].sample(rng)


class Reflected:
    """Covariance scaled; where a sample leaves a joint's range it is folded back into it, not clamped onto its end."""

    def __init__(self, problem: Problem, scale: float) -> None:
        self._problem, self._factor = problem, scale * problem.axes * problem.std

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        body, q = self._problem.body, self._problem.mode.q
        moved = pin.integrate(body.model, q, self._factor @ rng.standard_normal(self._factor.shape[1]))
        i = body.bounded_q
        low, width = body.lower[i], body.upper[i] - body.lower[i]
        phase = np.mod(moved[i] - low, 2.0 * width)
        moved[i] = low + np.minimum(phase, 2.0 * width - phase)
        return body.clamp(moved)


class Curved:
    """A covariance scaled step in pieces, along the valley of the image's least change: at the end of each piece the
    covariance is that of the place reached, and the step continues in the direction that is as many deviations away.

    Straight steps leave the curved valley; this costs an evaluation a piece.
    """

    def __init__(self, problem: Problem, scale: float, pieces: int) -> None:
        self._problem, self._scale, self._pieces = problem, scale, pieces

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        problem, body = self._problem, self._problem.body
        q, covariance = problem.mode.q, problem.covariance
        step = self._scale * (problem.axes * problem.std) @ rng.standard_normal(len(problem.std)) / self._pieces
        for k in range(self._pieces):
            q = body.integrate(q, step)
            if k + 1 < self._pieces:
                here = problem.cost.at(q)
                covariance = mode_covariance(body, q, np.zeros(body.nv), here.hessian, np.inf)
                step = _turned(step, covariance)
        return q


def _turned(step: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The step's part in the weak directions of a covariance, as long as the step: (C (C + e)^-1) step, e its mean."""
    values, vectors = np.linalg.eigh(covariance)
    share = values / (values + np.exp(np.log(np.maximum(values, 1e-12)).mean()))
    turned = vectors @ (share * (vectors.T @ step))
    length = float(np.linalg.norm(turned))
    return turned * (float(np.linalg.norm(step)) / length) if length > 0.0 else step


class Projected:
    """A covariance scaled sample, then Gauss-Newton steps on the image alone, the shortest that bring it back."""

    def __init__(self, problem: Problem, scale: float, steps: int) -> None:
        self._problem, self._steps = problem, steps
        self._about = CovarianceScaledProposal(problem.body, problem.mode.q, problem.covariance, scale)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        body, image = self._problem.body, self._problem.cost.terms[0]
        q = self._about.sample(rng)
        for _ in range(self._steps):
            gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
            image.accumulate(body.at(q), gradient, hessian)
            damping = max(1e-3 * np.trace(hessian) / body.nv, 1e-9)  # where nothing is in view both are zero
            step = -np.linalg.solve(hessian + damping * np.eye(body.nv), gradient)
            q = body.integrate(q, step / max(1.0, float(np.abs(step).max())))
        return q


class Limbs:
    """The joints from one joint outwards elsewhere, all others where the mode has them."""

    def __init__(self, problem: Problem, most: float) -> None:
        self._q, self._limb = problem.mode.q, LimbProposal(problem.body, most=most)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        return self._limb.sample(rng, self._q)


class Jumps:
    """One to three random kinematic jumps from the mode one after the other, then a covariance scaled sample's step."""

    def __init__(self, problem: Problem, scale: float) -> None:
        self._problem, self._jumps = problem, KinematicJumps(problem.body)
        self._blur = scale * problem.axes * problem.std

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        q = self._problem.mode.q
        for _ in range(int(rng.integers(1, HOPS + 1))):
            jumped = self._jumps.draw(rng, q, self._problem.camera)
            q = q if jumped is None else jumped
        return self._problem.body.integrate(q, self._blur @ rng.standard_normal(self._blur.shape[1]))


class AboutKnown:
    """Samples about a random one of the useful minima found so far, the mode among them; a share are jumps from it."""

    def __init__(self, problem: Problem, scale: float, spherical: bool = False, jumps: float = 0.0) -> None:
        self._problem, self._pool, self._share = problem, Pool(problem, scale, spherical), jumps
        self._jumps = KinematicJumps(problem.body)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Starts`."""
        k = int(rng.integers(len(self._pool.minima)))
        if self._share and rng.random() < self._share:
            q = self._jumps.draw(rng, self._pool.minima[k].q, self._problem.camera)
            if q is not None:
                return q
        return self._pool.sample(rng, k)

    def offer(self, solution: Solution) -> None:
        """See `Learns`."""
        self._pool.offer(solution)


def _table(name: str, scale: float) -> Callable[[Problem], Starts]:
    return partial(proposal, name=name, scale=scale)


def _scales(problem: Problem, kind: str, scales: tuple[float, ...]) -> Mixed:
    return Mixed([PROPOSALS[kind](problem, s) for s in scales])


def _halves(problem: Problem) -> Mixed:
    return Mixed([PROPOSALS["CSS"](problem, 8.0), PROPOSALS["SS"](problem, 8.0)])


def _and_jumps(problem: Problem, kind: str) -> Mixed:
    return Mixed([PROPOSALS[kind](problem, 8.0), Jumps(problem, 1.0)])


TRIED: dict[str, Callable[[Problem], Starts]] = {
    **{f"SS {s:g}": _table("SS", s) for s in (4.0, 8.0, 16.0)},
    **{f"CSS {s:g}": _table("CSS", s) for s in (1.0, 2.0, 4.0, 8.0)},
    **{f"CSS, Student t of 4, {s:g}": _table("CSS, Student t of 4", s) for s in (2.0, 4.0, 8.0)},
    "CSS, scales 1 to 8": partial(_scales, kind="CSS", scales=(1.0, 2.0, 4.0, 8.0)),
    "SS, scales 2 to 16": partial(_scales, kind="SS", scales=(2.0, 4.0, 8.0, 16.0)),
    "CSS 8 and SS 8 in turn": _halves,
    "8 weakest directions, 8": _table("8 weakest directions", 8.0),
    "8 weakest directions, 3": _table("8 weakest directions", 3.0),
    **{f"power {p:g} of the covariance, 8": partial(tempered, scale=8.0, power=p) for p in (0.25, 0.5, 0.75)},
    "power 0.5 of the covariance, 16": partial(tempered, scale=16.0, power=0.5),
    **{f"CSS 4, floor {f:g}": partial(with_floor, scale=4.0, floor=f) for f in (0.1, 0.3)},
    **{f"CSS 8, ceiling {c:g}": partial(with_ceiling, scale=8.0, ceiling=c) for c in (0.5, 1.0)},
    "CSS 8, ceiling 1, floor 0.3": partial(with_ceiling, scale=8.0, ceiling=1.0, floor=0.3),
    "CSS 8, reflected at limits": partial(Reflected, scale=8.0),
    "curved CSS 8, 4 pieces": partial(Curved, scale=8.0, pieces=4),
    "curved CSS 4, 4 pieces": partial(Curved, scale=4.0, pieces=4),
    "CSS 8, projected onto the image": partial(Projected, scale=8.0, steps=3),
    "limbs elsewhere, 1.2 rad": partial(Limbs, most=1.2),
    "jumps, blurred by CSS 1": partial(Jumps, scale=1.0),
    "jumps, blurred by CSS 4": partial(Jumps, scale=4.0),
    "jumps in turn with CSS 8": partial(_and_jumps, kind="CSS"),
    "jumps in turn with SS 8": partial(_and_jumps, kind="SS"),
    "CSS 8 about known minima": partial(AboutKnown, scale=8.0),
    "CSS 4 about known minima": partial(AboutKnown, scale=4.0),
    "SS 8 about known minima": partial(AboutKnown, scale=8.0, spherical=True),
    "CSS 4 and jumps about known minima": partial(AboutKnown, scale=4.0, jumps=0.5),
    "SS 8 and jumps about known minima": partial(AboutKnown, scale=8.0, spherical=True, jumps=0.5),
}
"""The compared proposals, by name; the number is the scale."""
