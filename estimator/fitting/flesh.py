"""The later stages of a fit (CSS section 5): a person's shape from pictures, then everything together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.data.sequence import Cues
from estimator.fitting.body_energy import BodyEnergy, Gaussian, ShapedBody, Unknowns, covariance_at, descend, seen_at
from estimator.fitting.fit import Fit, ShapeFit
from estimator.fitting.settings import FitSettings
from estimator.fitting.shape_parameters import OF_PART
from estimator.tracking.registry import Settings
from estimator.vision.cues.edges import Edges
from estimator.vision.cues.settings import CueSettings, cues_of
from estimator.vision.cues.silhouette import Outline
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject

SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the new shape that are tried where its parts overlap


def fit_flesh(subject: Subject, first: Fit, cues: Cues, settings: FitSettings, track: Settings) -> Fit:
    """Stages two and three on the outcome of the first, which is returned where there is no evidence.

    subject: what the first stage was given. cues: what the pictures show. In the second stage the shape follows
    keypoints and contours with everything else held, in the third all is free. Sides are tied throughout, and the whole
    body is measured.
    """
    if not first.observations or not any(f.shape == "superquadric" for f in subject.flesh):
        return first
    picks = np.unique(np.linspace(0, len(first.observations) - 1, settings.flesh.frames).round().astype(int))
    seen = [replace(o, cues=cues.at(o.index)) for o in (first.observations[k] for k in picks)]
    if not any(cue.on_contours for o in seen for c in o.cues for cue in cues_of(c)):
        return first
    stages = _Stages(ShapedBody(subject, track.cues.surface.nodes), seen, first, settings, track)
    start = Unknowns(first.poses[picks], first.scales, np.zeros(len(stages.shaped.shape.low)))
    if stages.energy(start).features == 0:
        return first
    second = stages.run(start, stages.shape, None)
    third = stages.run(second, stages.everything, stages.self_collision(second))
    return stages.outcome(first, start, stages.apart(third))


class _Stages:
    """The later stages on some frames. shape, everything: what moves in the second and in the third."""

    def __init__(
        self, shaped: ShapedBody, seen: Sequence[Observation], first: Fit, settings: FitSettings, track: Settings
    ) -> None:
        self.shaped, self._seen, self._settings, self._cost = shaped, seen, settings.flesh, track.cost
        self._share = min(1.0, settings.effective_frames / len(seen))
        self._cues, flesh = track.cues, settings.flesh
        self._sharper = _sharper(_sharper(self._cues, Edges.name, flesh.edge_noise), Outline.name, flesh.outline_noise)
        self._on_scales = _with_the_rest(shaped, first, len(seen))
        self.shape = shaped.places(len(seen))[1]
        self.everything = slice(0, self.shape.stop)

    def energy(self, assigned_at: Unknowns, self_collision: SelfCollision | None = None) -> BodyEnergy:
        """The frames' energy with features as they are assigned at some unknowns."""
        return BodyEnergy(
            self.shaped,
            self._seen,
            assigned_at,
            self._cost,
            self._sharper,
            self._on_scales,
            self._share,
            self_collision,
        )

    def self_collision(self, x: Unknowns) -> SelfCollision | None:
        """Between the parts of some unknowns; None where they need not be kept apart."""
        return SelfCollision(Body(self.shaped.at(x))) if self._cost.interpenetration_weight > 0.0 else None

    def run(self, x: Unknowns, free: slice, self_collision: SelfCollision | None) -> Unknowns:
        """One stage: features assigned, energy minimised, features assigned again."""
        for _ in range(self._settings.rounds):
            x, _ = descend(self.shaped, self.energy(x, self_collision), x, free, self._settings.descent)
        return x

    def apart(self, x: Unknowns) -> Unknowns:
        """Unknowns with the shape drawn back as far as needed for its parts to keep clear of each other.

        At rest parts may not come to overlap so that their pair would be left out, nor in the fitted poses by more than
        is left unchanged, or than with the given flesh.
        """
        own = self._overlap(x._replace(shape=0.0 * x.shape))
        limit = max(own[1], self._settings.overlap)
        for share in SHARES[:-1]:
            pairs, overlap = self._overlap(x._replace(shape=share * x.shape))
            if pairs == own[0] and overlap <= limit:
                return x._replace(shape=share * x.shape)
        return x._replace(shape=SHARES[-1] * x.shape)

    def _overlap(self, x: Unknowns) -> tuple[tuple[tuple[str, str], ...], float]:
        """Pairs that are kept apart, and the deepest overlap in the poses [m]."""
        body = Body(self.shaped.at(x))
        self_collision = SelfCollision(body)
        return tuple(self_collision.pairs), max(self_collision.penetration(body.at(q)) for q in x.poses)

    def agreement(self, x: Unknowns) -> float:
        """Share of the body's outline that lies on the silhouettes', mean of cameras and frames; NaN without any."""
        seen = seen_at(self.shaped, self._seen, x, self._cues)
        shares = [share for posed, likelihood in seen for share in likelihood.agreement(posed)]
        return float(np.mean(shares)) if shares else np.nan

    def outcome(self, first: Fit, start: Unknowns, end: Unknowns) -> Fit:
        """The fit where the descent ended, or the first stage's where the silhouettes do not agree."""
        agreement = before, after = self.agreement(start), self.agreement(end)
        if after < max(self._settings.agreement, before - self._settings.worse):
            return first
        shaped, count, nv = self.shaped, len(end.poses), self.shaped.proportions.base.nv
        covariance = covariance_at(shaped, self.energy(end, self.self_collision(end)).at(end), end)
        of_scales, of_shape = shaped.places(count)
        values, std = np.zeros((2, len(shaped.shape.parts), len(OF_PART)))
        values[shaped.shape.group, shaped.shape.kind] = end.shape
        std[shaped.shape.group, shaped.shape.kind] = np.sqrt(np.diag(covariance)[of_shape])
        shape = ShapeFit(
            parts=shaped.shape.parts,
            factors=np.exp(values[:, :1] + values[:, 1:2] * [1.0, -1.0]),
            tapers=values[:, 2:],
            std=std,
            frames=tuple(o.index for o in self._seen),
            poses=end.poses,
            covariance=np.array([covariance[k : k + nv, k : k + nv] for k in range(0, count * nv, nv)]),
            agreement=agreement,
        )
        of_scales_too = covariance[of_scales, of_scales]
        return replace(first, subject=shaped.at(end), scales=end.scales, covariance=of_scales_too, shape=shape)


def _sharper(cues: CueSettings, name: str, factor: float) -> CueSettings:
    """Settings with the noise of one cue times a factor."""
    own = cues.of(name)
    changed: dict[str, Any] = {name: replace(own, noise=own.noise * factor)}
    return replace(cues, **changed)


def _with_the_rest(shaped: ShapedBody, first: Fit, count: int) -> Gaussian:
    """Prior of the scales, with the first stage's information from frames that the later ones do not use."""
    rest = 1.0 - count / len(first.observations)
    own = np.diag((1.0 - rest) / shaped.proportions.std**2)
    known = rest * np.linalg.inv(first.covariance)
    precision = own + known
    return Gaussian(np.linalg.solve(precision, known @ first.scales + own @ shaped.proportions.mean), precision)
