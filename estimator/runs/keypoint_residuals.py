"""Distances of keypoints from their places on the tracked body, and these places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.runs.run_reader import Run
from estimator.search.cost_model import CostModel
from estimator.search.cost_settings import CostSettings
from estimator.search.hypothesis import EXCHANGED
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index

_SMALLEST = 1.0  # px: no person is seen smaller, though all keypoints may coincide


class KeypointPlaces(NamedTuple):
    """Where a detector marks a body's landmarks. names (L,). apart (L,) [m]: from the landmark to there. std (L,) [m]:
    standard deviation of that place along each axis, NaN where unknown."""

    names: tuple[str, ...]
    apart: np.ndarray
    std: np.ndarray


class KeypointResiduals(NamedTuple):
    """Residuals of T frames by C cameras, named `cameras`, and L landmarks: distances of keypoints from their places on
    the body along `Run.q`, NaN where missing.

    pixels, at_person, deviations (T, C, L): in the picture [px], at the person [m], in standard deviations.
    noise (C,): noise of each camera's detector, as a factor of the expected one; 1 where it was not measured.
    """

    cameras: tuple[str, ...]
    places: KeypointPlaces
    pixels: np.ndarray
    at_person: np.ndarray
    deviations: np.ndarray
    noise: np.ndarray

    @property
    def overall(self) -> tuple[float, float]:
        """Median of all keypoints [px], and at the person [m]; NaN without any."""
        pixels, metres = (_median(each, (0, 1, 2)) for each in (self.pixels, self.at_person))
        return float(pixels), float(metres)

    @property
    def of_cameras(self) -> np.ndarray:
        """Median of each camera, (C, 2) [px, m]; NaN of one without keypoints."""
        return np.stack([_median(each, (0, 2)) for each in (self.pixels, self.at_person)], axis=1)

    @property
    def of_landmarks(self) -> np.ndarray:
        """Median of each landmark over all cameras, (L, 2) [px, m]; NaN of one without keypoints."""
        return np.stack([_median(each, (0, 1)) for each in (self.pixels, self.at_person)], axis=1)


def keypoint_places(body: Body) -> KeypointPlaces:
    """The places of a body's keypoints."""
    apart = np.linalg.norm(body.keypoint_local - body.landmark_local, axis=1)
    return KeypointPlaces(body.landmark_names, apart, body.keypoint_std)


def keypoint_residuals(run: Run, cost: CostSettings, rows: Sequence[int] | np.ndarray) -> KeypointResiduals | None:
    """Residuals of some rows (T) of a run, which have poses; None where none of them has keypoints. cost: of the run's
    settings."""
    if not run.has_keypoints or not len(run.header.cameras):  # runs of the library may have been written without
        return None
    body, model, mirror = run.body, CostModel(run.body, cost), mirror_index(run.body.landmark_names)
    associations = associations_of(run)
    pixels, deviations, extents = [], [], []
    for t in np.asarray(rows).tolist():
        observation = run.observation(t)
        seen: Observation = observation.exchanged(mirror) if associations[t] == EXCHANGED else observation
        term, posed = model.observation_term(seen), body.at(run.q[t])
        deviations.append(term.distances(posed))
        pixels.append(np.linalg.norm(term.residuals(posed), axis=2))
        extents.append(seen.extents)
    shape = len(pixels), len(run.header.cameras), len(body.landmark_names)
    in_pixels = np.reshape(pixels, shape)
    if not np.isfinite(in_pixels).any():
        return None
    per_pixel = body.extent / np.maximum(np.reshape(extents, (*shape[:2], 1)), _SMALLEST)
    noise = run.observation(0).noise or (1.0,) * shape[1]
    return KeypointResiduals(
        tuple(camera.name for camera in run.header.cameras), keypoint_places(body), in_pixels, per_pixel * in_pixels,
        np.reshape(deviations, shape), np.array(noise),
    )  # fmt: skip


def associations_of(run: Run) -> np.ndarray:
    """Association of the keypoints in each frame's hypothesis on the path (T,)."""
    return np.asarray(run.mode_association[np.arange(len(run)), run.path])


def _median(values: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Over some axes of values (T, C, L), NaN where nothing is known."""
    known = np.isfinite(values).any(axis=axes)
    medians = np.nanmedian(np.where(np.expand_dims(known, axes), values, 0.0), axis=axes)
    return np.asarray(np.where(known, medians, np.nan))
