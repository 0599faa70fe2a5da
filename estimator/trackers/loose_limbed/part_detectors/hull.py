"""Limbs proposed by what fits a visual hull: the places inside it, in all directions, that a limb's likelihood
likes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.inference.beliefs.space import PLACEMENTS, placements_of, points_of
from estimator.trackers.loose_limbed.limbs.features import cone_of
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood, LimbView
from estimator.trackers.loose_limbed.limbs.visual_hull import ALL, MOST, VisualHull, visual_hull
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.support.compiled import jit
from humanoid.support.settings import CheckedSettings, setting

_STATIONS = 5  # along the axis, checked for being in the hull
_STEPS = np.array([-0.6, 0.0, 0.6])  # of half the length, where samples lie along the axis
_BESIDE = 0.75  # cells, and the limb's half-width, that are away from the axis
_OVERLOOKED = 0.5  # weight of the inside where a view does not show the person
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True)
class HullSettings(CheckedSettings):
    """Effort of the search in the hull.

    spacing [m]: of the hull's cells, which are larger where the background is unknown. overlooked: number of views that
    may miss the person where a limb is, if two others show it. places: cells that limbs are tried in, at most.
    directions: of a limb's axis, without its sense. evenness: 0 would draw only the poses that lie best in the hull,
    whose fit is 0 to 2, and large values any. poses: evaluated of a limb at first, half in either sense. rounds: of
    refinement about the best. survivors: the poses refined in each round. tries: poses about each. metres, radians:
    deviations of those, half as large in each further round. count: candidates of a limb, at most. apart [m], turned
    [rad]: any two of them differ by one of these at least, in the proximal joint or the axis. temper: share of the log
    ratio in a weight: views and cues are less independent than the likelihood assumes, and a good candidate is to be
    tried even beside a better one. Raises InputError where a value is outside its range.
    """

    spacing: float = setting(0.06, at_least=0.01)
    overlooked: int = setting(1, at_least=0)
    places: int = setting(2500, at_least=1)
    directions: int = setting(48, at_least=1)
    evenness: float = setting(0.15, at_least=0)
    poses: int = setting(4000, at_least=2)
    rounds: int = setting(2, at_least=0)
    survivors: int = setting(200, at_least=1)
    tries: int = setting(8, at_least=1)
    metres: float = setting(0.04, at_least=0)
    radians: float = setting(0.25, at_least=0)
    count: int = setting(50, at_least=1)
    apart: float = setting(0.08, at_least=0)
    turned: float = setting(0.4, at_least=0)
    temper: float = setting(0.2, at_least=0)


def hull_proposals(
    rng: np.random.Generator,
    graph: LimbGraph,
    likelihood: LimbLikelihood,
    views: Sequence[LimbView],
    settings: HullSettings | None = None,
) -> AllPartProposals:
    """Candidates of every limb of a graph by one instant's foreground and likelihood, which both need no pose.

    Limbs are tried in the cells of the visual hull of all views' foreground, where their axis lies inside it and their
    surroundings outside, in all directions, and about all axes at random; the best by the likelihood are jittered and
    tried again. Without any known background the hull is all that the cameras see in common, where the tried places are
    as sparse as elsewhere; with empty foreground there are no candidates. Weights are 1 at the best of a limb.

    graph: whose limbs the likelihood is of, with `views`.
    """
    settings = settings or HullSettings()
    hull = visual_hull(views, likelihood.box, settings.spacing, settings.overlooked)
    return tuple(_proposals(rng, hull, limb, likelihood, i, settings) for i, limb in enumerate(graph.limbs))


def _proposals(
    rng: np.random.Generator,
    hull: VisualHull,
    limb: Limb,
    likelihood: LimbLikelihood,
    index: int,
    settings: HullSettings,
) -> PartProposals:
    middle, axis = _fitting(rng, hull, limb, settings)
    half = 0.5 * (limb.start + limb.end)
    axis = np.concatenate([axis, -axis])
    t, R = np.concatenate([middle, middle]) - half * axis, _rolled(rng, axis)
    log = likelihood.log_ratio(index, t, R)
    for k in range(settings.rounds):
        best = _distinct(t, R, log, settings.survivors, 0.5 * settings.apart, 0.5 * settings.turned)
        near = np.repeat(points_of(t[best], R[best]), settings.tries, axis=0)
        off = np.array([settings.metres, settings.radians]).repeat(3) * 0.5**k
        more_t, more_R = placements_of(PLACEMENTS.moved(near, off * rng.standard_normal((len(near), 6))))
        inside = hull.holds(more_t + half * more_R[:, :, 2])
        t, R = np.concatenate([t, more_t[inside]]), np.concatenate([R, more_R[inside]])
        log = np.concatenate([log, likelihood.log_ratio(index, more_t[inside], more_R[inside])])
    best = _distinct(t, R, log, settings.count, settings.apart, settings.turned)
    return PartProposals(
        points_of(t[best], R[best]), np.exp(settings.temper * (log[best] - log[best].max(initial=-np.inf)))
    )


def _fitting(
    rng: np.random.Generator, hull: VisualHull, limb: Limb, settings: HullSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N, 3) [m] and unit axes (N, 3) of a limb that lie well in the hull."""
    cells = hull.cells
    if len(cells) > settings.places:
        cells = cells[np.sort(rng.permutation(len(cells))[: settings.places])]
    cone, ways = cone_of(limb), half_sphere(settings.directions)
    fit = np.empty((len(cells), len(ways)))
    size = np.array([0.5 * (limb.end - limb.start), cone[2:].mean()])
    _fits(size, hull.middles(cells), _frames(ways), hull.low, hull.spacing, hull.state, fit)
    noisy_fit = fit.ravel() + settings.evenness * rng.gumbel(size=fit.size)
    count = min(settings.poses // 2, int(np.isfinite(noisy_fit).sum()))
    chosen = np.sort(np.argpartition(-noisy_fit, count - 1)[:count]) if count else np.zeros(0, np.int64)
    cell, way = np.divmod(chosen, len(ways))
    middle = hull.middles(cells[cell]) + hull.spacing * rng.uniform(-0.5, 0.5, (count, 3))
    between = math.sqrt(2.0 * math.pi / len(ways))  # rad, from direction to direction
    axis = ways[way] + 0.25 * between * rng.standard_normal((count, 3))
    return middle, axis / np.linalg.norm(axis, axis=1, keepdims=True)


def half_sphere(count: int) -> np.ndarray:
    """Unit vectors (count, 3), spread evenly over the half of the sphere with z above 0."""
    z = 1.0 - (np.arange(count) + 0.5) / count
    angle, across = _GOLDEN * np.arange(count), np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def _frames(axis: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) with the z axes (N, 3)."""
    other = np.where(np.abs(axis[:, :1]) < 0.7, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    x = np.cross(other, axis)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def _rolled(rng: np.random.Generator, axis: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) with the z axes (N, 3), turned about them at random."""
    x, y, z = np.moveaxis(_frames(axis), -1, 0)
    angle = rng.uniform(0.0, 2.0 * np.pi, (len(axis), 1))
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=-1)


