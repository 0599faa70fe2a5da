"""The fit of a person: proportions, then shape, then everything together, as far as the input allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.data.floor import OFF, KnownFloor
from estimator.data.observation import Observation
from estimator.data.sequence import Cues
from estimator.fitting.fit import Fit, size_by_floor, stature
from estimator.fitting.flesh import fit_flesh
from estimator.fitting.lengths import fit_lengths
from estimator.fitting.settings import FitSettings
from estimator.tracking.registry import Settings
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_PLACE_V, Body
from humanoid.subject.subject import Subject


def fit_person(
    subject: Subject,
    observations: Sequence[Observation],
    cues: Cues | None = None,
    *,
    seed: int = 0,
    settings: FitSettings | None = None,
    track_settings: Settings | None = None,
    height: float | None = None,
    floor: KnownFloor = None,
) -> Fit:
    """Fit a subject to the person in a clip, left and right alike.

    Frames without enough keypoints leave the subject as it is. The first stage alone is made without `cues`, what the
    pictures show, and where the pictures show neither edges nor silhouettes, or none that agree with it.
    track_settings: of the tracker that finds the poses, and of the energy in all stages. height [m]: of the person,
    where it is known: proportions are fitted around a subject of that height; one camera does not see absolute size, so
    that the fitted one is of it too, several see it and may disagree (`Fit.notes`). floor: where its height is known
    and the person's is not, one camera sees the size by it (`size_by_floor`). Equal seeds give equal fits.
    """
    settings = settings or FitSettings()
    known = 1.0 if height is None else height / stature(subject)
    given = subject if known == 1.0 else subject.resized(known)
    fit = fit_lengths(given, observations, seed, settings, track_settings)
    size = fit.size
    if cues is not None:
        sized = given if size == 1.0 else given.resized(size)
        fit = replace(fit_flesh(sized, fit, cues, settings, track_settings or Settings()), size=size)
    if fit.observations and len(fit.observations[0].cameras) == 1:
        if height is not None:
            fit = _of_size(fit, height / stature(fit.subject))
        elif floor is not None and floor != OFF:
            by_floor = size_by_floor(Body(fit.subject), fit.poses, fit.observations, floor)
            fit = replace(fit if by_floor is None else _of_size(fit, by_floor.factor), by_floor=by_floor)
    size = known * fit.size
    if size == 1.0:
        return replace(fit, height=height)
    return replace(fit, scales=size * fit.scales, covariance=size**2 * fit.covariance, size=size, height=height)


def _of_size(fit: Fit, factor: float) -> Fit:
    """A fit by one camera, of a person so much larger and farther away: the picture is the same."""
    body, centre = Body(fit.subject), fit.observations[0].cameras[0].origin_world
    shape = fit.shape
    if body.has_free_root:
        poses, covariance = _moved(fit.poses, fit.pose_covariance, centre, factor)
        fit = replace(fit, poses=poses, pose_covariance=covariance)
        if shape is not None:
            poses, covariance = _moved(shape.poses, shape.covariance, centre, factor)
            shape = replace(shape, poses=poses, covariance=covariance)
    return replace(fit, subject=fit.subject.resized(factor), size=factor * fit.size, shape=shape)


def _moved(q: np.ndarray, covariance: np.ndarray, centre: np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses (F, nq) whose root is so much farther from a camera's centre (3,), and their covariance (F, nv, nv)."""
    q, scale = q.copy(), np.ones(covariance.shape[-1])
    q[:, ROOT_PLACE_Q] = centre + factor * (q[:, ROOT_PLACE_Q] - centre)
    scale[ROOT_PLACE_V] = factor
    return q, covariance * np.outer(scale, scale)
