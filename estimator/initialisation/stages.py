"""A person's body from the first frames, in three stages (CSS section 5): proportions, shape, everything together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.cost.model import CostSettings
from estimator.fitting import Fit, FitSettings, ShapeFit, fit_proportions
from estimator.imaging.observation import Observation
from estimator.initialisation.body_energy import BodyEnergy, Expansion, Gaussian
from estimator.initialisation.shape_parameters import OF_PART
from estimator.initialisation.shaped_body import ShapedBody, Unknowns
from estimator.runner import Cues
from estimator.search.box_step import solve_box
from estimator.search.covariance import free_directions
from estimator.search.seek import trust_box
from estimator.trackers.registry import Settings
from humanoid.subject import Subject


@dataclass(frozen=True)
class ShapeSettings:
    """How the second and third stage are made.

    frames: pictures that are looked at, evenly spread over the frames of the first stage. rounds: times that features
    are assigned anew, in either stage. iterations: steps a round. enough: decrease of the energy that a step has to
    bring for another to follow. noise: the noise of edges and outlines as a share of tracking's, most of which stands
    for flesh of another shape. effective_frames: see `estimator.fitting.FitSettings`.
    """

    frames: int = 3
    rounds: int = 4
    iterations: int = 8
    enough: float = 1e-2
    noise: float = 0.5
    effective_frames: float = 4.0


def fit_subject(
    subject: Subject,
    observations: Sequence[Observation],
    cues: Cues,
    seed: int = 0,
    settings: FitSettings | None = None,
    shape_settings: ShapeSettings | None = None,
    track_settings: Settings | None = None,
) -> Fit:
    """All three stages; the first alone where the pictures show neither edges nor outlines.

    cues: where the pictures' cues come from. The other arguments are those of `fit_proportions`.
    """
    first = fit_proportions(subject, observations, seed, settings, track_settings)
    cost = track_settings.cost if track_settings else CostSettings()
    return fit_shape(subject, first, cues, shape_settings or ShapeSettings(), cost)


def fit_shape(subject: Subject, first: Fit, cues: Cues, settings: ShapeSettings, cost: CostSettings) -> Fit:
    """Stages two and three on the outcome of the first; `first` itself where there is nothing to go by."""
    if not first.observations:
        return first
    picks = np.unique(np.linspace(0, len(first.observations) - 1, settings.frames).round().astype(int))
    seen = [replace(first.observations[k], cues=cues.at(first.observations[k].index)) for k in picks]
    if not any(c.edges is not None or c.silhouette is not None for o in seen for c in o.cues):
        return first
    shaped = ShapedBody(subject, cost.image.nodes)
    if not len(shaped.shape.low):
        return first
    stages = _Stages(shaped, seen, first, settings, cost)
    start = Unknowns(first.poses[picks], first.scales, np.zeros(len(shaped.shape.low)))
    found = stages.run(start, shape_alone=True)
    found = stages.run(found, shape_alone=False)
    return stages.outcome(first, start, found)


class _Stages:
    """Stages two and three on some frames."""

    def __init__(
        self, shaped: ShapedBody, seen: list[Observation], first: Fit, settings: ShapeSettings, cost: CostSettings
    ) -> None:
        self._shaped, self._seen, self._settings = shaped, seen, settings
        image = cost.image
        self._cost = replace(
            cost,
            image=replace(
                image, edge_noise=image.edge_noise * settings.noise, outline_noise=image.outline_noise * settings.noise
            ),
        )
        self._on_scales = _with_the_rest(shaped, first, len(seen))
        self._radius = trust_box(shaped.proportions.base, 0.3, 0.2)

    def energy(self, assigned_at: Unknowns) -> BodyEnergy:
        """The frames' energy with features assigned at some unknowns."""
        share = min(1.0, self._settings.effective_frames / len(self._seen))
        return BodyEnergy(self._shaped, self._seen, assigned_at, self._cost, self._on_scales, share)

    def run(self, x: Unknowns, *, shape_alone: bool) -> Unknowns:
        """One stage: features assigned, the energy brought down, features assigned anew."""
        for _ in range(self._settings.rounds):
            x = self._descend(self.energy(x), x, shape_alone)
        return x

    def _descend(self, energy: BodyEnergy, x: Unknowns, shape_alone: bool) -> Unknowns:
        """Damped Gauss-Newton within joint limits and hard ranges; the energy never rises."""
        here, damping = energy.at(x), 1e-3
        free = np.arange(len(here.gradient))
        if shape_alone:
            free = free[self._shaped.places(len(x.poses))[1]]
        for _ in range(self._settings.iterations):
            step = self._step(here, x, free, damping)
            if step is None:
                damping *= 10.0
                continue
            trial_x = self._shaped.moved(x, step)
            trial = energy.at(trial_x)
            gain = here.value - trial.value
            if gain > 0.0:
                x, here, damping = trial_x, trial, max(1e-6, damping * 0.1)
                if gain < self._settings.enough:
                    break
            else:
                damping *= 10.0
        return x

    def _step(self, here: Expansion, x: Unknowns, free: np.ndarray, damping: float) -> np.ndarray | None:
        H, g = here.hessian[np.ix_(free, free)], here.gradient[free]
        M = H + damping * np.diag(np.diag(H)) + 1e-9 * np.eye(len(free))
        low, high = (bound[free] for bound in self._shaped.bounds(x, self._radius))
        active, found = np.zeros(len(free), dtype=np.int8), np.zeros(len(free))
        if solve_box(M, g, low, high, active, 30, found) <= 0:
            return None
        step = np.zeros(len(here.gradient))
        step[free] = found
        return step

    def outcome(self, first: Fit, start: Unknowns, found: Unknowns) -> Fit:
        """The fit of what was found."""
        shaped = self._shaped
        expansion = self.energy(found).at(found)
        covariance = self._covariance(expansion, found)
        of_scales, of_shape = shaped.places(len(found.poses))
        values, std = (np.zeros((len(shaped.shape.parts), len(OF_PART))) for _ in range(2))
        place = shaped.shape.group, shaped.shape.kind
        values[place], std[place] = found.shape, np.sqrt(np.diag(covariance)[of_shape])
        nv = shaped.proportions.base.nv
        shape = ShapeFit(
            shaped.shape.parts,
            np.exp(values[:, :1] + values[:, 1:2] * [1.0, -1.0]),
            values[:, 2:],
            std,
            tuple(o.index for o in self._seen),
            found.poses,
            np.array([covariance[k * nv : (k + 1) * nv, k * nv : (k + 1) * nv] for k in range(len(self._seen))]),
            (np.nan, np.nan),
        )
        return replace(
            first, subject=shaped.at(found), scales=found.scales, covariance=covariance[of_scales, of_scales], shape=shape
        )

    def _covariance(self, expansion: Expansion, x: Unknowns) -> np.ndarray:
        """Inverse Hessian on the directions that no joint limit holds, zero on the others."""
        body = self._shaped.proportions.base
        free = [
            k * body.nv + free_directions(body, q, expansion.gradient[k * body.nv : (k + 1) * body.nv])
            for k, q in enumerate(x.poses)
        ]
        index = np.concatenate([*free, np.arange(len(x.poses) * body.nv, len(expansion.gradient))])
        found = np.zeros_like(expansion.hessian)
        held = expansion.hessian[np.ix_(index, index)] + 1e-9 * np.eye(len(index))
        found[np.ix_(index, index)] = np.linalg.inv(held)
        return 0.5 * (found + found.T)


def _with_the_rest(shaped: ShapedBody, first: Fit, count: int) -> Gaussian:
    """Prior of the scales, with what the first stage knows from the frames that the later ones do not look at."""
    rest = 1.0 - count / len(first.observations)
    own = np.diag(1.0 / shaped.proportions.std**2)
    precision = rest * np.linalg.inv(first.covariance) + (1.0 - rest) * own
    pull = rest * np.linalg.solve(first.covariance, first.scales) + (1.0 - rest) * own @ shaped.proportions.mean
    return Gaussian(np.linalg.solve(precision, pull), precision)