def _distinct(t: np.ndarray, R: np.ndarray, log: np.ndarray, count: int, apart: float, turned: float) -> np.ndarray:
    """Indices of the likeliest placements, best first, of which no two are nearer than `apart` [m] and `turned` [rad]
    at once. Impossible ones are left out."""
    order = np.argsort(-log, kind="stable")
    order = order[np.isfinite(log[order])]
    distinct = np.empty(count, np.int64)
    many = _unlike(t[order], np.ascontiguousarray(R[order, :, 2]), apart**2, math.cos(min(turned, math.pi)), distinct)
    return np.asarray(order[distinct[:many]])


@jit
def _unlike(t, axis, square, cosine, distinct):  # type: ignore[no-untyped-def]
    """Fills distinct (K,) with the first of t (N, 3), axis (N, 3) that are like none before; returns how many."""
    count = 0
    for i in range(t.shape[0]):
        if count == distinct.shape[0]:
            break
        new = True
        for j in range(count):
            k = distinct[j]
            away, along = 0.0, 0.0
            for c in range(3):
                away += (t[i, c] - t[k, c]) ** 2
                along += axis[i, c] * axis[k, c]
            if away < square and along > cosine:
                new = False
                break
        if new:
            distinct[count] = i
            count += 1
    return count


@jit
def _state(low, spacing, state, x, y, z):  # type: ignore[no-untyped-def]
    """State of the cell of a place: see `VisualHull`, whose low (3,) and state (X, Y, Z)."""
    i, j, k = math.floor((x - low[0]) / spacing), math.floor((y - low[1]) / spacing), math.floor((z - low[2]) / spacing)
    if i < 0 or j < 0 or k < 0 or i >= state.shape[0] or j >= state.shape[1] or k >= state.shape[2]:
        return 0
    return state[i, j, k]


@jit
def _fits(size, middles, frames, low, spacing, state, fit):  # type: ignore[no-untyped-def]
    """Fills fit (N, D) with the share of a limb's axis that is inside the hull and the share of what is beside it that
    is not, added, for middles (N, 3) and frames (D, 3, 3); minus infinity where more than one station is outside.

    size (2,): half the limb's length, and half its width [m]. low (3,), state (X, Y, Z): see `_state`.
    """
    away = size[1] + _BESIDE * spacing
    for n in range(middles.shape[0]):
        x, y, z = middles[n]
        for d in range(frames.shape[0]):
            F = frames[d]
            inside, out = 0.0, 0
            for k in range(_STATIONS):
                s = size[0] * (2.0 * (k + 0.5) / _STATIONS - 1.0)
                here = _state(low, spacing, state, x + s * F[0, 2], y + s * F[1, 2], z + s * F[2, 2])
                inside += 1.0 if here == ALL else _OVERLOOKED if here == MOST else 0.0
                out += here == 0
            fit[n, d] = -math.inf
            if out > 1:
                continue
            beside = 0
            for step in _STEPS:
                s = size[0] * step
                for side in range(4):
                    i, a = side // 2, away * (1.0 - 2.0 * (side % 2))
                    px, py, pz = (
                        x + s * F[0, 2] + a * F[0, i],
                        y + s * F[1, 2] + a * F[1, i],
                        z + s * F[2, 2] + a * F[2, i],
                    )
                    beside += _state(low, spacing, state, px, py, pz) != ALL
            fit[n, d] = inside / _STATIONS + beside / (4.0 * len(_STEPS))
