"""Bringing the energy of poses, proportions and shape down, and the covariance at its minimum (CSS section 4.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.energy.descent.box_step import solve_box
from estimator.energy.descent.covariance import free_directions
from estimator.energy.descent.seek import trust_box
from estimator.fitting.body_energy import BodyEnergy, Expansion
from estimator.fitting.settings import DescentSettings
from estimator.fitting.shaped_body import ShapedBody, Unknowns
from estimator.numerics.newton import Damping, NewtonSettings, Problem, Step, minimise

_ROUNDS = 30  # of the active set iteration; bounds and frames are few
_DAMPING = Damping(least=1e-6)
_UNSEEN = 1e-9  # curvature of directions that nothing is known of, relative to none


def descend(
    shaped: ShapedBody, energy: BodyEnergy, x: Unknowns, free: slice, settings: DescentSettings
) -> tuple[Unknowns, float]:
    """Damped Gauss-Newton within joint limits and hard ranges: where it ends, and the energy there, which never rises.

    free: the part of a step (`ShapedBody.places`) that may move; the rest is held.
    """
    radius = trust_box(shaped.proportions.base, settings.max_turn, settings.max_slide)
    newton = NewtonSettings(settings.iterations, _DAMPING, enough=settings.enough)
    end = minimise(_Descent(shaped, energy, free, radius), _Point(x, energy.at(x)), newton).model
    return end.x, end.value


class _Point(NamedTuple):
    """Unknowns looked at, and the energy's model there."""

    x: Unknowns
    model: Expansion

    @property
    def value(self) -> float:
        return self.model.value


class _Descent(Problem[_Point]):
    """An energy of which a part of the unknowns moves; radius (nv,): half-width of the poses' trust box."""

    def __init__(self, shaped: ShapedBody, energy: BodyEnergy, free: slice, radius: np.ndarray) -> None:
        self._shaped, self._energy, self._free, self._radius = shaped, energy, free, radius

    def step(self, model: _Point, damping: float) -> Step | None:
        free, expansion = self._free, model.model
        low, high = self._shaped.bounds(model.x, self._radius)
        hessian, gradient = expansion.hessian[free, free], expansion.gradient[free]
        part = bounded_step(hessian, gradient, low[free], high[free], damping, _UNSEEN)
        if part is None:
            return None
        move = np.zeros(len(expansion.gradient))
        move[free] = part
        return move, None

    def at(self, model: _Point, step: Step) -> _Point:
        x = self._shaped.moved(model.x, step[0])
        return _Point(x, self._energy.at(x))


def bounded_step(
    hessian: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray, damping: float, unseen: float = 0.0
) -> np.ndarray | None:
    """The step (n,) between bounds (n,) that minimises a damped model; None where none is certified.

    hessian (n, n), gradient (n,). unseen: curvature added to all directions.
    """
    M = hessian + np.diag(damping * np.diag(hessian) + unseen)
    step, active = np.zeros(len(gradient)), np.zeros(len(gradient), dtype=np.int8)
    return step if solve_box(M, gradient, low, high, active, _ROUNDS, step) > 0 else None


def covariance_at(shaped: ShapedBody, model: Expansion, x: Unknowns) -> np.ndarray:
    """Covariance (n, n) of all unknowns together: inverse Hessian where no joint limit holds a pose, zero elsewhere.

    A block of it is the covariance of what it belongs to with all the rest as uncertain as it is.
    """
    body = shaped.proportions.base
    starts = np.arange(len(x.poses)) * body.nv
    free = [
        start + free_directions(body, q, model.gradient[start : start + body.nv])
        for start, q in zip(starts, x.poses, strict=True)
    ]
    index = np.concatenate([*free, np.arange(len(x.poses) * body.nv, len(model.gradient))])
    covariance = np.zeros_like(model.hessian)
    covariance[np.ix_(index, index)] = np.linalg.inv(model.hessian[np.ix_(index, index)] + _UNSEEN * np.eye(len(index)))
    return 0.5 * (covariance + covariance.T)
