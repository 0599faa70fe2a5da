"""Summary of each limb's belief by its clusters, and which place each limb of a body is put to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.inference.beliefs.graph import OK, Belief
from estimator.inference.beliefs.space import PLACEMENTS, placements_of
from estimator.inference.clusters import clusters, mean_and_covariance
from humanoid.limbs.limb import Limb, LimbGraph
from humanoid.support.errors import InputError


class PlacementCluster(NamedTuple):
    """One cluster of a limb's belief. point (7,): its mean, of `PLACEMENTS`. covariance (6, 6): in the tangent space
    there. share: of the belief's weight."""

    point: np.ndarray
    covariance: np.ndarray
    share: float


class Places(NamedTuple):
    """Places (L) of every limb, the heaviest first and none without a belief, and whether the measurements support its
    belief (L)."""

    of: tuple[tuple[PlacementCluster, ...], ...]
    explained: tuple[bool, ...]


def limb_places(graph: LimbGraph, beliefs: Sequence[Belief], apart: float, count: int) -> Places:
    """The clusters of each limb's belief, at most `count`, whose points are `apart` [m] or more in their ends or turned
    about their axis so far that the flesh is.

    Raises
    ------
    InputError: not one belief for each limb, or beliefs of another space.
    """
    if len(beliefs) != len(graph.limbs):
        remedy = f"one for each of the {len(graph.limbs)} limbs, in the graph's order"
        raise InputError("beliefs", f"there are {len(beliefs)}", place="assembly", remedy=remedy)
    for limb, belief in zip(graph.limbs, beliefs, strict=True):
        if belief.space != PLACEMENTS:
            raise InputError("beliefs", f"is of {belief.space}", place=limb.name, remedy="beliefs of placements")
    of = tuple(_places(limb, belief, apart, count) for limb, belief in zip(graph.limbs, beliefs, strict=True))
    return Places(of, tuple(belief.status == OK for belief in beliefs))


def ends(limb: Limb, points: np.ndarray) -> np.ndarray:
    """Both ends of a limb at points (N, 7), (N, 2, 3) [m]."""
    t, R = placements_of(points)
    return np.stack([t, t + limb.length * R[:, :, 2]], axis=1)


def _places(limb: Limb, belief: Belief, apart: float, count: int) -> tuple[PlacementCluster, ...]:
    usable = np.isfinite(belief.points).all(axis=1) & np.isfinite(belief.weights) & (belief.weights > 0.0)
    points, weights = np.ascontiguousarray(belief.points[usable]), belief.weights[usable]
    if len(points) == 0:
        return ()
    weights = weights / weights.sum()
    R = placements_of(points)[1]
    # limbs that are turned about their own axis differ by how far their flesh is moved: a trunk's front is wider than
    # an arm's
    side = 0.5 * float(max(limb.proximal.max(), limb.distal.max())) * R[:, :, 0]
    of = clusters(np.concatenate([*ends(limb, points).transpose(1, 0, 2), side], axis=1), weights, apart, count)
    places = []
    for k in range(int(of.max()) + 1):
        own = of == k
        if own.any():
            mean, covariance = mean_and_covariance(PLACEMENTS, points[own], weights[own])
            places.append(PlacementCluster(mean, covariance, float(weights[own].sum())))
    return tuple(sorted(places, key=lambda p: -p.share))


HALF_TURN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi])  # about a limb's own axis
FREE_TWIST = 1.0  # rad: standard deviation of the turn about its axis of a limb that was mistaken for its mirror image


class Choice(NamedTuple):
    """A place for every limb, None where it has none. cost [nats]: of preferring it to the likeliest places."""

    places: tuple[PlacementCluster | None, ...]
    cost: float = 0.0


class Mistakes(NamedTuple):
    """Penalties of choices, and which are tried.

    exchange [nats]: penalty of confusing limbs, or a front with a back, or of leaving a limb out. least: share of a
    belief from which another of its places is tried. same [m]: mean distance of both ends below which two limbs are
    believed in one place.
    """

    exchange: float
    least: float
    same: float


def choices(graph: LimbGraph, places: Places, mistakes: Mistakes) -> list[Choice]:
    """The likeliest places first, then everything that differs from them by one mistake, or by turning round.

    Limbs of both sides are exchanged from any limb outwards, and all of them together; limbs of the middle are turned
    by half a turn about their axis, and all limbs where the sides are exchanged with them: the body turned round. Where
    both limbs of a pair are believed in one place, which messages between neighbours cannot exclude, one of them, with
    what hangs on it, goes to another of its own places, or of its partner's, or to none. Every limb is tried at its
    next place.
    """
    base = Choice(tuple(p[0] if p else None for p in places.of))
    pairs = [(i, m) for i, m in enumerate(graph.mirror) if i < m]
    middle = [i for i, m in enumerate(graph.mirror) if i == m]
    outwards = [_outwards(graph, i) for i, _ in pairs]
    every = sorted({i for i, _ in pairs})
    exchanged = [
        _exchanged(graph, base, limbs, mistakes.exchange) for limbs in [*([every] if every else []), *outwards]
    ]
    turned = [_turned(base, middle, mistakes.exchange)] if every else []
    # a person who turns round has every limb turned, not only those of the middle
    turned += [_turned(c, range(len(graph.limbs)), mistakes.exchange) for c in exchanged[:1]]
    apart = [c for limbs in outwards for c in _apart(graph, places, base, limbs, mistakes)]
    return _distinct([base, *apart, *exchanged, *turned, *_next_places(places, base, mistakes.least)])


