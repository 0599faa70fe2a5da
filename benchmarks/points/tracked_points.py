"""Bodies fitted to files of points and tracked from them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import kinemode as km
from benchmarks.support.tracking import Fitted
from estimator.data.markers.load import load_points
from estimator.data.observation import Observation
from estimator.fitting.fit import Fit
from estimator.runs.keypoint_residuals import MarkerResiduals, marker_residuals
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject
from kinemode.explain import run_settings
from kinemode.fits import fit_to_points
from kinemode.inputs.points import load_point_inputs
from kinemode.jobs import track_points
from kinemode.request import FitRequest, InputOptions, TrackRequest

TRACKER = "markers"
Part = tuple[float | None, float | None]
"""Where it begins and ends in a file [s]."""
WHOLE: Part = (None, None)


def middle_of(path: Path, seconds: float) -> Part:
    """So many seconds in the middle of a file of points; all of a shorter one."""
    time = load_points(path).time
    middle, half = 0.5 * float(time[0] + time[-1]), 0.5 * seconds
    return middle - half, middle + half


def fit_of(
    subject: Subject,
    path: Path,
    *,
    seed: int = 0,
    markers: str = "auto",
    part: Part = WHOLE,
    static: Path | None = None,
) -> Fit:
    """Lengths and places of markers by a trial, or by a part of it, and by a static trial where there is one."""
    with warnings.catch_warnings():
        _quiet()
        return fit_to_points(subject, FitRequest(subject, seed=seed, **_given(path, markers, part, static)))


def run_of(
    subject: Subject,
    path: Path,
    out: Path,
    *,
    fit: Fitted = "off",
    seed: int = 0,
    markers: str = "auto",
    settings: Mapping[str, Any] | None = None,
    part: Part = WHOLE,
) -> Run:
    """A trial, or a part of it, tracked, and smoothed, by the tracker of markers."""
    with warnings.catch_warnings():
        _quiet()
        request = TrackRequest(
            subject, tracker=TRACKER, settings=settings, seed=seed, fit=fit, out=out, overwrite=True,
            **_given(path, markers, part),
        )  # fmt: skip
        return track_points(subject, request)


def observations_of(
    subject: Subject, path: Path, *, markers: str = "auto", part: Part = WHOLE
) -> tuple[Body, Sequence[Observation]]:
    """The body with its markers, and what it is tracked from."""
    marked, inputs = load_point_inputs(subject, InputOptions(**_given(path, markers, part)))
    return Body(marked), inputs.observations


def residuals_of(run: Run) -> MarkerResiduals:
    """The distances of measured markers from their places along the best trajectory."""
    residuals = marker_residuals(run, run_settings(run).cost.markers)
    assert residuals is not None
    return residuals


def root_mean_square(values: np.ndarray) -> float:
    """Over all entries that are known."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def _given(path: Path, markers: str, part: Part, static: Path | None = None) -> dict[str, Any]:
    return {"points": path, "markers": markers, "start": part[0], "end": part[1], "static": static}


def _quiet() -> None:
    for category in (km.InputWarning, km.FindingWarning):
        warnings.simplefilter("ignore", category)
