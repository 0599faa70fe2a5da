"""The fit of a person by markers: lengths and the markers' places together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.fitting.fit import OTHER_SIZE, SAME_SIZE, Fit, bounded_lengths, evenly_spread, fit_resized, unfitted
from estimator.fitting.fitted_points import FittedMarkers
from estimator.fitting.measures import MeasuresEnergy, static_trial
from estimator.numerics.alignment import similarity_onto
from estimator.numerics.newton import NewtonSettings, minimise
from estimator.search.first_pose import start_modes
from estimator.search.mode_search import ModeSearch
from estimator.trackers.spec import mode_search
from estimator.tracking.registry import Settings
from humanoid.kinematics.body import Body, points_in_world
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Subject

_ROUNDS = 3  # of resizing


@dataclass(frozen=True)
class MarkerFitSettings:
    """Settings of the fit.

    frames: it uses this many, evenly spread over the trial. iterations: Newton steps. enough: decrease of the
    energy that a step has to bring for another to follow. effective_frames: soft tissue moves with the pose, alike in
    frames that are near each other and in every cycle of a walk, so that all frames together count as this many.
    static_frames: it uses this many of the static trial, which count as one together. standing_std [rad]: of every
    joint there, from upright standing, of ankles at least `estimator.fitting.measures.ANKLE_STD`. bent_from
    [rad]: farther from upright standing a joint is not taken as known.
    """

    frames: int = 40
    iterations: int = 15
    enough: float = 1e-3
    effective_frames: float = 4.0
    static_frames: int = 8
    standing_std: float = 0.05
    bent_from: float = 0.35


def fit_markers(
    subject: Subject,
    observations: Sequence[Observation],
    static: Sequence[Observation] = (),
    *,
    seed: int = 0,
    settings: MarkerFitSettings | None = None,
    track_settings: Settings | None = None,
) -> Fit:
    """Fit lengths, left and right alike, and each marker's place on its link, to a static or a moving trial, with the
    anthropometric prior of the lengths and that of the places (`Marker.std`), within hard ranges.

    A subject of another size is resized as a whole first. The fitted subject's markers have the places that were
    fitted, with their deviations. Trials without enough markers leave the subject as it is. Equal seeds give equal
    fits.

    static: frames of a trial in which the person stands upright, all joints about zero (`standing_pose`). Without it
    markers do not separate a joint's zero from their own places.
    """
    settings, track_settings = settings or MarkerFitSettings(), track_settings or Settings()
    used = _usable(observations, settings.frames)
    if not used:
        return unfitted(subject, ProportionedBody(subject))
    trials = _Trials(used, _usable(static, settings.static_frames))
    return fit_resized(subject, lambda sized: _fitted(sized, trials, seed, settings, track_settings), _ROUNDS)


class _Trials(NamedTuple):
    """The frames used of a moving trial and of a static one."""

    moving: Sequence[Observation]
    static: Sequence[Observation]


def _usable(observations: Sequence[Observation], count: int) -> list[Observation]:
    """Usable frames, evenly spread."""
    return evenly_spread([o for o in observations if o.has_enough_points], count)


def _fitted(
    subject: Subject, trials: _Trials, seed: int, settings: MarkerFitSettings, track_settings: Settings
) -> tuple[Fit, float]:
    """The fit of a subject at its size, and the factor of size that the lengths indicate."""
    body, (used, stood) = Body(subject), trials
    proportions = ProportionedBody(subject)
    share = min(1.0, settings.effective_frames / len(used))
    # all frames are of one person: the rest positions are evidence on a joint's zero once, not in every frame
    cost = track_settings.cost
    once = replace(cost, stabiliser_weight=cost.stabiliser_weight / max(1.0, share * len(used)))
    poses = _poses(subject, used, seed, track_settings)
    if (size := _size(body, used, poses)) and abs(np.log(size)) > 2.0 * SAME_SIZE:
        return unfitted(subject, proportions), size
    poses_static = _poses(subject, stood, seed, track_settings)
    known = static_trial(body, stood, poses_static, settings.standing_std, settings.bent_from) if stood else None
    energy = MeasuresEnergy(proportions, FittedMarkers(proportions), used, once, share, known)
    newton = NewtonSettings(settings.iterations, enough=settings.enough)
    best = minimise(energy, energy.model(energy.start, [*poses, *poses_static]), newton).model
    fit = replace(energy.fit(subject, best), bent=known.bent if known is not None else ())
    asks = abs(np.log(fit.mean_size)) > OTHER_SIZE or bounded_lengths(fit.subject)
    return fit, fit.mean_size if asks else 1.0


def _poses(subject: Subject, used: Sequence[Observation], seed: int, settings: Settings) -> list[np.ndarray]:
    """The best pose of every frame by itself."""
    search: ModeSearch = mode_search(Body(subject), settings)
    return [start_modes(search, np.random.default_rng((seed, o.index)), o, 1).modes[0].q for o in used]


def _size(body: Body, used: Sequence[Observation], poses: Sequence[np.ndarray]) -> float:
    """The ratio of the markers' distances to those on the body: the median of the frames."""
    sizes = []
    for observation, q in zip(used, poses, strict=True):
        some = observation.known_markers
        places = points_in_world(body.at(q), body.marker_joint[some], body.marker_local[some])
        assert observation.markers is not None
        sizes.append(similarity_onto(places, observation.markers[some], scaled=True).scale)
    return float(np.median(sizes))
