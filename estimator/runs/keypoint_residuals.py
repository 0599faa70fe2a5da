"""Distances of keypoints and markers from their places on the tracked body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.point_targets import MarkerNoise
from estimator.runs.run_reader import Run
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
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


_NEAREST = 3.0  # standard deviations along one axis up to which a marker is not an outlier


class MarkerResiduals(NamedTuple):
    """names (M). apart (T, M) [m]: from each place on the body at `Run.q` to where the marker was measured, NaN where
    it was not, or there is no pose. std (M,) [m]: its expected standard deviation along each axis."""

    names: tuple[str, ...]
    apart: np.ndarray
    std: np.ndarray

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of each marker (M,) [m], outliers included; NaN of one that was never measured."""
        square = np.square(self.apart)
        count = np.isfinite(square).sum(axis=0)
        return np.asarray(np.sqrt(np.nansum(square, axis=0) / np.where(count, count, np.nan)))

    @property
    def median(self) -> np.ndarray:
        """Median distance of each marker (M,) [m]; NaN of one that was never measured."""
        known = np.isfinite(self.apart).any(axis=0)
        medians = np.full(len(self.names), np.nan)
        medians[known] = np.nanmedian(self.apart[:, known], axis=0)
        return medians

    @property
    def outlying(self) -> np.ndarray:
        """Share of each marker's measurements (M,) that lie farther away than three standard deviations."""
        seen = np.isfinite(self.apart).sum(axis=0)
        far = (np.nan_to_num(self.apart) > _NEAREST * self.std).sum(axis=0)
        return np.asarray(far / np.where(seen, seen, np.nan))

    @property
    def missing(self) -> np.ndarray:
        """Share of the frames (M,) in which each was not measured."""
        return np.asarray(np.isnan(self.apart).mean(axis=0))


def marker_residuals(run: Run, noise: MarkerNoise) -> MarkerResiduals | None:
    """Residuals of a run by markers; None for any other. noise: that of its settings."""
    offsets = marker_offsets(run)
    if offsets is None:
        return None
    return MarkerResiduals(run.body.marker_names, np.linalg.norm(offsets, axis=2), noise.stds(run.body))


def marker_offsets(run: Run) -> np.ndarray | None:
    """Where markers were measured from their places on the body (T, M, 3) [m], in the world, NaN without one or without
    a pose; None of a run without markers."""
    body, measured = run.body, run.markers
    if measured is None:
        return None
    offsets = measured[run.index] - body.markers_of(body.placed(np.nan_to_num(run.q)))
    offsets[~np.isfinite(run.q).all(axis=1)] = np.nan
    return np.asarray(offsets)
