"""Hard clearance: a mode whose parts overlap is searched again with clearance as rows of the step's QP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from estimator.optimise.box_step import model_decrease
from estimator.optimise.seek import Seeker, Solution
from estimator.terms.term import Cost, QuadraticModel
from humanoid.collision.clearance import Clearance
from humanoid.kinematics.body import PosedBody
from humanoid.support.settings import setting

TOUCH = 1e-5  # m; closer pairs can carry a contact force


@dataclass(frozen=True)
class ContactSettings:
    """What is done with overlapping parts.

    tolerance: overlap [m] that is let be. limit: overlap [m] with which a mode is given up where there are others.
    margin: distance [m] below which a pair gets a row. steps: steps tried. force: energy per metre of overlap that a
    step may gain and still be refused for it.
    """

    tolerance: float = setting(0.005, at_least=0, tiny=True)
    limit: float = setting(0.01, above=0)
    margin: float = setting(0.03, above=0)
    steps: int = setting(30, at_least=1)
    force: float = setting(1e5, above=0)


def separate(seeker: Seeker, clearance: Clearance, cost: Cost, found: Solution, settings: ContactSettings) -> Solution:
    """`found` itself if no parts overlap by more than the tolerance, else the end of a search with hard rows.

    Every step solves the QP with the linearised clearance d + n'J dx >= target of all near pairs, target being 0 or,
    deep inside, half of the overlap; a step is taken when it lowers energy + force * overlap.
    """
    here = found.quadratic
    depth = clearance.penetration(here.posed)
    if depth <= settings.tolerance:
        return found
    body, damping, radius = seeker.body, 1e-3, seeker.trust_box(seeker.settings)
    active = np.zeros(body.nv, dtype=np.int8)
    merit = here.value + settings.force * depth
    tried = 0
    while tried < settings.steps:
        tried += 1
        rows = clearance_rows(clearance, here.posed, settings.margin)
        step = seeker.solver.solve(here.hessian, here.gradient, damping, radius, here.posed.q, active, rows)
        if step is None or not np.any(np.abs(step) > 1e-9):
            break
        trial = cost.at(body.integrate(here.posed.q, step))
        depth = clearance.penetration(trial.posed)
        trial_merit = trial.value + settings.force * depth
        if trial_merit < merit:
            flat = merit - trial_merit < 1e-9 and model_decrease(here.hessian, here.gradient, step) < 1e-9
            here, merit, damping = trial, trial_merit, max(1e-9, 0.2 * damping)
            if flat:
                break
        else:
            damping = max(damping, 1e-6) * 8.0
            if damping > 1e9:
                break
    residual = contact_kkt_residual(seeker, clearance, here)
    status = "converged" if residual < seeker.settings.kkt_tolerance else "separated"
    return Solution(here, status, residual, found.iterations + tried)


def contact_kkt_residual(seeker: Seeker, clearance: Clearance, quadratic: QuadraticModel) -> float:
    """Largest entry of the gradient that neither joint limits nor touching parts can balance.

    The multipliers, none negative, are the least-squares ones of the active limits and of the pairs in touch.
    """
    body, q = seeker.body, quadratic.posed.q
    touching = clearance.near(quadratic.posed, TOUCH).gradient
    identity = np.eye(body.nv)
    low = identity[body.bounded_v[q[body.bounded_q] <= body.lower[body.bounded_q]]]
    high = -identity[body.bounded_v[q[body.bounded_q] >= body.upper[body.bounded_q]]]
    pressing = np.concatenate([touching, low, high]).T
    if pressing.shape[1] == 0:
        return seeker.kkt_residual(quadratic)
    multipliers, _ = nnls(pressing, quadratic.gradient)
    return float(np.max(np.abs(quadratic.gradient - pressing @ multipliers)))


def clearance_rows(clearance: Clearance, posed: PosedBody, margin: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Rows A (m, nv), b (m,) with A dx >= b for every pair nearer than `margin`; None where there is no such pair."""
    contacts = clearance.near(posed, margin)
    if len(contacts.distance) == 0:
        return None
    target = np.minimum(0.0, 0.5 * contacts.distance)
    return contacts.gradient, target - contacts.distance
