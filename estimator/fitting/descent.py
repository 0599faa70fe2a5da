"""Bringing the energy of poses, proportions and shape down, and the covariance at its minimum (CSS section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.fitting.body_energy import BodyEnergy, Expansion
from estimator.fitting.shaped_body import ShapedBody, Unknowns
from estimator.optimise.box_step import solve_box
from estimator.optimise.covariance import free_directions
from estimator.optimise.seek import trust_box

_ROUNDS = 30  # of the active set iteration; bounds and frames are few
_MOST_DAMPING = 1e6
_UNSEEN = 1e-9  # curvature of directions that nothing is known of, relative to none


@dataclass(frozen=True)
class DescentSettings:
    """When a descent ends and how far it steps.

    iterations: steps tried. enough: decrease of the energy that a step has to bring for another to follow.
    max_turn [rad], max_slide [m]: half-width of the trust box of the poses.
    """

    iterations: int = 6
    enough: float = 1e-2
    max_turn: float = 0.3
    max_slide: float = 0.2


def descend(
    shaped: ShapedBody, energy: BodyEnergy, x: Unknowns, free: slice, settings: DescentSettings
) -> tuple[Unknowns, float]:
    """Damped Gauss-Newton within joint limits and hard ranges, and the energy it ends with, which never rises.

    free: the part of a step (`ShapedBody.places`) that may move; the rest is held.
    """
    radius = trust_box(shaped.proportions.base, settings.max_turn, settings.max_slide)
    here, damping = energy.at(x), 1e-3
    for _ in range(settings.iterations):
        step = _step(here, *shaped.bounds(x, radius), free, damping)
        trial_x = x if step is None else shaped.moved(x, step)
        trial = here if step is None else energy.at(trial_x)
        gain = here.value - trial.value
        if gain > 0.0:
            x, here, damping = trial_x, trial, max(1e-6, 0.1 * damping)
            if gain < settings.enough:
                break
        else:
            damping *= 10.0
            if damping > _MOST_DAMPING:
                break
    return x, here.value


def _step(here: Expansion, low: np.ndarray, high: np.ndarray, free: slice, damping: float) -> np.ndarray | None:
    H = here.hessian[free, free]
    M = H + np.diag(damping * np.diag(H) + _UNSEEN)
    found, active = np.zeros(len(H)), np.zeros(len(H), dtype=np.int8)
    if solve_box(M, here.gradient[free], low[free], high[free], active, _ROUNDS, found) <= 0:
        return None
    step = np.zeros(len(here.gradient))
    step[free] = found
    return step


def covariance_at(shaped: ShapedBody, here: Expansion, x: Unknowns) -> np.ndarray:
    """Covariance (n, n) of all unknowns together: inverse Hessian where no joint limit holds a pose, zero elsewhere.

    A block of it is the covariance of what it belongs to with all the rest as uncertain as it is.
    """
    body = shaped.proportions.base
    starts = np.arange(len(x.poses)) * body.nv
    free = [
        start + free_directions(body, q, here.gradient[start : start + body.nv])
        for start, q in zip(starts, x.poses, strict=True)
    ]
    index = np.concatenate([*free, np.arange(len(x.poses) * body.nv, len(here.gradient))])
    found = np.zeros_like(here.hessian)
    found[np.ix_(index, index)] = np.linalg.inv(here.hessian[np.ix_(index, index)] + _UNSEEN * np.eye(len(index)))
    return 0.5 * (found + found.T)