def outermost(graph: LimbGraph) -> list[int]:
    """Limbs of one side that nothing hangs on."""
    return [i for i, m in enumerate(graph.mirror) if i != m and _outwards(graph, i) == [i]]


def instead(
    graph: LimbGraph, base: Choice, places: Mapping[int, Sequence[PlacementCluster]], cost: float
) -> list[Choice]:
    """Outermost limbs elsewhere, one at a time; those of its side that it hangs on have no place then, and follow."""
    made = []
    for limb, others in places.items():
        inwards = [i for i, m in enumerate(graph.mirror) if i != m and limb in _outwards(graph, i)]
        for place in others:
            choice = base
            for i in inwards:
                choice = _with(choice, i, place if i == limb else None, 0.0)
            made.append(choice._replace(cost=base.cost + cost))
    return made


def _outwards(graph: LimbGraph, start: int) -> list[int]:
    """A limb and those that hang on it, seen from the middle; of one side alone."""
    near: list[set[int]] = [set() for _ in graph.limbs]
    for i, k in graph.edges:
        near[i].add(k)
        near[k].add(i)
    middle = [i for i, m in enumerate(graph.mirror) if i == m]
    depth, reached = dict.fromkeys(middle or [start], 0), list(middle or [start])
    for i in reached:
        for k in sorted(near[i] - depth.keys()):
            depth[k] = depth[i] + 1
            reached.append(k)
    side, todo = [start], [start]
    for i in todo:
        more = [k for k in sorted(near[i]) if depth.get(k, 0) > depth.get(i, 0) and k not in side]
        side += more
        todo += more
    return side


def _exchanged(graph: LimbGraph, base: Choice, limbs: Sequence[int], cost: float) -> Choice:
    """Some limbs of one side at the places of the other's, and the other way round."""
    places = list(base.places)
    for i in limbs:
        m = graph.mirror[i]
        places[i], places[m] = _of_mirror(base.places[m]), _of_mirror(base.places[i])
    return Choice(tuple(places), base.cost + cost)


def _of_mirror(place: PlacementCluster | None) -> PlacementCluster | None:
    """The place of a limb for its mirror image: of its turn about its axis little is known."""
    if place is None:
        return None
    covariance = place.covariance.copy()
    covariance[5, 5] += FREE_TWIST**2
    return place._replace(covariance=covariance)


def _turned(base: Choice, limbs: Sequence[int], cost: float) -> Choice:
    """Some limbs with their back in front."""
    places = list(base.places)
    for i in limbs:
        place = places[i]
        if place is not None:
            places[i] = place._replace(point=PLACEMENTS.integrate(place.point, HALF_TURN))
    return Choice(tuple(places), base.cost + cost)


def _apart(graph: LimbGraph, places: Places, base: Choice, limbs: Sequence[int], mistakes: Mistakes) -> list[Choice]:
    """Limbs of one side that are believed where the other side's are, elsewhere: at the next of their places, or else
    nowhere; for either side."""
    made = []
    for side in (limbs, [graph.mirror[i] for i in limbs]):
        both = [i for i in side if _one_place(graph, base, (i, graph.mirror[i]), mistakes.same)]
        for others in (True, False) if both else ():
            choice = base
            for i in both:
                place, cost = _elsewhere(graph, places, i, mistakes.exchange) if others else (None, mistakes.exchange)
                choice = _with(choice, i, place, cost)
            made.append(choice)
    return made


def _elsewhere(graph: LimbGraph, places: Places, i: int, exchange: float) -> tuple[PlacementCluster | None, float]:
    """The next of a limb's places, or of its partner's, and its penalty; nothing where there is none."""
    own, partner = places.of[i], places.of[graph.mirror[i]]
    if len(own) > 1:
        return own[1], min(exchange, float(np.log(own[0].share / own[1].share)))
    return (_of_mirror(partner[1]) if len(partner) > 1 else None), exchange


def _one_place(graph: LimbGraph, base: Choice, pair: tuple[int, int], same: float) -> bool:
    a, b = (base.places[i] for i in pair)
    if a is None or b is None:
        return False
    first, second = (ends(graph.limbs[i], p.point[None])[0] for i, p in zip(pair, (a, b), strict=True))
    return float(np.linalg.norm(first - second, axis=1).mean()) < same


def _next_places(places: Places, base: Choice, least: float) -> list[Choice]:
    """Each limb at the next of its own places."""
    return [
        _with(base, i, place, float(np.log(own[0].share / place.share)))
        for i, own in enumerate(places.of)
        for place in own[1:2]
        if place.share >= least
    ]


def _with(base: Choice, limb: int, place: PlacementCluster | None, cost: float) -> Choice:
    places = list(base.places)
    places[limb] = place
    return Choice(tuple(places), base.cost + cost)


def _distinct(made: Sequence[Choice]) -> list[Choice]:
    """Each once: on short graphs several mistakes are the same."""
    distinct: dict[bytes, Choice] = {}
    for choice in made:
        key = b"".join(b"-" if p is None else p.point.tobytes() for p in choice.places)
        distinct.setdefault(key, choice)
    return list(distinct.values())
