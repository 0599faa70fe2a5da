"""Limbs shouted by what fits a visual hull: the places inside it, in all directions, that a limb's likelihood likes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.inference.beliefs.space import points_of
from estimator.limbs.features import cone_of
from estimator.limbs.likelihood import LimbLikelihood, LimbView
from estimator.limbs.visual_hull import VisualHull, visual_hull
from estimator.search.shouters.contract import Shout, Shouts
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.support.compiled import jit
from humanoid.support.settings import check, setting

_STATIONS = 5
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True)
class HullSettings:
    """How much is looked at.

    spacing [m]: of the hull's cells. overlooked: so many views may not show the person where a limb is, if two others
    do. places: cells that limbs are tried in, at most. directions: of a limb's axis, without its sense. evenness: how
    much of a difference between places there is in which are drawn; 0 would take only the best fitting ones.
    poses: evaluated of a limb at first, half in either sense. rounds: of looking on about the best. kept: of which it
    is looked on. tries: poses about each. metres, radians: how far they are off, half as far in each further round.
    count: candidates of a limb, at most. apart [m], turned [rad]: one of the two lies between any two of them, at
    least. temper: share of the log likelihood ratio that is in a weight.
    Raises InputError where a value cannot be.
    """

    spacing: float = setting(0.05, above=0.005)
    overlooked: int = setting(1, at_least=0)
    places: int = setting(2500, at_least=1)
    directions: int = setting(48, at_least=1)
    evenness: float = setting(0.15, at_least=0)
    poses: int = setting(3000, at_least=2)
    rounds: int = setting(2, at_least=0)
    kept: int = setting(150, at_least=1)
    tries: int = setting(8, at_least=1)
    metres: float = setting(0.04, at_least=0)
    radians: float = setting(0.25, at_least=0)
    count: int = setting(50, at_least=1)
    apart: float = setting(0.08, at_least=0)
    turned: float = setting(0.4, at_least=0)
    temper: float = setting(0.2, at_least=0)

    def __post_init__(self) -> None:
        check(self)


NOBODY = Shout(np.zeros((0, 7)), np.zeros(0))


def hull_shouts(
    rng: np.random.Generator,
    graph: LimbGraph,
    likelihood: LimbLikelihood,
    views: Sequence[LimbView],
    settings: HullSettings | None = None,
) -> Shouts:
    """Candidates of every limb of a graph, by one instant's foreground and `likelihood`, which is of the same limbs and
    views; none where the views with foreground have nobody in common."""
    settings = settings or HullSettings()
    hull = visual_hull(views, likelihood.box, settings.spacing, settings.overlooked)
    if hull is None or not len(hull.cells):
        return (NOBODY,) * len(graph.limbs)
    return tuple(_shout(rng, hull, limb, likelihood, i, settings) for i, limb in enumerate(graph.limbs))


def _shout(rng, hull, limb, likelihood, index, settings):
    middle, axis = _fitting(rng, hull, limb, settings)
    half = 0.5 * (limb.start + limb.end)
    axis = np.concatenate([axis, -axis])
    t = np.concatenate([middle, middle]) - half * axis
    R = _about(rng, axis)
    log = likelihood.log_ratio(index, t, R)
    for k in range(settings.rounds):
        best = _distinct(t, R[:, :, 2], log, settings.kept, 0.5 * settings.apart, 0.5 * settings.turned)
        t1, R1 = _jittered(rng, t[best], R[best], settings.tries, settings.metres / 2**k, settings.radians / 2**k)
        inside = hull.holds(t1 + half * R1[:, :, 2])
        t1, R1 = t1[inside], R1[inside]
        t, R = np.concatenate([t, t1]), np.concatenate([R, R1])
        log = np.concatenate([log, likelihood.log_ratio(index, t1, R1)])
    best = _distinct(t, R[:, :, 2], log, settings.count, settings.apart, settings.turned)
    if not len(best):
        return NOBODY
    return Shout(points_of(t[best], R[best]), np.exp(settings.temper * (log[best] - log[best[0]])))


def _fitting(rng, hull, limb, settings):
    cells = hull.cells
    if len(cells) > settings.places:
        cells = cells[np.sort(rng.permutation(len(cells))[: settings.places])]
    cone = cone_of(limb)
    cone = np.array([cone[0], cone[1], cone[2:].mean()])
    ways = half_sphere(settings.directions)
    fit = np.empty((len(cells), len(ways)))
    frames = _frames(ways)
    _fits(cone, hull.middles(cells), frames, hull.low, hull.spacing, hull.state, fit)
    score = fit.ravel() + settings.evenness * rng.gumbel(size=fit.size)
    count = min(settings.poses // 2, int(np.isfinite(score).sum()))
    chosen = np.argpartition(-score, count - 1)[:count] if count else np.zeros(0, int)
    chosen = np.sort(chosen)
    cell, way = np.divmod(chosen, len(ways))
    middle = hull.middles(cells[cell]) + hull.spacing * rng.uniform(-0.5, 0.5, (count, 3))
    axis = ways[way] + 0.5 * math.sqrt(2.0 * math.pi / len(ways)) * rng.standard_normal((count, 3)) * 0.5
    return middle, axis / np.linalg.norm(axis, axis=1, keepdims=True)


def half_sphere(count: int) -> np.ndarray:
    """Unit vectors (count, 3) spread evenly over half the sphere."""
    z = 1.0 - (np.arange(count) + 0.5) / count
    angle = _GOLDEN * np.arange(count)
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def _frames(axis):
    """Rotations (N, 3, 3) whose z axis is the given one."""
    other = np.where(np.abs(axis[:, :1]) < 0.7, np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]]))
    x = np.cross(other, axis)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def _about(rng, axis):
    R = _frames(axis)
    a = rng.uniform(0, 2 * np.pi, len(axis))
    c, s = np.cos(a)[:, None], np.sin(a)[:, None]
    return np.stack([c * R[:, :, 0] + s * R[:, :, 1], c * R[:, :, 1] - s * R[:, :, 0], R[:, :, 2]], axis=-1)


def _jittered(rng, t, R, tries, metres, radians):
    from scipy.spatial.transform import Rotation

    n = len(t) * tries
    turn = Rotation.from_rotvec(radians * rng.standard_normal((n, 3))).as_matrix()
    return np.repeat(t, tries, axis=0) + metres * rng.standard_normal((n, 3)), np.repeat(R, tries, axis=0) @ turn


def _distinct(t, axis, log, count, apart, turned):
    order = np.argsort(-log, kind="stable")
    order = order[np.isfinite(log[order])]
    kept = np.empty(count, np.int64)
    n = _greedy(t[order], np.ascontiguousarray(axis[order]), apart**2, math.cos(min(turned, math.pi)), kept)
    return order[kept[:n]]


@jit
def _greedy(t, axis, square, cosine, kept):
    n = 0
    for i in range(t.shape[0]):
        if n == kept.shape[0]:
            break
        new = True
        for j in range(n):
            k = kept[j]
            d = (t[i, 0] - t[k, 0]) ** 2 + (t[i, 1] - t[k, 1]) ** 2 + (t[i, 2] - t[k, 2]) ** 2
            if (
                d < square
                and axis[i, 0] * axis[k, 0] + axis[i, 1] * axis[k, 1] + axis[i, 2] * axis[k, 2] > cosine
            ):
                new = False
                break
        if new:
            kept[n] = i
            n += 1
    return n


@jit
def _state(low, spacing, state, x, y, z):
    i, j, k = math.floor((x - low[0]) / spacing), math.floor((y - low[1]) / spacing), math.floor((z - low[2]) / spacing)
    if i < 0 or j < 0 or k < 0 or i >= state.shape[0] or j >= state.shape[1] or k >= state.shape[2]:
        return 0
    return state[i, j, k]


@jit
def _fits(cone, middles, frames, low, spacing, state, fit):
    half = 0.5 * (cone[1] - cone[0])
    away = cone[2] + 0.75 * spacing
    for n in range(middles.shape[0]):
        m = middles[n]
        for d in range(frames.shape[0]):
            F = frames[d]
            inside = 0.0
            short = 0
            for k in range(_STATIONS):
                z = half * (2.0 * (k + 0.5) / _STATIONS - 1.0)
                s = _state(low, spacing, state, m[0] + z * F[0, 2], m[1] + z * F[1, 2], m[2] + z * F[2, 2])
                inside += 1.0 if s == 2 else 0.7 if s == 1 else 0.0
                if s == 0:
                    short += 1
            if short > 1:
                fit[n, d] = -math.inf
                continue
            outside = 0.0
            for k in range(3):
                z = half * 0.6 * (k - 1.0)
                for side in range(4):
                    a = away * (1.0 - 2.0 * (side % 2))
                    col = side // 2
                    s = _state(
                        low, spacing, state,
                        m[0] + z * F[0, 2] + a * F[0, col], m[1] + z * F[1, 2] + a * F[1, col], m[2] + z * F[2, 2] + a * F[2, col],
                    )
                    outside += 1.0 if s == 0 else 0.5 if s == 1 else 0.0
            fit[n, d] = inside / _STATIONS + outside / 12.0
