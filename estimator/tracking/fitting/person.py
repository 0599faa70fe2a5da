"""The fit of a person: proportions, then shape, then everything together, as far as the input allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from estimator.data.observation import Observation
from estimator.data.sequence import Cues
from estimator.tracking.fitting.fit import Fit
from estimator.tracking.fitting.flesh import fit_flesh
from estimator.tracking.fitting.lengths import fit_lengths
from estimator.tracking.fitting.settings import FitSettings
from estimator.tracking.registry import Settings
from humanoid.subject.subject import Subject


def fit_person(
    subject: Subject,
    observations: Sequence[Observation],
    cues: Cues | None = None,
    *,
    seed: int = 0,
    settings: FitSettings | None = None,
    track_settings: Settings | None = None,
) -> Fit:
    """Fit a subject to the person in the first frames of a clip, left and right alike.

    Frames without enough keypoints leave the subject as it is. The first stage alone is made without `cues`, what the
    pictures show, and where the pictures show neither edges nor silhouettes, or none that agree with it.
    track_settings: of the tracker that finds the poses, and of the energy in all stages. Equal seeds give equal fits.
    """
    settings = settings or FitSettings()
    first = fit_lengths(subject, observations, seed, settings, track_settings)
    fit, size = first, first.size
    if cues is not None:
        sized = subject if size == 1.0 else subject.resized(size)
        fit = replace(fit_flesh(sized, first, cues, settings, track_settings or Settings()), size=size)
    return fit if size == 1.0 else replace(fit, scales=size * fit.scales, covariance=size**2 * fit.covariance)
