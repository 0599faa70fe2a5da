"""Limbs proposed by keypoints: where a detector's points put them, by every pair of views, or by one view and their
length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import meeting_points
from estimator.data.observation import Observation
from estimator.inference.beliefs.space import points_of
from estimator.trackers.loose_limbed.limbs.keypoint_evidence import LimbLandmarks, landmarks_of_limbs, longest_of
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from estimator.trackers.loose_limbed.part_detectors.keypoint_fits import (
    Fits,
    ViewRays,
    of_view,
    onto_points,
    person_depth,
    turned_about,
    usable,
)
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.subject.landmarks import mirror_index
from humanoid.support.settings import CheckedSettings, setting

_KNOWN_TURN = 0.6  # rad: how far a turn about the axis may be uncertain and still count as known
_LEAST_TURN = 0.1  # rad: how well it is known at best
_OFF_AXIS = 0.15  # of the limb's length: a landmark nearer to the axis does not show the turn about it


@dataclass(frozen=True)
class KeypointDetectorSettings(CheckedSettings):
    """Settings of the placing of limbs by keypoints; lengths are shares of the body's longest limb, as errors of
    detectors grow with the person.

    noise: standard deviation of a landmark that is placed by two views, and of the distance between their rays. gate:
    two rays farther apart are not of one landmark. misfit: landmarks farther from their place on the limb do not count.
    exchange [nats]: penalty of exchanging left and right of one view. rolls: turns about a limb's axis that are tried
    where the turn is unknown. least: share of the best weight below which a candidate is left out, before it is spread
    over turns; both views of a pair are taken as exchanged only where twice the exchange costs less than that. alone:
    where no pair of views shows a limb, take each view with the limb's length. depths: that are tried then, apart by
    `step`. deviation: of depths from the one that the body's size gives.
    Raises InputError where a value is outside its range.
    """

    noise: float = setting(0.04, above=0)
    gate: float = setting(0.15, above=0)
    misfit: float = setting(0.12, above=0)
    exchange: float = setting(1.5, at_least=0)
    rolls: int = setting(6, at_least=1)
    least: float = setting(0.02, at_least=0, below=1)
    alone: bool = True
    depths: int = setting(13, at_least=1)
    step: float = setting(0.25, above=0)
    deviation: float = setting(0.8, above=0)


NOTHING = PartProposals(np.zeros((0, 7)), np.zeros(0))


class _Pairs(NamedTuple):
    """Landmarks placed by pairs of views: points (K, L, 3) [m], NaN where they are not; gap (K, L): how far the rays
    miss each other [m]; confidence (K, L), 0 where there is no point; log_prior (K,) of the exchange of left and right.
    """

    points: np.ndarray
    gap: np.ndarray
    confidence: np.ndarray
    log_prior: np.ndarray


def keypoint_proposals(
    body: Body,
    graph: LimbGraph,
    observation: Observation,
    settings: KeypointDetectorSettings | None = None,
    landmarks: Sequence[LimbLandmarks] | None = None,
) -> AllPartProposals:
    """Candidates of every limb of a graph by an instant's keypoints, NaN where missing; none for a limb that they do
    not show.

    Each pair of views gives a candidate, never all views at once, so that a view that is mistaken spoils its own pairs
    alone; with each of the two as detected, and left and right exchanged. A limb's candidates are thus also those of
    the other side's keypoints, at less weight. Weights: confidence, times normal densities of how far rays miss each
    other and landmarks the limb, times what exchanges cost. Where no pair shows a limb, one view with the limb's
    length does: several depths about that which the body's size gives, two answers each.

    landmarks: `landmarks_of_limbs(body, graph)`, for callers with many instants.
    """
    settings = settings or KeypointDetectorSettings()
    landmarks = landmarks or landmarks_of_limbs(body, graph)
    size = longest_of(graph)
    readings = _readings(body, observation)
    pairs = _pairs(observation.cameras, readings, settings, size)
    views: list[ViewRays] | None = None
    part_proposals = []
    for limb, of in zip(graph.limbs, landmarks, strict=True):
        proposals = NOTHING if pairs is None else _by_pairs(limb, of, pairs, settings, size)
        if settings.alone and not len(proposals.weights):
            views = _views(observation.cameras, readings, landmarks, settings, size) if views is None else views
            proposals = _by_views(limb, of, views, settings, size)
        part_proposals.append(proposals)
    return tuple(part_proposals)


def _readings(body: Body, observation: Observation) -> list[tuple[np.ndarray, np.ndarray]]:
    """Directions (C, L, 3) in the cameras, NaN where missing, and confidence (C, L), 0 there: as detected, and, where
    that differs, with left and right exchanged."""
    seen = (observation.confidence > 0.0) & np.isfinite(observation.pixels).all(axis=2)
    pixels = np.where(seen[..., None], observation.pixels, np.nan)
    directions = np.stack([c.directions(p) for c, p in zip(observation.cameras, pixels, strict=True)])
    confidence = np.where(np.isfinite(directions).all(axis=2), np.minimum(observation.confidence, 1.0), 0.0)
    mirror = mirror_index(body.landmark_names)
    own = [(directions, confidence)]
    differs = (mirror != np.arange(len(mirror))).any()
    return [*own, (directions[:, mirror], confidence[:, mirror])] if differs else own


def _pairs(
    cameras: Sequence[Camera],
    readings: list[tuple[np.ndarray, np.ndarray]],
    settings: KeypointDetectorSettings,
    size: float,
) -> _Pairs | None:
    made = []
    for a, b in combinations(range(len(cameras)), 2):
        for i, j in product(range(len(readings)), repeat=2):
            directions = np.stack([readings[i][0][a], readings[j][0][b]])
            points = meeting_points((cameras[a], cameras[b]), directions)
            gap = np.zeros(len(points))
            for camera, d in zip((cameras[a], cameras[b]), directions, strict=True):
                off, ray = points - camera.centre_world, d @ camera.R_camera_world
                ahead = (off * ray).sum(axis=1) / np.square(ray).sum(axis=1)
                gap += np.where(ahead > 0.0, np.linalg.norm(off - ahead[:, None] * ray, axis=1), np.inf)
            meets = gap <= settings.gate * size  # not where it is NaN
            confidence = np.where(meets, np.sqrt(readings[i][1][a] * readings[j][1][b]), 0.0)
            made.append((points, np.where(meets, gap, 0.0), confidence, -settings.exchange * (i + j)))
    return _Pairs(*(np.array(values) for values in zip(*made, strict=True))) if made else None


def _by_pairs(
    limb: Limb, of: LimbLandmarks, pairs: _Pairs, settings: KeypointDetectorSettings, size: float
) -> PartProposals:
    noise = settings.noise * size
    weight, line = usable(of, pairs.confidence[:, of.landmark], noise, limb.length)
    rows = np.flatnonzero(np.isfinite(line[:, 0]))
    if not len(rows):
        return NOTHING
    weight, line = weight[rows], line[rows]
    R, t, misfit = onto_points(of.place, pairs.points[rows][:, of.landmark], weight)
    share = weight / weight.sum(axis=1, keepdims=True)
    gap = (share * np.square(pairs.gap[rows][:, of.landmark])).sum(axis=1)
    allowed = np.sqrt(noise**2 + (share * np.square(of.spread)).sum(axis=1))
    log_weight = pairs.log_prior[rows] + np.log((share * pairs.confidence[rows][:, of.landmark]).sum(axis=1))
    log_weight -= 0.5 * gap / noise**2 + 0.5 * np.square(misfit / allowed)
    fits = Fits(R, t, log_weight, rows, line, share @ of.place)
    fits = fits.of(np.flatnonzero(misfit <= settings.misfit * size * allowed / noise))
    return _proposals(_rolled(limb, of, _likeliest(fits, settings), settings, pairs))


def _rolled(
    limb: Limb, of: LimbLandmarks, fits: Fits, settings: KeypointDetectorSettings, pairs: _Pairs | None = None
) -> Fits:
    """The turns about its line to try for every fit: where other landmarks show it, theirs and one standard deviation
    to either side; otherwise several, evenly spaced."""
    angle, uncertain = np.zeros(len(fits.t)), np.full(len(fits.t), np.inf)
    if pairs is not None:
        angle, uncertain = _turn(limb, of, fits, pairs)
    free = (fits.line != 0.0).any(axis=1)
    known = free & (uncertain < _KNOWN_TURN) & (np.abs(fits.line[:, 2]) > 0.5)
    parts = [fits.of(np.flatnonzero(~free))]
    some = fits.of(np.flatnonzero(known))
    sign = np.where(some.line[:, 2] < 0.0, -1.0, 1.0)
    for side, share in ((0.0, 0.5), (-1.0, 0.25), (1.0, 0.25)):
        turned = turned_about(some, sign * (angle[known] + side * uncertain[known]))
        parts.append(turned._replace(log_weight=some.log_weight + np.log(share)))
    others = fits.of(np.flatnonzero(free & ~known))
    for k in range(settings.rolls):
        turned = turned_about(others, np.full(len(others.t), 2.0 * np.pi * k / settings.rolls))
        parts.append(turned._replace(log_weight=others.log_weight - np.log(settings.rolls)))
    return Fits(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _turn(limb: Limb, of: LimbLandmarks, fits: Fits, pairs: _Pairs) -> tuple[np.ndarray, np.ndarray]:
    """Turn (K,) [rad] of every fit about z by the landmarks off its axis, and its standard deviation (K,) [rad],
    infinite where no landmark shows it or they contradict each other."""
    points, seen = pairs.points[fits.row][:, of.turning], pairs.confidence[fits.row][:, of.turning] > 0.0
    local = np.where(seen[..., None], points - fits.t[:, None], 0.0) @ fits.R
    across = np.hypot(local[..., 0], local[..., 1])
    telling = seen & (across > _OFF_AXIS * limb.length)
    off = np.arctan2(local[..., 1], local[..., 0]) - of.angle
    deviation = np.square(np.maximum(of.uncertain, _LEAST_TURN)) + np.square(
        0.1 * limb.length / np.maximum(across, 1e-12)
    )
    weight = np.where(telling, 1.0 / deviation, 0.0)
    total = (weight * np.exp(1j * off)).sum(axis=1)
    sure = np.abs(total) > 0.7 * weight.sum(axis=1)
    uncertain = np.where(sure, 1.0 / np.sqrt(np.maximum(np.abs(total), 1e-12)), np.inf)
    return np.angle(total), np.maximum(uncertain, _LEAST_TURN)


def _views(
    cameras: Sequence[Camera],
    readings: list[tuple[np.ndarray, np.ndarray]],
    landmarks: Sequence[LimbLandmarks],
    settings: KeypointDetectorSettings,
    size: float,
) -> list[ViewRays]:
    """Views with a person of some depth in them, in every reading."""
    views = []
    for c, camera in enumerate(cameras):
        for k, (directions, confidence) in enumerate(readings):
            rays = directions[c] @ camera.R_camera_world
            rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
            depth = person_depth(landmarks, rays, size)
            if depth is not None:
                offsets = settings.step * size * (np.arange(settings.depths) - 0.5 * (settings.depths - 1))
                near = depth + offsets > 0.5 * size
                log_prior = -settings.exchange * k - 0.5 * np.square(offsets[near] / (settings.deviation * size))
                depths = (depth + offsets)[near]
                views.append(ViewRays(camera.centre_world, rays, confidence[c], depths, log_prior))
    return views


def _by_views(
    limb: Limb, of: LimbLandmarks, views: list[ViewRays], settings: KeypointDetectorSettings, size: float
) -> PartProposals:
    noise = settings.noise * size
    fits = [fit for view in views if (fit := of_view(limb, of, view, noise, settings.misfit * size)) is not None]
    if not fits:
        return NOTHING
    together = Fits(*(np.concatenate(values) for values in zip(*fits, strict=True)))
    return _proposals(_rolled(limb, of, _likeliest(together, settings), settings))


def _likeliest(fits: Fits, settings: KeypointDetectorSettings) -> Fits:
    """The fits of enough weight, whose turns are then tried. Being spread over many turns makes a fit no less
    likely."""
    best = fits.log_weight.max(initial=-np.inf)
    return fits.of(np.flatnonzero(fits.log_weight > best + np.log(max(settings.least, 1e-300))))


def _proposals(fits: Fits) -> PartProposals:
    if not len(fits.t):
        return NOTHING
    return PartProposals(points_of(fits.t, fits.R), np.exp(fits.log_weight - fits.log_weight.max()))
